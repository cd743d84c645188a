"""What all studies have in common: their section of the run, repetitions, and what they show."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from estimation.montecarlo.repetition import FAILURES
from estimation.studies.records import Claim, StudyRecord, StudySummary
from expdesign.configuration import (
    ComputationError,
    Problem,
    ResolvedRobot,
    RunConfiguration,
    resolved_yaml,
)
from expdesign.configuration.sections.experiment import StudySection
from expdesign.robot import Robot
from expdesign.runfolder import RowTable
from expdesign.runfolder.atomic import write_text
from expdesign.workers import Job, Monitor, StoppedError, run_jobs

_NOISELESS = 1e-6
"""Length noise of exact kinematics, as a share of the robot's: an estimate needs some."""


class TooFewEstimatesError(ComputationError):
    """Noise let so many estimates fail that nothing can be compared."""


@dataclass(frozen=True, eq=False)
class Study(ABC):
    """A comparison on the digital twin that was done."""

    configuration: RunConfiguration
    robot: Robot

    @property
    def section(self) -> StudySection:
        """What the run asked for."""
        return study_section(self.configuration)

    @abstractmethod
    def claims(self) -> Iterable[Claim]:
        """Return what the study was to show, and what it showed."""

    @abstractmethod
    def rows(self) -> Mapping[RowTable[Any], Iterable[Any]]:
        """Return the rows of every table."""

    @cached_property
    def tables(self) -> dict[RowTable[Any], tuple[Any, ...]]:
        """All tables, made once."""
        return {table: tuple(rows) for table, rows in self.rows().items()}

    @cached_property
    def record(self) -> StudyRecord:
        """What its run folder holds."""
        run, section = self.configuration.run, self.section
        summary = StudySummary(
            name=run.name,
            robot=self.robot.name,
            simulated=True,
            kind=section.kind,
            settings=section.model_dump(mode="json"),
            seeds={
                "design": run.design.seed,
                "experiment": run.experiment.seed,
                "montecarlo": run.montecarlo.seed,
            },
            claims=tuple(self.claims()),
        )
        return StudyRecord(summary, self.tables)

    def write(self, folder: Path) -> list[Path]:
        """Write the run folder; return its files."""
        # Everything is computed before anything is written: a folder is not left half made.
        record = self.record
        run_file = folder / "run.yaml"
        written = [*self.write_designs(folder), *record.write(folder), run_file]
        write_text(run_file, resolved_yaml(self.configuration))
        return written

    def write_designs(self, folder: Path) -> list[Path]:
        """Write the designs that the study made, none by default; return their files."""
        del folder
        return []


def all_estimated(what: str, total: int, failed: int) -> Claim:
    """Return the claim that every run or experiment of a study can be estimated."""
    return Claim(f"every {what} can be estimated", f"{total - failed} of {total}", holds=not failed)


def study_section(configuration: RunConfiguration) -> StudySection:
    """Return the run's `study`; a run without one has none to do."""
    section = configuration.run.study
    if section is None:
        raise ValueError("the run has no study")
    return section


def with_exact_lengths(configuration: RunConfiguration) -> RunConfiguration:
    """Return the run with lengths that are measured a million times better."""
    truth = configuration.truth
    return replace(
        configuration,
        robot=_with_exact_lengths(configuration.robot),
        truth=None if truth is None else _with_exact_lengths(truth),
    )


def _with_exact_lengths(robot: ResolvedRobot) -> ResolvedRobot:
    noise = robot.noise
    if noise is None or noise.length_covariance is None:
        return robot
    covariance = noise.length_covariance * _NOISELESS**2
    return replace(robot, noise=replace(noise, length_covariance=covariance, length_spectrum=None))


def unknown_parameters(
    configuration: RunConfiguration, robot: Robot, key: str, names: Iterable[str]
) -> list[Problem]:
    """Return a problem for every name at this key path that is no parameter of the robot."""
    return [
        Problem(
            f"the robot {robot.name} has no parameter '{name}'",
            file=configuration.file,
            key=key,
            allowed=", ".join(robot.parameter_names),
        )
        for name in names
        if name not in robot.parameter_names
    ]


def results_of(
    configuration: RunConfiguration,
    build: Callable[[], Any],
    jobs: Sequence[Job],
    monitor: Monitor | None,
    progress: tuple[int, int],
) -> Iterator[Any]:
    """Do jobs on the run's `workers`, not on a scheduler; yield their results in their order.

    `build` makes what every job gets first, once per process; `progress` is how many jobs of the
    study are done before these, and how many there are.

    Raises
    ------
    StoppedError
        A stop was requested: a study compares all that it names, or nothing.
    """
    done, total = progress
    count = 0
    monitor = monitor or Monitor()
    silent = Monitor(monitor.stop_requested)
    for result in run_jobs(build, jobs, configuration.run.workers or 1, silent):
        count += 1
        monitor.advanced(done + count, total)
        yield result
    if count < len(jobs):
        raise StoppedError(f"interrupted after {done + count} of {total} steps")


def repeated(
    configuration: RunConfiguration, build: Callable[[], Any], monitor: Monitor | None
) -> list[Any]:
    """Return the results of `repeat(number)` of what `build` makes; None where noise let it fail.

    Raises
    ------
    StoppedError
        A stop was requested.
    """
    count = study_section(configuration).repetitions
    jobs = [Job(_repetition, (number,)) for number in range(1, count + 1)]
    return list(results_of(configuration, build, jobs, monitor, (0, count)))


def _repetition(bench: Any, _monitor: Monitor, number: int) -> Any:
    try:
        return bench.repeat(number)
    except FAILURES:
        return None
