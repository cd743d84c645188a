"""Stage: the base class of the steps of a run, their workspace and their outcome."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from expdesign.configuration import (
    ComputationError,
    InputError,
    RunConfiguration,
    RunDescription,
)
from expdesign.configuration.schema import MOST_SAMPLES
from expdesign.configuration.several_runs import motion_folders
from expdesign.configuration.tolerances import machine_name
from expdesign.evaluation.machine_code import cache_warning
from expdesign.progress import Listener, report_progress
from expdesign.runfolder.manifest import Manifest, file_hash
from expdesign.trajectory import FourierTrajectory, TrajectoryFile, fourier_keys
from results.render.notebook import show_results
from results.views.folder import StageViews, ViewedStage
from results.views.view import StageView

Keys = bool | set[str]

MEASUREMENT_FILE = "measurement.csv"
ESTIMATE_FILE = "estimate.json"
FIGURES = "figures/*"
TABLES = ("columns.json", "tables/*.csv", FIGURES)
"""Files of most stages: their tables, the description of these, and figures."""


def run_sections(*names: str, **keys: set[str]) -> Mapping[str, Keys]:
    """Return sections of a run file, or some of their keys, with those that every stage has.

    Examples
    --------
    >>> run_sections("design", experiment={"periods"})["experiment"]
    {'periods'}
    """
    return {**dict.fromkeys(("name", "robot", *names), True), **keys}


@dataclass(frozen=True)
class StageFunctions:
    """Functions of a stage, in modules that are loaded when the stage is done or shown."""

    run: Callable[[Workspace], Outcome]
    """Do the stage. Raises `InputError` for an unusable input, `ComputationError` without a
    result."""
    views: StageViews
    """Type of the stored result, its view and its comparison."""

    def __post_init__(self) -> None:
        """Let the results show themselves in Python."""
        show_results(self.views)


class Stage(ABC):
    """A stage of a run: its inputs, its files and its functions.

    A new stage needs a subclass in a module, and nothing more; another package registers its module
    in the entry-point group ``expdesign.plugins``.
    """

    name: str
    """Key in the run file."""
    does: str
    """Description, as the rest of a sentence."""
    file: str
    """File without which a run folder does not hold the stage."""
    output: str = ""
    """File without which the stage is done again; `file` by default."""
    writes: tuple[str, ...] = ()
    """Further files that are always written, and patterns of those that depend on the run."""
    sections: Mapping[str, Keys] | None = None
    """Sections of the run file, or keys of them, that the result depends on; None: all."""
    needs: tuple[str, ...] = ()
    """Inputs in addition to the run file: ``"design"``, ``"others"`` for the further motions that a
    design names, ``"recording"`` (with the executed design, if there is one), ``"estimate"``,
    ``"validation"`` for its recorded motions, ``"tolerances"`` for their treatment by the run's
    estimator, or ``"folder"`` for all other stages. They come from the options of the command, from
    memory when the same run has made them, or from the run folder."""
    makes_design: bool = False
    """Whether its command makes a missing design first."""
    compared: str = ""
    """Table that identifies the result in comparisons; empty: the stage is not compared."""
    motions: Literal["together", "each", "both"] = "together"
    """Place of the stage in a run with several motions: its folder, those of the motions, both."""
    in_sweep: bool = False
    """Whether the stage is done in a sweep, for all its designs."""
    after: str = ""
    """Stage before this one in a run; by default a plug-in's is the last before the report."""
    shown_after: str = ""
    """Stage before this one in a report; by default as in a run."""

    @abstractmethod
    def functions(self) -> StageFunctions:
        """Return the functions of the stage; modules that take long to load are imported here."""

    def read_inputs(self, work: Workspace) -> None:
        """Read and refuse inputs, before the modules of the functions are loaded."""
        del work

    def views(self) -> StageViews:
        """Return the type of the stored result, its view and its comparison."""
        return self.functions().views

    def inputs(self, configuration: RunConfiguration) -> tuple[str, ...]:
        """Return the inputs that the stage needs in this run, of `needs`."""
        del configuration
        return self.needs

    def reason_left_out(self, configuration: RunConfiguration) -> str:
        """Return the reason why a run that names the stage leaves it out; empty: it is done."""
        run, needs = configuration.run, self.inputs(configuration)
        if not self.in_sweep and run.sweep is not None:
            return "the sweep makes several designs; `expdesign run` of the run.yaml of one does it"
        simulated = run.data.recording is None and "experiment" in run.stages
        needed = "recording" in needs or ("estimate" in needs and "estimate" in run.stages)
        reason = too_long_to_simulate(run) if simulated and needed else ""
        return f"there is no recording: {reason}" if reason else ""


def too_long_to_simulate(run: RunDescription) -> str:
    """Return the reason against a simulation of the experiment with its longest period."""
    samples = run.experiment.count_samples(1 / run.trajectory.frequency[0])
    if samples <= MOST_SAMPLES:
        return ""
    return f"{samples:.4g} samples are too many to be simulated, {MOST_SAMPLES} at most"


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of a stage: its result, its files and its end."""

    stage: str = ""
    """Name of the stage."""
    folder: Path = Path()
    """The run folder."""
    result: Any = None
    """The result as it is stored and viewed; None for a stage that was kept."""
    recording: Any = None
    """The simulated recording, a `Measurement` for later stages of the run; None for others."""
    files: tuple[Path, ...] = ()
    """Files that the stage has written; without any, the result is written and drawn for it."""
    summary: dict[str, Any] = field(default_factory=dict)
    """Output of the command with ``--json``, in addition to the folder and the time."""
    status: str = "done"
    """Status in the manifest: ``"done"``, ``"limits broken"``, ``"not reachable"``,
    ``"incomplete"`` or ``"interrupted"``; a run keeps only what is done."""
    message: str = ""
    """One line for the manifest."""
    warnings: tuple[str, ...] = ()
    """Warnings of the result, without those of the run file."""
    doubt: str = ""
    """Reason to doubt the result; an error with ``--strict``."""
    failure: str = ""
    """Reason why the stage failed although it wrote files; empty where the status is done."""
    continues: bool = False
    """Whether later stages are done after a failure, because the result is complete in parts."""
    view: StageView | None = None
    """The view of the result, for the terminal."""
    temporary: tuple[Path, ...] = ()
    """Files that are removed once the result is saved."""
    asked_to_stop: bool = False
    """Whether an interruption came; the run ends after this stage."""

    @property
    def kept(self) -> bool:
        """Whether the stage had been done before, from the same inputs."""
        return self.result is None


class Progress:
    """Listener of a run that ignores everything; a subclass overrides the methods of interest."""

    def warn(self, text: str) -> None:
        """Take a warning."""

    def note(self, text: str) -> None:
        """Take a remark, such as a stage that is kept or left out."""

    def finished(self, outcome: Outcome) -> None:
        """Take the outcome of a stage."""

    def show(self, outcome: Outcome) -> None:
        """Take the outcome of a stage, then its warnings."""
        self.finished(outcome)
        for warning in outcome.warnings:
            self.warn(warning)

    @contextmanager
    def search(self, configuration: RunConfiguration) -> Iterator[Callable[[Any], None]]:
        """Show the search for a design; yield the listener of its events, each a `SearchEvent`."""
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
        report_progress(what)
        yield lambda done, total: report_progress(what, done, total)


def short(path: Path) -> str:
    """Return a path relative to the current folder where it lies in it."""
    try:
        return str(path.relative_to(Path.cwd()))
    except (ValueError, OSError):
        return str(path)


class StageFailed(ComputationError):  # noqa: N818 - it is no bug but a result
    """A stage failed, was interrupted, or its result breaks a limit: exit status 1."""


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
    force: bool = False
    """``--force``: estimate although channels contradict the section `data`."""


@dataclass(frozen=True, eq=False)
class Workspace:
    """Run, folder and inputs of a stage. A missing or unusable input is an `InputError`."""

    configuration: RunConfiguration
    folder: Path
    """The run folder, absolute."""
    progress: Progress = field(default_factory=Progress)
    sources: Sources = Sources()
    resume: bool = False
    """Whether an interrupted search continues."""
    made: dict[str, Outcome] = field(default_factory=dict)
    """Outcomes of the stages so far, by name."""
    recordings: dict[Path, Any] = field(default_factory=dict)
    """Recordings that were read, each a `Measurement`, by their files."""
    stages: Mapping[str, ViewedStage] = field(default_factory=dict)
    """Stages with a section in the report, in the order of the sections."""
    inputs: dict[str, str] = field(default_factory=dict)
    """Hash of the inputs of each stage that was begun, by name."""
    origins: dict[str, dict[str, str]] = field(default_factory=dict)
    """Hash of each input of each stage that was begun, by stage and path."""
    warned: list[str] = field(default_factory=list)
    """Warnings of robot and run that were reported."""

    def __post_init__(self) -> None:
        """Warn of a cache of machine code that is not used."""
        if warning := cache_warning():
            self.progress.warn(warning)

    @property
    def motion_folders(self) -> tuple[Path, ...]:
        """Folders of the run's motions: the run folder itself for a single one."""
        return motion_folders(self.configuration, self.folder)

    @property
    def design_file(self) -> Path:
        """File of the design."""
        return self.folder / TrajectoryFile.FILE

    def design(self) -> TrajectoryFile:
        """Return the design to execute."""
        if self.sources.designs:
            return TrajectoryFile.read(self.sources.designs[0].absolute())
        result = self._result("design")
        if result is not None:
            return TrajectoryFile(
                **fourier_keys(result.trajectory), robot=result.robot.name, status=result.status
            )
        if not self.design_file.exists():
            several = len(self.motion_folders) > 1
            raise InputError(
                f"there is no design to execute: the run folder has no {self.design_file.name}",
                file=self.folder,
                key="--design",
                allowed=f"one of {', '.join(map(short, self.motion_folders))}"
                if several
                else "a folder that `expdesign design` wrote, or `design:` in the run file "
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
        file = self.configuration.run.data.recording
        if file is not None:
            return [Path(file)]
        simulated = [place / MEASUREMENT_FILE for place in self.motion_folders]
        if all(path.is_file() for path in simulated):
            return simulated
        raise InputError(
            f"no recording: the run folder has no {MEASUREMENT_FILE}",
            file=self.folder,
            key="--data",
            allowed="a recording (--data FILE, or data.file in the run file), or a simulated "
            "one (`expdesign simulate`)",
        )

    def recorded_designs(self, recordings: int) -> list[FourierTrajectory | None]:
        """Return the executed design of each recording; None where it is not known."""
        given = self.sources.designs
        if not given and len(self.motion_folders) > 1:
            given = self.motion_folders
            if len(given) != recordings:
                raise InputError(
                    f"recordings: {recordings}, motions: {len(given)}",
                    key="--data",
                    allowed="one recording of each motion in their order, or --design for each",
                )
        if not given:
            known = self._result("design") is not None or self.design_file.is_file()
            return [self.design().trajectory if known else None] * recordings
        if len(given) not in (1, recordings):
            raise InputError(
                f"{recordings} recordings, but {len(given)} designs",
                key="--design",
                allowed="one design for all recordings, or one each",
            )
        named = [TrajectoryFile.read(path.absolute()).trajectory for path in given]
        return [*named] * (recordings if len(named) == 1 else 1)

    def made_from(self, need: str) -> str:
        """Return an input of a stage, of `Stage.needs`, as text with all digits or hashes."""
        if need == "design":
            return trajectory_text(self.design().trajectory)
        if need in ("recording", "others", "estimate", "validation"):
            return " ".join(file_hash(path) for path in self.input_files(need))
        if need == "tolerances":
            section, robot = self.configuration.run.estimate, self.configuration.robot
            treatment = section.systematic == "none", section.estimates_tolerances
            recorded = section.harmonics, self.configuration.records_voltages
            return "" if robot.tolerances is None else repr((*treatment, *recorded))
        manifest = Manifest.known(self.folder)
        entries = {} if manifest is None else manifest.stages
        others = {name: asdict(entry) for name, entry in entries.items() if name != "report"}
        return repr(list(others.items()))

    def input_files(self, need: str) -> list[Path]:
        """Return the existing files of an input of a stage, of `Stage.needs`.

        A recording that is a folder, of rosbag2, is all files in it.
        """
        runs = self.configuration, *(point.configuration for point in self.configuration.grid)
        others = dict.fromkeys(Path(file) for one in runs for file in one.run.design.motion_files)
        designs = [path.absolute() for path in self.sources.designs or self.motion_folders]
        places = [*others] if need == "others" else designs
        files = [path / self.design_file.name if path.is_dir() else path for path in places]
        if need == "recording":
            pair = self.configuration.run.data.files
            files = [*self.data_files(), *([] if pair is None else [Path(pair.forces)]), *files]
        elif need == "estimate":
            place = self.estimate_place
            files = [place / ESTIMATE_FILE if place.is_dir() else place]
        elif need == "validation":
            motions = self.configuration.run.validation
            files = [Path(one.file) for one in motions if one.motion == "file" and one.file]
        elif need == "design" and self.sources.table is not None:
            files.append(self.sources.table.absolute())
        elif need not in ("design", "others"):
            files = []
        inside = (sorted(place.iterdir()) if place.is_dir() else [place] for place in files)
        return [file for places in inside for file in places if file.is_file()]

    @property
    def estimate_place(self) -> Path:
        """Folder or file of the estimate."""
        given = self.sources.estimate
        return self.folder if given is None else given.absolute()

    def _result(self, stage: str) -> Any:
        outcome = self.made.get(stage)
        return None if outcome is None else outcome.result


def trajectory_text(trajectory: FourierTrajectory) -> str:
    """Return the coefficients of a trajectory with all digits."""
    return " ".join(value.hex() for value in trajectory.vector().tolist())
