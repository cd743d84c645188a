"""A run: its stages in their order, finished ones kept; and single stages from Python."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from expdesign.configuration import ConfigurationLike, InputError, RunConfiguration, load_run
from expdesign.stages.execution import (
    clear_leftovers,
    execute,
    input_hash,
    is_done,
    keep_configuration,
)
from expdesign.stages.folder import Place, refuse_removed, run_folder
from expdesign.stages.registry import missing_design, named_stages, reported_stages
from expdesign.stages.report import report_folder
from expdesign.stages.workspace import Outcome, Progress, StageFailed, Workspace, short
from expdesign.trajectory import FourierTrajectory, TrajectoryFile

if TYPE_CHECKING:
    from estimation.data.measurement import Measurement
    from estimation.identification import EstimationResult
    from expdesign.experiment import DesignResult


@dataclass(frozen=True, eq=False)
class RunResult:
    """Result of a run."""

    configuration: RunConfiguration
    folder: Path
    """The run folder."""
    stages: dict[str, Outcome]
    """The outcome of every stage that was done or kept, by name, in their order."""


def run(
    config: ConfigurationLike,
    out: Place | None = None,
    progress: Progress | None = None,
) -> RunResult:
    """Do every stage that a run names, as `expdesign run` does; finished stages are kept.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
    out : path, optional
        The run folder; ``runs/<name>`` under the current folder by default.
    progress : Progress, optional
        Listener of warnings, remarks, progress and outcomes; nothing is shown by default. The
        first Ctrl-C ends a search or a study with its result so far, the second at once.

    Raises
    ------
    InputError
        The run, its data or the run folder cannot be used.
    StageFailed
        A stage failed or was interrupted, or its result breaks a limit.
    """
    configuration = load_run(config)
    folder = run_folder(configuration, out)
    work = Workspace(configuration, folder, progress or Progress(), stages=reported_stages())
    refuse_unfit(configuration)
    if missing := missing_design(configuration, folder):
        raise InputError(missing)
    clear_leftovers(folder)
    work.warn(configuration.warnings)
    failed: StageFailed | None = None
    for stage in named_stages(configuration):
        if reason := stage.reason_left_out(configuration):
            work.progress.note(f"{stage.name}: left out, {reason}")
            continue
        work.inputs[stage.name] = input_hash(stage, work)
        if is_done(stage, work):
            work.progress.note(f"{stage.name}: done already, in {short(folder)}")
            work.made[stage.name] = Outcome(stage.name, folder)
            continue
        try:
            execute(stage, work)
        except StageFailed as error:
            made = work.made.get(stage.name)
            if made is None or not made.continues:
                raise
            failed = error
    if work.made and work.folder.is_dir():
        # Stages that were kept were made from the same sections; others may have changed.
        keep_configuration(configuration, work.folder)
    refuse_removed(work.folder, work.made.values())
    if failed is not None:
        raise failed
    return RunResult(configuration, work.folder, work.made)


def refuse_unfit(configuration: RunConfiguration) -> None:
    """Refuse motions of the validation that cannot be made, before any stage runs.

    What follows from the configuration alone has been refused with it.
    """
    if configuration.run.validation:
        from estimation.validation.motions import refuse_unfit_motions

        refuse_unfit_motions(configuration, configuration.robot.home)


def simulate(
    config: ConfigurationLike,
    design: DesignResult | FourierTrajectory | Place,
    repetition: int = 1,
) -> Measurement:
    """Measure a designed trajectory on the digital twin.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
        Run with the robot and the section `experiment`.
    design : DesignResult, FourierTrajectory or path
        Executed motion: a result, a run folder or `design.json`.
    repetition : int
        Number of the repetition, from 1; each has different noise.

    Returns
    -------
    Measurement
        Time, lengths and forces, in SI.

    Raises
    ------
    InputError
        Run or design cannot be used, or the robot cannot make the motion.
    """
    from estimation.twin import Twin

    return Twin.of(load_run(config), _trajectory(design)).measurement(repetition)


def load_measurement(config: ConfigurationLike, file: Place | None = None) -> Measurement:
    """Read a recording by a run's section `data`: columns, units, delay, part of the file.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
    file : path, optional
        File in a known format; the run's `data.file` by default.

    Returns
    -------
    Measurement
        Time, lengths and forces, in SI.

    Raises
    ------
    InputError
        The run or the file is unusable; every defect is named with column and row.
    """
    from estimation.data.reading import read_measurement

    configuration = load_run(config)
    section = configuration.run.data
    place = section.file if file is None else file
    if place is None:
        raise InputError("no recording is given", configuration.file, key="data.file")
    return read_measurement(place, section, configuration.robot)


def estimate(
    config: ConfigurationLike,
    data: Measurement | Place | Sequence[Measurement | Place] | None = None,
    design: DesignResult | FourierTrajectory | Place | None = None,
) -> EstimationResult:
    """Estimate the parameters from recordings.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
    data : Measurement, path or sequence of them, optional
        Recordings, combined in one estimate; the run's `data.file` by default.
    design : DesignResult, FourierTrajectory or path, optional
        Executed motion of all recordings; without it the period comes from the recording.

    Raises
    ------
    InputError
        Run, recording or design cannot be used, or do not fit.
    ComputationError
        No motion has the measured lengths, or the data do not determine some parameters.
    """
    from estimation import identification
    from estimation.data.measurement import Measurement

    configuration = load_run(config)
    given = configuration.run.data.file if data is None else data
    if given is None:
        raise InputError("no recording is given", configuration.file, key="data.file")
    recordings = [
        one if isinstance(one, Measurement) else load_measurement(configuration, one)
        for one in ([given] if isinstance(given, str | PathLike | Measurement) else given)
    ]
    trajectory = None if design is None else _trajectory(design)
    return identification.estimate(configuration, recordings, trajectory)


def report(folder: Place) -> Path:
    """Write the report of a run folder, one page for all its stages.

    Returns
    -------
    Path
        `report.html` in the folder.

    Raises
    ------
    InputError
        It is no run folder, or a file of it does not hold what it should.
    """
    page: Path = report_folder(Path(folder).absolute(), reported_stages()).result
    return page


def _trajectory(design: DesignResult | FourierTrajectory | Place) -> FourierTrajectory:
    if isinstance(design, FourierTrajectory):
        return design
    if isinstance(design, str | PathLike):
        return TrajectoryFile.read(Path(design).absolute()).trajectory
    return design.trajectory
