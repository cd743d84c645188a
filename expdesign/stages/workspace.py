"""What a stage works with: the run, its folder, and what earlier stages of the run have made."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from expdesign.configuration import InputError, RunConfiguration
from expdesign.configuration.identification import machine_name
from expdesign.configuration.run import with_added_terms
from expdesign.runfolder.manifest import Manifest, file_hash
from expdesign.stages.outcome import Outcome, Progress
from expdesign.stages.table import STAGES
from expdesign.trajectory import FourierTrajectory, TrajectoryFile, fourier_keys

if TYPE_CHECKING:
    from estimation.data.measurement import Measurement
    from estimation.identification.saved import SavedEstimate

_DESIGN, _EXPERIMENT, _ESTIMATE = "design", "experiment", "estimate"


@dataclass(frozen=True)
class Sources:
    """What the options of a command say, in place of what is in the run folder."""

    designs: tuple[Path, ...] = ()
    """``--design``: run folders or files."""
    data: tuple[Path, ...] = ()
    """``--data``: recordings."""
    estimate: Path | None = None
    """``--estimate``: a run folder or file."""
    table: Path | None = None
    """``--table``: the controller table that is executed."""
    repetitions: int = 1
    """``--repetitions`` of an experiment."""


@dataclass(frozen=True, eq=False)
class Workspace:
    """What a stage works with. What is missing or cannot be used is an `InputError`."""

    configuration: RunConfiguration
    folder: Path
    """The run folder, absolute."""
    progress: Progress = field(default_factory=Progress)
    sources: Sources = Sources()
    made: dict[str, Outcome] = field(default_factory=dict)
    """Outcomes of the stages that were done or kept so far, by name."""
    inputs: dict[str, str] = field(default_factory=dict)
    """Hash of what each stage that was begun is made from, by name."""
    warned: list[str] = field(default_factory=list)
    """Warnings of robot and run that were told."""

    @property
    def measurement_file(self) -> Path:
        """Where the simulated recording stands."""
        return self.folder / STAGES[_EXPERIMENT].result

    @property
    def design_file(self) -> Path:
        """Where the design stands."""
        return self.folder / STAGES[_DESIGN].record

    def design(self) -> TrajectoryFile:
        """Return the design that is to be executed."""
        if self.sources.designs:
            return TrajectoryFile.read(self.sources.designs[0].absolute())
        result = self._result(_DESIGN)
        if result is not None:
            return TrajectoryFile(
                **fourier_keys(result.trajectory), robot=result.robot.name, status=result.status
            )
        if not self.design_file.exists():
            raise InputError(
                f"there is no design to execute: the run folder has no {self.design_file.name}",
                file=self.folder,
                key="--design",
                allowed="a folder that `expdesign design` wrote, or `design:` in the run file "
                "for `expdesign run`",
            )
        return TrajectoryFile.read(self.folder)

    def warn(self, warnings: Iterable[str]) -> None:
        """Tell warnings of robot and run that were not told for this folder before."""
        manifest = Manifest.known(self.folder)
        known = () if manifest is None else manifest.warnings
        for warning in warnings:
            if warning not in known:
                self.progress.warn(warning)
            self.warned.append(warning)

    def warn_of(self, design: TrajectoryFile) -> list[str]:
        """Warn of what is odd about executing a design in this run; return the warnings."""
        found = []
        robot = self.configuration.robot.name
        if design.robot is not None and machine_name(design.robot) != machine_name(robot):
            found.append(
                f"the design was made for the robot {design.robot}, and {robot} executes it"
            )
        if design.status in {"interrupted", "limits broken"}:
            ended = "breaks a limit" if design.status == "limits broken" else "was interrupted"
            found.append(f"the design that is executed {ended}")
        for warning in found:
            self.progress.warn(warning)
        return found

    def data_files(self) -> list[Path]:
        """Return the files of the recordings: those given, the run's, or the run folder's."""
        if self.sources.data:
            return [path.absolute() for path in self.sources.data]
        file = self.configuration.run.data.file
        if file is not None:
            return [Path(file)]
        if self.measurement_file.is_file():
            return [self.measurement_file]
        raise InputError(
            "there is nothing to estimate from: the run folder has no "
            f"{self.measurement_file.name}",
            file=self.folder,
            key="--data",
            allowed="a recording (--data FILE, or data.file in the run file), or a simulated "
            "one (`expdesign simulate`)",
        )

    def recording(self, file: Path) -> Measurement:
        """Return a recording: as this run has just simulated it, or read from its file."""
        from estimation.data.reading import measurement_of, read_measurement
        from estimation.data.table import RawTable

        section, robot = self.configuration.run.data, self.configuration.robot
        twin = self._result(_EXPERIMENT) if file == self.measurement_file else None
        if twin is None:
            return read_measurement(file, section, robot)
        # The table that the file is: what is read of it is the same.
        channels = twin.measurement().channels.items()
        values = {name: column.astype(np.float64, copy=False) for name, column in channels}
        return measurement_of(RawTable(file, values, {}, "line", 2), section, robot)

    def recorded_designs(self, recordings: int) -> list[FourierTrajectory | None]:
        """Return what was executed in each recording; None where it is not known."""
        given = self.sources.designs
        if not given:
            known = self._result(_DESIGN) is not None or self.design_file.is_file()
            return [self.design().trajectory if known else None] * recordings
        if len(given) not in (1, recordings):
            raise InputError(
                f"{recordings} recordings, but {len(given)} designs",
                key="--design",
                allowed="one design for all recordings, or one each",
            )
        named = [TrajectoryFile.read(path.absolute()).trajectory for path in given]
        return [*named] * (recordings if len(named) == 1 else 1)

    def estimate(self) -> tuple[RunConfiguration, SavedEstimate]:
        """Return the estimate that is to be validated, and the run with the terms that it added."""
        from estimation.identification.estimate_file import EstimateFile
        from estimation.identification.saved import saved_estimate
        from expdesign.robot import robot_from

        made = self.made.get(_ESTIMATE)
        place = self._estimate_place()
        path = place if place.is_file() else place / STAGES[_ESTIMATE].record
        if self.sources.estimate is None and made is not None and made.record is not None:
            found = made.record.summary
        else:
            found = EstimateFile.read(place)
        added = () if found.selection is None else found.selection.added
        configuration = with_added_terms(self.configuration, added)
        return configuration, saved_estimate(found, path, robot_from(configuration.robot))

    def made_from(self, need: str) -> str:
        """Return as text, with all digits, what a stage takes from elsewhere.

        Parameters
        ----------
        need : str
            As `Stage.needs` names it.
        """
        if need == "design":
            return trajectory_text(self.design().trajectory)
        if need == "recording":
            return " ".join(file_hash(path) for path in self._recorded_files() if path.is_file())
        if need == "estimate":
            place = self._estimate_place()
            path = place / STAGES[need].record if place.is_dir() else place
            return file_hash(path) if path.is_file() else ""
        manifest = Manifest.known(self.folder)
        entries = {} if manifest is None else manifest.stages
        # All but the report, which needs the others.
        others = [name for name in entries if name not in STAGES or need not in STAGES[name].needs]
        return repr([(name, asdict(entries[name])) for name in others])

    def _recorded_files(self) -> Iterator[Path]:
        yield from self.data_files()
        for path in self.sources.designs or (self.folder,):
            yield path / self.design_file.name if path.is_dir() else path

    def _estimate_place(self) -> Path:
        given = self.sources.estimate
        return self.folder if given is None else given.absolute()

    def _result(self, stage: str) -> Any:
        outcome = self.made.get(stage)
        return None if outcome is None else outcome.result


def trajectory_text(trajectory: FourierTrajectory) -> str:
    """Return the coefficients of a trajectory with all digits."""
    return " ".join(value.hex() for value in trajectory.vector().tolist())
