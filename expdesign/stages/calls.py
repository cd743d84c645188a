"""The stages that a user calls most, as functions: `expdesign.simulate`, `estimate`, `report`."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

from expdesign.configuration import ConfigurationLike, InputError, load_run
from expdesign.trajectory import FourierTrajectory, TrajectoryFile

if TYPE_CHECKING:
    from estimation.data.measurement import Measurement
    from estimation.identification import EstimationResult
    from expdesign.experiment import DesignResult

Place = str | PathLike[str]


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
    from estimation.data.reading import read_measurement

    configuration = load_run(config)
    section = configuration.run.data
    given = section.file if data is None else data
    if given is None:
        raise InputError("there is nothing to estimate from", configuration.file, key="data.file")
    recordings = [
        one if isinstance(one, Measurement) else read_measurement(one, section, configuration.robot)
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
