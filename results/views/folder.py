"""A run folder as a report reads it: which stages it holds, and what describes it."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, Self, TypeVar

from expdesign.configuration import InputError, RunConfiguration, load_run
from expdesign.runfolder.manifest import Manifest, StageEntry
from results.figures.drawing import FigureDefinition
from results.views.view import FigureBlock, StageView


@dataclass(frozen=True)
class ReportedStage:
    """A stage as reports know it: what a folder has to hold, and what makes its part."""

    file: str
    report: Callable[[RunFolder], StageView]


class Readable(Protocol):
    """What a stage leaves, as a type that reads it from the run folder."""

    @classmethod
    def read(cls, folder: Path, /) -> Self:
        """Read it."""


Record = TypeVar("Record", bound=Readable)


@dataclass(frozen=True, eq=False)
class RunFolder:
    """A folder that stages wrote to.

    The stages are those that it may hold, in the order of their sections. There is no manifest
    where it is missing or cannot be used. The records are, by their type, what was handed over by
    who wrote it, and what was read once.
    """

    path: Path
    stages: Mapping[str, ReportedStage]
    configuration: RunConfiguration
    manifest: Manifest | None
    records: dict[type[Any], Any] = field(default_factory=dict)

    @classmethod
    def open(
        cls, path: Path, stages: Mapping[str, ReportedStage], records: Iterable[Any] = ()
    ) -> RunFolder:
        """Open a run folder; `records` are in memory, and not read from its files therefore.

        Raises
        ------
        InputError
            It is none, or its `run.yaml` is not a valid run.
        """
        if not path.is_dir():
            wrong = "this is a file, not a folder" if path.is_file() else "there is no such folder"
            raise _refused(path, wrong)
        if not (path / "run.yaml").is_file():
            raise _refused(path, "it is no run folder: it has no run.yaml")
        files = [stage.file for stage in stages.values()]
        if not any((path / file).is_file() for file in files):
            raise _refused(path, f"it has no results: none of {', '.join(files)}")
        return cls(
            path,
            stages,
            load_run(path / "run.yaml"),
            Manifest.known(path),
            {type(record): record for record in records},
        )

    def has(self, stage: str) -> bool:
        """Tell whether the folder holds what a stage wrote."""
        return self.stage_file(stage).is_file()

    def stage_file(self, stage: str) -> Path:
        """Return the place of the file without which the folder does not hold a stage."""
        return self.path / self.stages[stage].file

    def record(self, kind: type[Record]) -> Record:
        """Return what the folder holds of a kind, ``folder.record(DesignResult)``; read once.

        Raises
        ------
        InputError
            Its files are missing or do not hold what they should.
        """
        if kind not in self.records:
            self.records[kind] = kind.read(self.path)
        found: Record = self.records[kind]
        return found

    def entry(self, stage: str) -> StageEntry | None:
        """Return what the manifest says of a stage, None when it says nothing."""
        return None if self.manifest is None else self.manifest.stages.get(stage)

    def text(self, path: Path) -> str:
        """Return a file as it stands there.

        Raises
        ------
        InputError
            It is no text.
        """
        try:
            return path.read_text(encoding="utf-8")
        except ValueError as error:
            raise InputError(f"no text: {error}", path) from error

    def named(self, file: str) -> str:
        """Return a file as a report names it: from its own folder, or the name alone."""
        path = Path(file)
        return str(path.relative_to(self.path)) if path.is_relative_to(self.path) else path.name

    def figures(self, *figures: FigureDefinition[Any] | str) -> tuple[FigureBlock, ...]:
        """Return those of figures, or of stems of files, that it has; numbered ones in order."""
        place = self.path / "figures"
        found: list[FigureBlock] = []
        for figure in figures:
            stem, caption = (
                (figure, figure.replace("_", " "))
                if isinstance(figure, str)
                else (figure.key, figure.caption)
            )
            if (single := place / f"{stem}.svg").is_file():
                found.append(embedded(single, caption))
                continue
            endings = {path: path.stem[len(stem) + 1 :] for path in place.glob(f"{stem}_*.svg")}
            numbered = {path: int(text) for path, text in endings.items() if text.isdigit()}
            paths = sorted(numbered, key=lambda path: numbered[path])
            found += [embedded(path, f"{numbered[path]}. {caption}") for path in paths]
        return tuple(found)

    def other_figures(self, known: set[str]) -> tuple[FigureBlock, ...]:
        """Return the figures of the folder that are not among those shown already."""
        place = self.path / "figures"
        files = sorted(place.glob("*.svg")) if place.is_dir() else []
        return tuple(embedded(p, p.stem.replace("_", " ")) for p in files if p.stem not in known)


def embedded(path: Path, caption: str) -> FigureBlock:
    """Return a figure with its SVG inside."""
    text = base64.b64encode(path.read_bytes()).decode("ascii")
    return FigureBlock(path.stem, caption, f"data:image/svg+xml;base64,{text}")


def _refused(path: Path, message: str) -> InputError:
    allowed = (
        "a folder that `expdesign run`, design, export, simulate, noise, estimate, validate or "
        "montecarlo wrote"
    )
    return InputError(message, file=path, allowed=allowed)
