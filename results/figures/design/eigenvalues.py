"""Eigenvalues of the scaled information matrix."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from constraints.arrays import Array
from expdesign.experiment import DesignRecord
from results.figures.drawing import FigureDefinition
from results.style import ALERT, EMPHASIS, MUTED, new_figure

_HEADROOM = 0.2
"""Free above the largest eigenvalue, for the text there, as a share of the decades shown."""
_MANY = 4
"""Digits before the point from which on a number is written with a power of ten."""


def draw(record: DesignRecord) -> Figure:
    """Draw one panel per scaling, eigenvalues ascending over their index."""
    figure = new_figure(2.9)
    panels = {
        "Columns scaled to unit length": [value.unit_diagonal for value in record.eigenvalues],
        "Columns scaled by nominal values": [value.nominal for value in record.eigenvalues],
    }
    for axes, (title, values) in zip(figure.subplots(1, 2), panels.items(), strict=True):
        axes.set_title(title)
        axes.set_xlabel("Index of the eigenvalue")
        axes.set_ylabel("Eigenvalue of scaled $F$ (dimensionless)")
        _stems(axes, np.array(values))
    return figure


def _stems(axes: Axes, values: Array) -> None:
    index = np.arange(1, values.size + 1)
    positive = values > 0
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0.2, values.size + 0.8)
    axes.grid(visible=False, axis="x")
    if not np.any(positive):
        axes.text(0.5, 0.5, "no eigenvalue is positive", transform=axes.transAxes, ha="center")
        return
    low, high = float(np.min(values[positive])), float(np.max(values[positive]))
    decades = max(np.log10(high / low), 1.0)
    floor = low / 10 ** (0.08 * decades)
    axes.set_ylim(floor, high * 10 ** (_HEADROOM * decades))
    axes.vlines(index[positive], floor, values[positive], color=EMPHASIS, linewidth=1.1)
    axes.plot(
        index[positive], values[positive], "o", color=EMPHASIS, markersize=3.4, label="eigenvalues"
    )
    if np.all(positive):
        text = f"condition number {_power(high / low)}"
    else:
        text = f"{np.count_nonzero(~positive)} not positive: singular to working precision"
        lost = index[~positive]
        axes.plot(
            lost, np.full(lost.size, floor), "x", color=ALERT, markersize=5, clip_on=False, zorder=4
        )
    axes.annotate(
        text,
        (0.02, 0.975),
        xycoords="axes fraction",
        va="top",
        color=MUTED,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )


def _power(value: float) -> str:
    exponent = int(np.floor(np.log10(value)))
    if exponent < _MANY:
        return f"{float(f'{value:.3g}'):g}"
    return rf"${value / 10.0**exponent:.1f} \times 10^{{{exponent}}}$"


FIGURE = FigureDefinition(
    key="eigenvalues",
    caption="Eigenvalues of the scaled Fisher information matrix over one period, with their "
    "condition number.",
    draw=draw,
)
