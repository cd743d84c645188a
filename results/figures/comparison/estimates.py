"""Estimates of several folders with their intervals."""

from __future__ import annotations

from matplotlib.figure import Figure

from results.figures.comparison.series import ParameterSeries, draw_series
from results.figures.definition import FigureDefinition
from results.style import MUTED, new_figure


def draw(record: ParameterSeries) -> Figure:
    """Draw the deviation of every estimate from the first folder's, in units of its σ."""
    figure = new_figure(2.9)
    axes = figure.add_subplot()
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    draw_series(axes, record)
    axes.set_ylabel("Deviation from the first (σ)")
    figure.legend(loc="outside upper right", ncols=4)
    return figure


FIGURE = FigureDefinition(
    key="compared_estimates",
    caption="Deviation of every estimate from that of the first folder, in units of the first's "
    "standard deviation, with 95 % intervals.",
    draw=draw,
)
