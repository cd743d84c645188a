"""Style and definition of figures, their files, and parts that several figures share."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any, Generic, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.container import Container
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Annotation
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from constraints.arrays import Array
from expdesign.progress import track
from expdesign.runfolder.files import atomic_write
from results.notation import symbol

PAGE_WIDTH = 7.0
"""Width of a figure over both columns of a paper, inches."""
RESOLUTION = 200
"""Of the PNG files, dots per inch."""
# Okabe and Ito (2008), "Color Universal Design": distinct with every common colour blindness.
BLACK = "#000000"
BLUE = "#0072b2"
VERMILLION = "#d55e00"
GREEN = "#009e73"
PURPLE = "#cc79a7"
ORANGE = "#e69f00"
SKY = "#56b4e9"
PALETTE = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)
STRUT_COLOURS = PALETTE
"""Strut 1 … 6, in every figure."""
AXIS_COLOURS = ("#004488", "#bb5566", "#ddaa33")
"""x, y, z and φ, θ, ψ: Tol's high-contrast scheme, which keeps its order in grey."""
AXIS_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (4, 1.2, 1, 1.2)))
_POINTS = {"linestyle": "none", "markersize": 3.2, "elinewidth": 0.9, "zorder": 3}
ESTIMATOR_LOOKS: dict[str, dict[str, Any]] = {
    "ls": {"color": VERMILLION, "marker": "s", **_POINTS},
    "gm": {"color": GREEN, "marker": "^", **_POINTS},
    "ml": {"color": BLUE, "marker": "o", **_POINTS},
}
"""Points of each estimator, in every figure: to be handed on to `errorbar`."""
EMPHASIS = BLUE
SECOND = SKY
ALERT = VERMILLION
INK = "#222222"
MUTED = "#6b6b6b"
FAINT = "#b8b8b8"
GREY = "#8f8f8f"
FORBIDDEN: dict[str, Any] = {
    "facecolor": "#f4f4f4",
    "edgecolor": "#cfcfcf",
    "hatch": "/////",
    "linewidth": 0.0,
}
"""Area beyond a limit."""
STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # ships with Matplotlib: the same letters everywhere
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 8.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": MUTED,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "text.color": INK,
    "lines.linewidth": 1.1,
    "lines.solid_capstyle": "round",
    "hatch.linewidth": 0.5,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "legend.handlelength": 1.8,
    "legend.columnspacing": 1.4,
    "legend.borderaxespad": 0.2,
    "figure.constrained_layout.w_pad": 0.05,
    "figure.constrained_layout.wspace": 0.03,
    "savefig.facecolor": "white",
    "savefig.dpi": RESOLUTION,
    # A fixed salt gives the same ids every time.
    "svg.hashsalt": "expdesign",
    "pdf.fonttype": 42,  # TrueType: letters that can be selected, and that publishers take
}


@contextmanager
def house_style() -> Iterator[None]:
    """Draw and save in the project's style, whatever the user's own settings are."""
    settings: dict[Any, Any] = {
        key: mpl.rcParamsDefault[key]
        for key in mpl.rcParamsDefault
        if not key.startswith(("backend", "interactive", "toolbar"))
    }
    with mpl.rc_context(settings | STYLE):
        yield


def new_figure(height: float, width: float = PAGE_WIDTH) -> Figure:
    """Return an empty figure on its own canvas; sizes in inches."""
    figure = NotebookFigure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


class NotebookFigure(Figure):
    """A figure that a notebook shows without pyplot."""

    def _repr_png_(self) -> bytes:
        image = BytesIO()
        with house_style():
            self.savefig(image, format="png")
        return image.getvalue()


Source = TypeVar("Source", contravariant=True)  # noqa: PLC0105 - the word is the reader's


@dataclass(frozen=True)
class FigureDefinition(Generic[Source]):
    """A figure of a kind of result: name of its files without the ending, caption for reports.

    `fill` draws a result into an empty figure of this size, in inches; it computes nothing but what
    is shown, and saves nothing. `seen` says in a sentence what the figure of a result shows.
    """

    key: str
    caption: str
    fill: Callable[[Figure, Source], None]
    height: float
    width: float = PAGE_WIDTH
    seen: Callable[[Source], str] | None = None

    def draw(self, result: Source) -> Figure:
        """Return the figure of a result."""
        with house_style():
            figure = new_figure(self.height, self.width)
            self.fill(figure, result)
        return figure

    def ending(self, text: str) -> FigureDefinition[Source]:
        """Return the same figure for another file, whose name has this ending."""
        return replace(self, key=self.key + text)


def figure_definition(
    key: str, caption: str, **others: Any
) -> Callable[[Callable[[Figure, Source], None]], FigureDefinition[Source]]:
    """Return a decorator that makes a figure of the function that fills it."""
    return lambda fill: FigureDefinition(key, caption, fill, **others)


# Neither dates nor versions: a figure changes only with its content.
_METADATA: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
FORMATS = ("png", "svg")
"""Default formats."""
_MANY_NAMES, _NAME, _SMALLEST_NAME = 32, 7.5, 4.0
"""Names that fit side by side; their size in points, and that of ever so many."""


def save_figures(
    definitions: Iterable[FigureDefinition[Source]],
    result: Source,
    folder: Path,
    note: str = "",
    formats: Collection[str] = FORMATS,
) -> tuple[Path, ...]:
    """Draw figures of a result and write each in the formats wanted; return the files.

    The folder is made when it is missing, and every file is complete or absent. A note stands below
    every figure. Formats are "png", "svg" and "pdf".
    """
    paths = []
    for definition in track("drawing figures", tuple(definitions)):
        with house_style():
            figure = definition.draw(result)
            if note:
                figure.supxlabel(note, x=0.99, ha="right", fontsize="medium", color=ALERT)
            _lay_out(figure)
            for ending, metadata in _METADATA.items():
                if ending not in formats:
                    continue
                path = folder / f"{definition.key}.{ending}"
                with atomic_write(path) as file:
                    figure.savefig(file, format=ending, dpi=RESOLUTION, metadata=metadata)
                paths.append(path)
    return tuple(paths)


def _lay_out(figure: Figure) -> None:
    """Lay a figure out once, so that all its files look alike.

    At the resolution of the files: texts are not equally wide at every one.
    """
    figure.set_dpi(RESOLUTION)
    engine = figure.get_layout_engine()
    if engine is not None:
        engine.execute(figure)
        # Not "none": Matplotlib draws a figure twice for each file as long as it has any engine.
        figure.set_layout_engine(None)


def add_strut_legend(figure: Figure) -> None:
    """Name the six strut colours above all panels."""
    handles = [
        Line2D([], [], color=colour, linewidth=2.0, label=f"strut {j}")
        for j, colour in enumerate(STRUT_COLOURS, 1)
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))


def add_legend_above(axes: Axes, handles: Sequence[Artist | Container]) -> None:
    """Put a panel's legend on its upper edge, at the right end of the title's line."""
    axes.legend(
        handles=list(handles),
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=max(1, len(handles)),
        borderaxespad=0.25,
    )


def label_figure(figure: Figure, x: str, y: str) -> None:
    """Name the axes that all panels share."""
    figure.supxlabel(x, fontsize="medium")
    figure.supylabel(y, fontsize="medium")


def strut_panels(
    figure: Figure, title: str, shape: tuple[int, int] = (2, 3), *, share: bool
) -> tuple[Axes, ...]:
    """Return the panels of struts 1 … 6, titled; `share`: with common axes."""
    panels = figure.subplots(*shape, sharex=share, sharey=share, squeeze=False)
    for number, axes in enumerate(panels.flat, 1):
        axes.set_title(f"{title} {number}")
    return tuple(panels.flat)


def write_corner(axes: Axes, text: str) -> None:
    """Write small text into the upper right corner."""
    axes.text(
        0.985,
        0.97,
        text,
        transform=axes.transAxes,
        ha="right",
        va="top",
        fontsize="small",
        color=MUTED,
        linespacing=1.25,
    )


def name_places(axes: Axes, names: Sequence[str]) -> None:
    """Name the places 0, 1, … of the horizontal axis."""
    axes.set_xticks(np.arange(len(names)), names)
    axes.tick_params(axis="x", which="both", length=0)
    _shrink_names(axes, len(names))
    axes.grid(visible=False, axis="x")


def _shrink_names(axes: Axes, count: int, *, both: bool = False) -> None:
    if count > _MANY_NAMES:
        axes.tick_params(axis="x", labelrotation=90)
        size = max(_SMALLEST_NAME, _MANY_NAMES / count * _NAME)
        axes.tick_params(axis="both" if both else "x", labelsize=size)


def set_parameter_axis(
    axes: Axes, names: Sequence[str], label: str = "Parameter", *, parted: bool = False
) -> None:
    """Put parameters on the horizontal axis, from 0; `parted`: a faint line between each two."""
    name_places(axes, [symbol(name) for name in names])
    axes.set_xlabel(label)
    if parted:
        axes.set_xticks(np.arange(len(names) - 1) + 0.5, minor=True)
        axes.grid(visible=True, axis="x", which="minor")
    axes.set_xlim(-0.6, len(names) - 0.4)


def label_decades(axis: Axis) -> None:
    """Label a logarithmic axis with plain numbers: 0.5, 1, 2, 5, 10."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(plain_ticks())
    axis.set_minor_formatter(NullFormatter())


def plain_ticks() -> FuncFormatter:
    """Return a formatter of numbers without powers of ten, with a true minus sign."""
    return FuncFormatter(lambda value, _: f"{value:g}".replace("-", "−"))


def write_centred(axes: Axes, text: str, height: float = 0.5, **look: Any) -> None:
    """Write text into the middle of axes that have nothing to show."""
    axes.text(0.5, height, text, transform=axes.transAxes, ha="center", **look)


def write_margin(axes: Axes, y: float, text: str, colour: str, offset: float = 4) -> None:
    """Write small text right of the axes: `offset` points from them, y in units of the data."""
    place = {"xycoords": ("axes fraction", "data"), "va": "center", "annotation_clip": False}
    write_small(axes, text, (1.0, y), (offset, 0), color=colour, **place)


def write_small(
    axes: Axes, text: str, at: tuple[float, float], offset: tuple[float, float], **look: Any
) -> Annotation:
    """Write small text at a place, in the coordinates `xycoords`, with an offset in points."""
    look = {"fontsize": "small", "textcoords": "offset points", **look}
    return axes.annotate(text, at, xytext=offset, **look)


def write_upright(axes: Axes, places: Iterable[float], text: str) -> None:
    """Write small text upright from the lower edge, where there is nothing to draw."""
    for place in places:
        axes.text(
            place,
            0.03,
            text,
            transform=axes.get_xaxis_transform(),
            rotation=90,
            ha="center",
            va="bottom",
            color=MUTED,
            fontsize="small",
        )


def draw_correlation(axes: Axes, matrix: Array, names: Sequence[str], colours: Any) -> None:
    """Draw a correlation matrix with the names of its rows, and the scale of its colours."""
    image = axes.imshow(matrix, cmap=colours, vmin=-1, vmax=1, interpolation="nearest")
    axes.set_xticks(range(len(names)), names)
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(length=0)
    _shrink_names(axes, len(names), both=True)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    bar = axes.figure.colorbar(image, ax=axes, shrink=0.85, ticks=[-1, -0.5, 0, 0.5, 1])
    bar.outline.set_visible(False)
