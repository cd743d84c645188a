"""RMSE relative to the bound, and coverage of the stated intervals, of every parameter."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from constraints.arrays import Array
from results.figures.definition import FigureDefinition
from results.figures.legends import legend_above
from results.figures.montecarlo.series import Series, parameter_axis, points
from results.style import MUTED, new_figure

NOMINAL = 95.0
"""What the intervals should cover, %."""

_LINEAR_REACH = 3.0


def draw(series: Series) -> Figure:
    """Draw two panels over the parameters, every point with its 95 % interval."""
    figure = new_figure(4.6)
    above, below = figure.subplots(2, 1, sharex=True)
    handles = []
    for number, one in enumerate(series):
        ratio, cover = one.rmse, 100 * one.coverage
        handles.append(points(above, series, number, ratio[:, 0], _bars(ratio)))
        points(below, series, number, cover[:, 0], _bars(cover))
    for axes, target in ((above, 1.0), (below, NOMINAL)):
        axes.axhline(target, color=MUTED, linewidth=1.0, zorder=2)
        parameter_axis(axes, series)
    _ratio_scale(above, np.concatenate([one.rmse.ravel() for one in series]))
    above.set_ylabel("RMSE / Cramér–Rao bound")
    above.set_title("Efficiency")
    legend_above(above, handles)
    below.set_ylim(top=101.0)
    below.set_ylabel("Intervals that hold the truth (%)")
    below.set_title(f"Coverage of the {NOMINAL:g} % intervals")
    below.set_xlabel("Parameter")
    return figure


def _bars(values: Array) -> Array:
    return np.stack([values[:, 0] - values[:, 1], values[:, 2] - values[:, 0]])


def _ratio_scale(axes: Axes, ratios: Array) -> None:
    """Make the axis logarithmic when the ratios differ much."""
    known = ratios[np.isfinite(ratios) & (ratios > 0)]
    if not len(known) or np.max(known) < _LINEAR_REACH:
        return
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


FIGURE = FigureDefinition(
    key="montecarlo_efficiency",
    caption="Above: root mean square error of every parameter relative to the Cramér–Rao bound; 1 "
    "cannot be improved. Below: how often the estimators' 95 % intervals hold the truth. Bars are "
    "95 % intervals of the numbers themselves; in brackets the number of estimates.",
    draw=draw,
)
