"""A run folder as views read it: its stages, their results and its configuration."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, TypeVar

from expdesign.configuration import InputError, RunConfiguration, load_run
from expdesign.runfolder import JsonFile
from expdesign.runfolder.manifest import (
    FolderChanges,
    Manifest,
    StageEntry,
    WatchedStage,
    find_changes,
)
from results.views.view import (
    Block,
    FindingsBlock,
    Level,
    ListingBlock,
    ReportTable,
    StageView,
    TextBlock,
)


@dataclass(frozen=True)
class StageViews:
    """Type of a stage's stored result, its view and its comparison."""

    result_type: type[Any]
    view: Callable[[RunFolder], StageView]
    """View of a folder that holds the stage."""
    compare: Callable[[Mapping[str, RunFolder], float, bool], StageView] | None = None
    """Comparison of folders by their labels, with the relative standard deviation for which periods
    are counted, and whether costs are left out that take long; None: of the views' facts."""


class ViewedStage(WatchedStage, Protocol):
    """A stage with its view, such as a `Stage`.

    A folder without its `file` does not hold the stage; `writes` has patterns of its other files.
    `compared` is the table by whose hash comparisons identify its result, empty for a stage that is
    not compared.
    """

    compared: str

    def views(self) -> StageViews:
        """Return the type of the stored result, its view and its comparison."""


Result = TypeVar("Result", bound=JsonFile)


@dataclass(frozen=True, eq=False)
class RunFolder:
    """A run folder with the stages it may hold, in the order of their sections.

    The manifest is None where it is missing or unusable. Results in memory are kept by their type;
    others are read once. Views of a brief one leave out what takes a computation.
    """

    path: Path
    stages: Mapping[str, ViewedStage]
    configuration: RunConfiguration
    manifest: Manifest | None = None
    results: dict[type[Any], Any] = field(default_factory=dict)
    brief: bool = False

    @classmethod
    def open(
        cls, path: Path, stages: Mapping[str, ViewedStage], results: Iterable[Any] = ()
    ) -> RunFolder:
        """Open a run folder, no other one; results in memory are not read from its files."""
        if not path.is_dir():
            wrong = "this is a file, not a folder" if path.is_file() else "there is no such folder"
            raise _refused(path, wrong)
        if not (path / "run.yaml").is_file():
            raise _refused(path, "not a run folder: run.yaml is missing")
        files = [stage.file for stage in stages.values()]
        if not any((path / file).is_file() for file in files):
            raise _refused(path, f"the folder has no results: none of {', '.join(files)}")
        return cls(
            path,
            stages,
            load_run(path / "run.yaml"),
            Manifest.known(path),
            {type(result): result for result in results},
        )

    @property
    def torque_per_force(self) -> float | None:
        """N m per N at the motors of the run; None: forces, or a result alone in memory."""
        run: RunConfiguration | None = self.configuration
        return None if run is None else run.robot.drive.torque_per_force

    @cached_property
    def changes(self) -> FolderChanges:
        """Changes by hand of the files."""
        return find_changes(self.path, self.manifest, self.stages, self.configuration)

    def view(self, stage: str) -> StageView:
        """Return the view of a stage; that of changed files or inputs without its claims.

        Claims are a good verdict, facts, findings, instructions, and columns with a proof or an
        outcome.
        """
        view = self.stages[stage].views().view(self)
        changes = self.changes.of(stage)
        if not changes:
            return view
        said, verdict = "; ".join(changes), view.verdict
        if verdict.level is Level.BAD:
            verdict = replace(verdict, sentence=f"{verdict.sentence} {said}.")
        else:
            sentence = f"{said}: the results of this stage may not hold for these files."
            verdict = replace(verdict, level=Level.CAUTION, word="changed", sentence=sentence)
        blocks = (TextBlock(f"{said}.", Level.CAUTION), *map(_without_claims, view.blocks))
        left = tuple(block for block in blocks if block is not None)
        return replace(view, verdict=verdict, blocks=left, facts=())

    @property
    def held(self) -> tuple[str, ...]:
        """Names of the stages that the folder holds."""
        return tuple(name for name in self.stages if self.has(name))

    def has(self, stage: str) -> bool:
        """Return whether the folder holds a stage."""
        return stage in self.stages and self.stage_file(stage).is_file()

    def stage_file(self, stage: str) -> Path:
        """Return the place of the file without which the folder does not hold a stage."""
        return self.path / self.stages[stage].file

    def result(self, kind: type[Result]) -> Result:
        """Return the folder's result of a type, such as ``folder.result(DesignResult)``."""
        if kind not in self.results:
            self.results[kind] = kind.read(self.path)
        found: Result = self.results[kind]
        return found

    def entry(self, stage: str) -> StageEntry | None:
        """Return the manifest's entry of a stage; None without one."""
        return None if self.manifest is None else self.manifest.stages.get(stage)

    def named(self, file: str) -> str:
        """Return the name of a file in a report: relative to the folder, or the name alone."""
        path = Path(file)
        return str(path.relative_to(self.path)) if path.is_relative_to(self.path) else path.name


def _without_claims(block: Block) -> Block | None:
    """Return a block without its claims; None if it consists of claims."""
    if isinstance(block, ReportTable):
        return block.without_claims()
    is_good = isinstance(block, TextBlock) and block.level is Level.GOOD
    return None if is_good or isinstance(block, FindingsBlock | ListingBlock) else block


def _refused(path: Path, message: str) -> InputError:
    allowed = (
        "a folder that `expdesign run`, design, export, simulate, noise, estimate, validate or "
        "montecarlo wrote"
    )
    return InputError(message, file=path, allowed=allowed)
