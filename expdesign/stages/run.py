"""A run: its stages one after the other, what is done being kept; and single stages from Python."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from expdesign.configuration import (
    ComputationError,
    ConfigurationLike,
    InputError,
    RunConfiguration,
    load_run,
)
from expdesign.interruption import interruptible
from expdesign.progress import listening, report_progress
from expdesign.stages.folder import Place, refuse_removed, refuse_unwritable, run_folder
from expdesign.stages.outcome import Outcome, Progress, StageFailed, short
from expdesign.stages.record import (
    clear_leftovers,
    is_done,
    keep_configuration,
    stage_inputs,
    write_entry,
)
from expdesign.stages.table import STAGES, left_out, loaded, named, stages_without_design
from expdesign.stages.workspace import Workspace
from expdesign.trajectory import FourierTrajectory, TrajectoryFile
from expdesign.workers import StoppedError

if TYPE_CHECKING:
    from estimation.data.measurement import Measurement
    from estimation.identification import EstimationResult
    from expdesign.experiment import DesignResult


_SAVING = ("what was found is saved first", "abandons what is not yet saved")


@dataclass(frozen=True, eq=False)
class RunResult:
    """What a run has made."""

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
    """Do every stage that a run names, as `expdesign run` does; what is done already is kept.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
    out : path, optional
        The run folder; ``runs/<name>`` under the current folder by default.
    progress : Progress, optional
        Takes warnings, remarks, how far a stage is and what it made; nothing is shown by default.
        The first Ctrl-C ends a search or a study with what it has, the second at once.

    Raises
    ------
    InputError
        The run, its data or the run folder cannot be used.
    StageFailed
        A stage failed or was interrupted, or its result breaks a limit.
    """
    configuration = load_run(config)
    work = Workspace(configuration, run_folder(configuration, out), progress or Progress())
    refuse_unfit(configuration)
    if missing := stages_without_design(configuration, work.folder):
        raise InputError(missing)
    clear_leftovers(work.folder)
    work.warn(configuration.warnings)
    failed: StageFailed | None = None
    for stage in named(configuration):
        if reason := left_out(stage, configuration):
            work.progress.note(f"{stage}: left out, {reason}")
            continue
        work.inputs[stage] = stage_inputs(stage, work)
        if is_done(stage, work):
            work.progress.note(f"{stage}: done already, in {short(work.folder)}")
            work.made[stage] = Outcome(stage, work.folder)
            continue
        try:
            do_stage(stage, work)
        except StageFailed as error:
            made = work.made.get(stage)
            if made is None or not made.goes_on:
                raise
            failed = error
    if work.made and work.folder.is_dir():
        # Stages that were kept were made from the same sections; others may have changed.
        keep_configuration(configuration, work.folder)
    refuse_removed(work.folder, work.made.values())
    if failed is not None:
        raise failed
    return RunResult(configuration, work.folder, work.made)


def do_stage(name: str, work: Workspace) -> Outcome:
    """Do a stage, leave its configuration in the folder and write its entry to the manifest.

    A stage that fails leaves `run.yaml` as it was: nothing there was made from its configuration.
    Files of an earlier run stay, but the manifest no longer vouches for them.

    Raises
    ------
    InputError
        What it needs is not there or cannot be used, or the folder cannot be written to.
    StageFailed
        It failed or was interrupted, or its result breaks a limit.
    KeyboardInterrupt
        An interruption came, and it is complete or nothing of it is kept.
    """
    work.inputs[name] = stage_inputs(name, work)
    refuse_unwritable(work.folder)
    clear_leftovers(work.folder)
    began = time.perf_counter()
    try:
        with work.progress.working(name) as listener, listening(listener):
            report_progress("loading what it needs")
            outcome: Outcome = loaded(STAGES[name].perform)(work)
            # What took hours is not lost to a Ctrl-C in the seconds that saving it takes.
            with interruptible(work.progress.note, *_SAVING) as asked:
                outcome = saved(outcome, name, work, began)
    except ComputationError as error:
        if work.folder.is_dir():
            status = "interrupted" if isinstance(error, StoppedError) else "failed"
            ended = Outcome(name, work.folder, status=status, message=error.message)
            write_entry(work, ended, time.perf_counter() - began)
        raise StageFailed(error.message, error.details) from error
    for warning in outcome.warnings:
        work.progress.warn(warning)
    work.progress.finished(outcome)
    if outcome.failure:
        raise StageFailed(outcome.failure, outcome.summary)
    if outcome.asked_to_stop or asked():
        raise KeyboardInterrupt
    return outcome


def saved(outcome: Outcome, name: str, work: Workspace, began: float) -> Outcome:
    """Write what a stage has made and its entry in the manifest; return the whole outcome."""
    files = _written(outcome, work)
    seconds = time.perf_counter() - began
    summary = {"folder": str(work.folder), "seconds": seconds, **outcome.summary}
    outcome = replace(outcome, stage=name, folder=work.folder, files=files, summary=summary)
    keep_configuration(work.configuration, work.folder)
    write_entry(work, outcome, seconds)
    work.made[name] = outcome
    return outcome


def _written(outcome: Outcome, work: Workspace) -> tuple[Path, ...]:
    """Write the record of a stage that has not written anything itself; return its files."""
    if outcome.record is None or outcome.files:
        return outcome.files
    report_progress("writing the results")
    files = outcome.record.write(work.folder)
    # The library that draws takes a second to load: what took hours is written by then.
    from results import record_figures

    formats = work.configuration.run.report.figures
    report_progress("drawing figures")
    return (*files, *record_figures(outcome.record, work.folder, formats))


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
        Its robot is measured as its section `experiment` says.
    design : DesignResult, FourierTrajectory or path
        What is executed: a result, or a run folder or `design.json`.
    repetition : int
        Number of the experiment, from 1; the noise of each is another.

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
    """Read a recording as a run's section `data` says: columns, units, delay, part of the file.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
    file : path, optional
        In one of the formats that are known; the run's `data.file` by default.

    Returns
    -------
    Measurement
        Time, lengths and forces, in SI.

    Raises
    ------
    InputError
        Run or file cannot be used: every defect with column and row.
    """
    from estimation.data.reading import read_measurement

    configuration = load_run(config)
    section = configuration.run.data
    place = section.file if file is None else file
    if place is None:
        raise InputError("there is no recording to read", configuration.file, key="data.file")
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
        What was executed in all of them; without it the period comes from the recording.

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
        raise InputError("there is nothing to estimate from", configuration.file, key="data.file")
    recordings = [
        one if isinstance(one, Measurement) else load_measurement(configuration, one)
        for one in ([given] if isinstance(given, str | PathLike | Measurement) else given)
    ]
    trajectory = None if design is None else _trajectory(design)
    return identification.estimate(configuration, recordings, trajectory)


def report(folder: Place) -> Path:
    """Write the report of a run folder: one page for every stage that it holds.

    Returns
    -------
    Path
        `report.html` in the folder.

    Raises
    ------
    InputError
        It is no run folder, or a file of it does not hold what it should.
    """
    from expdesign.stages.report import written_report

    page: Path = written_report(Path(folder).absolute()).result
    return page


def _trajectory(design: DesignResult | FourierTrajectory | Place) -> FourierTrajectory:
    if isinstance(design, FourierTrajectory):
        return design
    if isinstance(design, str | PathLike):
        return TrajectoryFile.read(Path(design).absolute()).trajectory
    return design.trajectory
