"""Workspace of a stage: the run, its folder, its inputs, and the outcomes of earlier stages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from expdesign.configuration import ComputationError, InputError, RunConfiguration
from expdesign.configuration.run import add_terms
from expdesign.configuration.tolerances import machine_name
from expdesign.evaluation.machine_code import cache_warning
from expdesign.progress import Listener, report_progress
from expdesign.robot import robot_from
from expdesign.runfolder.manifest import Manifest, file_hash
from expdesign.trajectory import FourierTrajectory, TrajectoryFile, fourier_keys
from results.views.folder import ViewedStage
from results.views.view import StageView

if TYPE_CHECKING:
    from estimation.data.measurement import Measurement
    from estimation.identification.identified_model import IdentifiedModel
    from expdesign.solver.phases import SearchEvent

_DESIGN, _EXPERIMENT, _ESTIMATE, _REPORT = "design", "experiment", "estimate", "report"
MEASUREMENT_FILE = "measurement.csv"
ESTIMATE_FILE = "estimate.json"


class Progress:
    """Listener of a run that ignores everything; a subclass overrides the methods of interest."""

    def warn(self, text: str) -> None:
        """Take a warning."""

    def note(self, text: str) -> None:
        """Take a remark, such as a stage that is kept or left out."""

    def finished(self, outcome: Outcome) -> None:
        """Take the outcome of a stage."""

    @contextmanager
    def search(self, configuration: RunConfiguration) -> Iterator[Callable[[SearchEvent], None]]:
        """Show the search for a design; yield the listener of its events."""
        del configuration
        yield lambda _event: None

    @contextmanager
    def working(self, name: str) -> Iterator[Listener]:
        """Show the progress of a stage; yield the listener of its reports."""
        del name
        yield lambda _what, _done, _total: None

    @contextmanager
    def count(self, what: str) -> Iterator[Callable[[int, int], None]]:
        """Show the number of finished items of `what`, a plural; yield the counts' listener."""
        yield lambda done, total: report_progress(what, done, total)


def short(path: Path) -> str:
    """Return a path relative to the current folder where it lies in it."""
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)


class StageFailed(ComputationError):  # noqa: N818 - it is no bug but a result
    """A stage failed, was interrupted, or its result breaks a limit: exit status 1."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a stage: its result, its files and its end."""

    stage: str = ""
    """Name of the stage."""
    folder: Path = Path()
    """The run folder."""
    result: Any = None
    """The result, as a run hands it to later stages; None when the stage was kept."""
    record: Any = None
    """The result as it is stored and viewed; None where the stage has no stored result."""
    files: tuple[Path, ...] = ()
    """Files that the stage has written; without any, the record is written and drawn for it."""
    summary: dict[str, Any] = field(default_factory=dict)
    """Output of the command with ``--json``, beside the folder and the time."""
    status: str = "done"
    """Status in the manifest: ``"done"``, ``"limits broken"``, ``"incomplete"`` or
    ``"interrupted"``."""
    message: str = ""
    """One line for the manifest."""
    warnings: tuple[str, ...] = ()
    """Warnings of the result, without those of the run file."""
    doubt: str = ""
    """Reason to doubt the result; an error with ``--strict``."""
    failure: str = ""
    """Reason why the stage failed although it wrote files; empty for a success."""
    continues: bool = False
    """Whether later stages are done after a failure, because the result is complete in parts."""
    view: StageView | None = None
    """The view of the result, for the terminal."""
    asked_to_stop: bool = False
    """Whether an interruption came; the run ends after this stage."""

    @property
    def kept(self) -> bool:
        """Whether the stage had been done before, from the same inputs."""
        return self.result is None


@dataclass(frozen=True)
class Sources:
    """Inputs from the options of a command; they replace those of the run folder."""

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
    """Run, folder and inputs of a stage. A missing or unusable input is an `InputError`."""

    configuration: RunConfiguration
    folder: Path
    """The run folder, absolute."""
    progress: Progress = field(default_factory=Progress)
    sources: Sources = Sources()
    made: dict[str, Outcome] = field(default_factory=dict)
    """Outcomes of the stages so far, by name."""
    stages: Mapping[str, ViewedStage] = field(default_factory=dict)
    """Stages with a section in the report, in the order of the sections."""
    inputs: dict[str, str] = field(default_factory=dict)
    """Hash of the inputs of each stage that was begun, by name."""
    warned: list[str] = field(default_factory=list)
    """Warnings of robot and run that were reported."""

    def __post_init__(self) -> None:
        """Warn of a cache of machine code that is not used."""
        if warning := cache_warning():
            self.progress.warn(warning)

    @property
    def measurement_file(self) -> Path:
        """File of the simulated recording."""
        return self.folder / MEASUREMENT_FILE

    @property
    def design_file(self) -> Path:
        """File of the design."""
        return self.folder / TrajectoryFile.FILE

    def design(self) -> TrajectoryFile:
        """Return the design to execute."""
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
        """Report warnings of robot and run that are new in this folder."""
        manifest = Manifest.known(self.folder)
        known = () if manifest is None else manifest.warnings
        for warning in warnings:
            if warning not in known:
                self.progress.warn(warning)
            self.warned.append(warning)

    def warn_of(self, design: TrajectoryFile) -> list[str]:
        """Report doubts about the execution of a design in this run; return the warnings."""
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
        """Return the files of the recordings: from the options, the run file or the run folder."""
        if self.sources.data:
            return [path.absolute() for path in self.sources.data]
        file = self.configuration.run.data.file
        if file is not None:
            return [Path(file)]
        if self.measurement_file.is_file():
            return [self.measurement_file]
        raise InputError(
            f"no recording: the run folder has no {self.measurement_file.name}",
            file=self.folder,
            key="--data",
            allowed="a recording (--data FILE, or data.file in the run file), or a simulated "
            "one (`expdesign simulate`)",
        )

    def recording(self, file: Path) -> Measurement:
        """Return a recording, simulated in this run or read from its file."""
        from estimation.data.reading import measurement_of, read_measurement
        from estimation.data.table import RawTable

        section, robot = self.configuration.run.data, self.configuration.robot
        twin = self._result(_EXPERIMENT) if file == self.measurement_file else None
        if twin is None:
            return read_measurement(file, section, robot)
        # The same table as in the file.
        channels = twin.measurement().channels.items()
        values = {name: column.astype(np.float64, copy=False) for name, column in channels}
        return measurement_of(RawTable(file, values, {}, "line", 2), section, robot)

    def recorded_designs(self, recordings: int) -> list[FourierTrajectory | None]:
        """Return the executed design of each recording; None where it is not known."""
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

    def estimate(self) -> tuple[RunConfiguration, IdentifiedModel]:
        """Return the run with the terms that the estimate added, and the estimate."""
        from estimation.identification.identified_model import identified_model
        from estimation.identification.result import EstimateFile

        made = self.made.get(_ESTIMATE)
        place = self._estimate_place()
        path = place if place.is_file() else place / ESTIMATE_FILE
        if self.sources.estimate is None and made is not None and made.record is not None:
            found = made.record
        else:
            found = EstimateFile.read(place)
        added = () if found.selection is None else found.selection.added
        configuration = add_terms(self.configuration, added)
        return configuration, identified_model(found, path, robot_from(configuration.robot))

    def made_from(self, need: str) -> str:
        """Return an input of a stage, of `Stage.needs`, as text with all digits or hashes."""
        if need == "design":
            return trajectory_text(self.design().trajectory)
        if need == "recording":
            return " ".join(file_hash(path) for path in self._recorded_files() if path.is_file())
        if need == "estimate":
            place = self._estimate_place()
            path = place / ESTIMATE_FILE if place.is_dir() else place
            return file_hash(path) if path.is_file() else ""
        manifest = Manifest.known(self.folder)
        entries = {} if manifest is None else manifest.stages
        others = {name: asdict(entry) for name, entry in entries.items() if name != _REPORT}
        return repr(list(others.items()))

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
