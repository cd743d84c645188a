"""Predicted standard deviations of several designs, for the same measuring time."""

from __future__ import annotations

from matplotlib.figure import Figure

from results.figures.comparison.series import ParameterSeries, draw_series
from results.figures.definition import FigureDefinition
from results.style import new_figure


def draw(record: ParameterSeries) -> Figure:
    """Draw one mark per design over every parameter, logarithmic."""
    figure = new_figure(2.9)
    axes = figure.add_subplot()
    draw_series(axes, record)
    axes.set_yscale("log")
    axes.set_ylabel("Predicted σ / nominal value (%)")
    figure.legend(loc="outside upper right", ncols=4)
    return figure


FIGURE = FigureDefinition(
    key="compared_precision",
    caption="Predicted standard deviation of every parameter relative to its nominal value, for "
    "the same measuring time and sampling rate.",
    draw=draw,
)
