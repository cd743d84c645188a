"""Figures of a view as files of its run folder, and embedded in a page."""

from __future__ import annotations

import base64
from collections.abc import Collection, Iterable
from pathlib import Path

from expdesign.experiment import DesignResult
from expdesign.robot import Robot
from expdesign.workers import run_in_copies
from results.figures.drawing import FORMATS, save_figures
from results.figures.machine import machine_figure
from results.views.design import design_view
from results.views.folder import RunFolder
from results.views.view import Block, Drawing, EmbeddedFigure, StageView

FIGURES = "figures"
"""Folder of the figures in a run folder."""


def draw_figures(
    view: StageView,
    folder: Path,
    formats: Collection[str] = FORMATS,
    *,
    missing: bool = False,
    workers: int = 1,
) -> tuple[Path, ...]:
    """Draw the figures of a view into ``figures/`` of its run folder; return the files.

    With `missing` only those without a file in one of the formats are drawn, and those that are
    renewed for every report. The same result gives the same bytes, in any number of
    processes.
    """
    place = folder / FIGURES
    wanted = [(drawing, formats) for drawing in view.drawings]
    if missing:
        wanted = [
            (drawing, formats if drawing.renewed else _missing_formats(drawing, place, formats))
            for drawing in view.drawings
        ]
    wanted = [(drawing, endings) for drawing, endings in wanted if endings]

    def draw(share: int) -> list[tuple[Path, ...]]:
        return [
            save_figures((drawing.definition,), drawing.source, place, view.figure_note, endings)
            for drawing, endings in wanted[share::processes]
        ]

    processes = max(1, min(workers, len(wanted)))
    drawn: list[tuple[Path, ...]] = [()] * len(wanted)
    for share, paths in enumerate(run_in_copies(draw, processes)):
        drawn[share::processes] = paths
    return tuple(path for paths in drawn for path in paths)


def design_figures(
    result: DesignResult, folder: Path, formats: Collection[str] | None = None
) -> tuple[Path, ...]:
    """Draw the figures of a design into ``figures/`` of its run folder; return the files.

    The result is ``DesignResult.read(folder)``; the formats, of
    "png", "svg" and "pdf", are those of `report.figures` of its run by default.
    """
    configuration = result.configuration
    place = RunFolder(folder, {}, configuration, results={DesignResult: result}, brief=True)
    wanted = configuration.run.report.figures if formats is None else formats
    return draw_figures(design_view(place), folder, wanted)


def draw_machine(
    robot: Robot, folder: Path, formats: Collection[str] = FORMATS
) -> tuple[Path, ...]:
    """Draw a robot at home into ``figures/`` of a run folder; return the files."""
    return save_figures((machine_figure,), robot, folder / FIGURES, formats=formats)


def embedded_format(formats: Collection[str]) -> str:
    """Return the format of the figures in a page: SVG, or PNG where that is wanted alone."""
    return "png" if "png" in formats and "svg" not in formats else "svg"


def embed_drawings(blocks: Iterable[Block], folder: Path, ending: str = "svg") -> tuple[Block, ...]:
    """Return blocks with the folder's files for the drawings; one without a file is left out."""
    found: list[Block] = []
    for block in blocks:
        if not isinstance(block, Drawing):
            found.append(block)
        elif (file := folder / FIGURES / f"{block.definition.key}.{ending}").is_file():
            found.append(embed_figure(file, block.caption))
    return tuple(found)


def other_figures(
    folder: Path, known: Collection[str], ending: str = "svg"
) -> tuple[EmbeddedFigure, ...]:
    """Return the figures of a folder whose keys are not among the known ones."""
    files = sorted((folder / FIGURES).glob(f"*.{ending}"))
    return tuple(embed_figure(p, p.stem.replace("_", " ")) for p in files if p.stem not in known)


def embed_figure(path: Path, caption: str) -> EmbeddedFigure:
    """Return a figure with its SVG or PNG inside."""
    text, ending = base64.b64encode(path.read_bytes()).decode("ascii"), path.suffix[1:]
    kind = "image/svg+xml" if ending == "svg" else f"image/{ending}"
    return EmbeddedFigure(path.stem, caption, f"data:{kind};base64,{text}", ending)


def _missing_formats(drawing: Drawing, place: Path, formats: Collection[str]) -> list[str]:
    key = drawing.definition.key
    return [ending for ending in formats if not (place / f"{key}.{ending}").is_file()]
