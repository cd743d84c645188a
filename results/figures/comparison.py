"""The figures of a comparison: what several folders say of every parameter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from constraints.arrays import Array
from results.figures.drawing import FigureDefinition, parameter_axis
from results.style import BLUE, GREEN, MUTED, ORANGE, PURPLE, SKY, VERMILLION, new_figure

COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)
MARKERS = ("o", "s", "^", "D", "v", "P")


@dataclass(frozen=True, eq=False)
class Series:
    """Values of one folder, (m,), NaN where there is none; `error`: half-widths of intervals."""

    label: str
    values: Array
    error: Array | None = None


@dataclass(frozen=True, eq=False)
class ParameterSeries:
    """Several folders side by side; `names` are the parameters."""

    names: tuple[str, ...]
    series: tuple[Series, ...]


def draw_series(axes: Axes, record: ParameterSeries) -> None:
    """Draw a mark for each folder beside each other over every parameter."""
    count = len(record.series)
    step = min(0.18, 0.7 / max(count, 1))
    places = np.arange(len(record.names))
    for number, series in enumerate(record.series):
        axes.errorbar(
            places + step * (number - (count - 1) / 2),
            series.values,
            yerr=series.error,
            color=COLOURS[number % len(COLOURS)],
            marker=MARKERS[number // len(COLOURS) % len(MARKERS)],
            markersize=3.6,
            linestyle="none",
            elinewidth=1.0,
            # A name that begins with an underscore would be left out of the legend.
            label=f"\u200b{series.label}",
        )
    parameter_axis(axes, record.names)
    axes.set_xlabel("Parameter")


def draw_precision(record: ParameterSeries) -> Figure:
    """Draw one mark per design over every parameter, logarithmic."""
    figure = new_figure(2.9)
    axes = figure.add_subplot()
    draw_series(axes, record)
    axes.set_yscale("log")
    axes.set_ylabel("Predicted σ / nominal value (%)")
    figure.legend(loc="outside upper right", ncols=4)
    return figure


PRECISION = FigureDefinition(
    key="compared_precision",
    caption="Predicted standard deviation of every parameter relative to its nominal value, for "
    "the same measuring time and sampling rate.",
    draw=draw_precision,
)


def draw_estimates(record: ParameterSeries) -> Figure:
    """Draw the deviation of every estimate from the first folder's, in units of its σ."""
    figure = new_figure(2.9)
    axes = figure.add_subplot()
    axes.axhline(0.0, color=MUTED, linewidth=0.8)
    draw_series(axes, record)
    axes.set_ylabel("Deviation from the first (σ)")
    figure.legend(loc="outside upper right", ncols=4)
    return figure


ESTIMATES = FigureDefinition(
    key="compared_estimates",
    caption="Deviation of every estimate from that of the first folder, in units of the first's "
    "standard deviation, with 95 % intervals.",
    draw=draw_estimates,
)
