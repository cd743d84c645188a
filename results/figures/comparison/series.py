"""What the figures of a comparison are drawn from: several folders, parameter by parameter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from constraints.arrays import Array
from results.style import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION
from results.symbols import symbol

COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)
MARKERS = ("o", "s", "^", "D", "v", "P")


@dataclass(frozen=True, eq=False)
class Series:
    """Values of one folder.

    Attributes
    ----------
    label : str
    values : (m,)
        NaN where there is none.
    error : (m,) or None
        Half-width of the interval of each.
    """

    label: str
    values: Array
    error: Array | None = None


@dataclass(frozen=True, eq=False)
class ParameterSeries:
    """Several folders side by side.

    Attributes
    ----------
    names : tuple of str
        Parameters.
    series : tuple of Series
    """

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
    axes.set_xticks(places, [symbol(name) for name in record.names])
    axes.set_xlim(-0.6, len(record.names) - 0.4)
    axes.set_xlabel("Parameter")
