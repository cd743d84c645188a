"""Figures as files: PNG, SVG and PDF; the same bytes for the same record."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path

from matplotlib.figure import Figure

from expdesign.runfolder.atomic import written_beside
from results.figures.definition import FigureDefinition, Record
from results.style import ALERT, RESOLUTION, house_style

# Neither dates nor versions: a figure changes when what it shows does.
_METADATA: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}

FORMATS = ("png", "svg")
"""What is written when nothing else is asked for."""


def save_figures(
    definitions: Iterable[FigureDefinition[Record]],
    record: Record,
    folder: Path,
    note: str = "",
    formats: Collection[str] = FORMATS,
) -> tuple[Path, ...]:
    """Draw figures and write each in the formats wanted.

    Parameters
    ----------
    definitions : iterable of FigureDefinition
    record : object
        What they are drawn from.
    folder : Path
        Made when it is missing. Every file is complete or absent.
    note : str
        What has to be known of every one of them; it stands below.
    formats : collection of {"png", "svg", "pdf"}
        SVG is written whatever they are: reports show it.

    Returns
    -------
    tuple of Path
        The files, in the order of the definitions.
    """
    paths = []
    for definition in definitions:
        with house_style():
            figure = definition.draw(record)
            if note:
                figure.supxlabel(note, x=0.99, ha="right", fontsize="medium", color=ALERT)
            _lay_out(figure)
            for ending, metadata in _METADATA.items():
                if ending not in formats and ending != "svg":
                    continue
                path = folder / f"{definition.key}.{ending}"
                with written_beside(path) as beside:
                    figure.savefig(beside, format=ending, dpi=RESOLUTION, metadata=metadata)
                paths.append(path)
    return tuple(paths)


def _lay_out(figure: Figure) -> None:
    """Lay a figure out once: all its files look alike, whichever of them are written.

    At the resolution of the files: texts are not equally wide at every one.
    """
    figure.set_dpi(RESOLUTION)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        # Not "none": Matplotlib draws a figure twice for each file as long as it has any engine.
        figure.set_layout_engine(None)
