"""How every figure looks: one style sheet, one palette, figures without any global state."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

PAGE_WIDTH = 7.0
"""Width of a figure over both columns of a paper, inches."""
RESOLUTION = 200
"""Of the PNG files, dots per inch."""

# Okabe and Ito (2008), "Color Universal Design": told apart with every common colour blindness.
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
    "axes.unicode_minus": True,
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
    "mathtext.fontset": "dejavusans",
    "figure.facecolor": "white",
    "figure.constrained_layout.w_pad": 0.05,
    "figure.constrained_layout.wspace": 0.03,
    "savefig.facecolor": "white",
    "savefig.dpi": RESOLUTION,
    # Text as paths looks the same without the font; a fixed salt gives the same ids every time.
    "svg.fonttype": "path",
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
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure
