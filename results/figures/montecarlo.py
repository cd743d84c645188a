"""Figures of a Monte-Carlo study: bias, efficiency and coverage of the estimators."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from constraints.arrays import Array
from estimation.montecarlo.record import StatisticsRow
from results.figures.drawing import (
    FigureDefinition,
    legend_above,
    margin_text,
    parameter_axis,
    plain_decades,
    plain_ticks,
)
from results.style import BLACK, ESTIMATOR_LOOKS, FAINT, MUTED, new_figure


@dataclass(frozen=True, eq=False)
class EstimatorSeries:
    """One estimator over all repetitions.

    Attributes
    ----------
    estimator : str
        ``"ls"``, ``"gm"`` or ``"ml"``.
    label : str
        Its name in legends.
    estimates : int
        Repetitions that it is judged by.
    parameters : tuple of str
    bias, bias_std_error : (m,)
        In units of the Cramér–Rao bound.
    rmse, coverage : (m, 3)
        RMSE in units of the bound; share of the intervals that hold the truth. Value, lower and
        upper end of its 95 % interval.
    """

    estimator: str
    label: str
    estimates: int
    parameters: tuple[str, ...]
    bias: Array
    bias_std_error: Array
    rmse: Array
    coverage: Array


Series = Sequence[EstimatorSeries]


def study_series(rows: Sequence[StatisticsRow]) -> tuple[EstimatorSeries, ...]:
    """Return the estimators of a study in their order."""
    found = []
    for estimator in dict.fromkeys(row.estimator for row in rows):
        own = [row for row in rows if row.estimator == estimator]
        ratio = [(r.rmse_over_bound, r.rmse_over_bound_low, r.rmse_over_bound_high) for r in own]
        found.append(
            EstimatorSeries(
                estimator,
                estimator.upper(),
                own[0].estimates,
                tuple(row.parameter for row in own),
                np.array([row.bias / row.bound for row in own]),
                np.array([row.bias_std_error / row.bound for row in own]),
                np.array(ratio),
                np.array([(r.coverage, r.coverage_low, r.coverage_high) for r in own]),
            )
        )
    return tuple(found)


_OTHER_LOOK = {"color": BLACK, "marker": "D"}
_WIDTH = 0.56


def all_parameters(series: Series) -> tuple[str, ...]:
    """Return the parameters of all estimators in their order."""
    return tuple(dict.fromkeys(name for one in series for name in one.parameters))


def points(axes: Axes, series: Series, number: int, values: Array, bars: Array) -> Any:
    """Draw one estimator's points with their bars; return them for the legend.

    Parameters
    ----------
    number : int
        Place of the estimator in `series`.
    values : (m,)
    bars : (2, m)
        Lengths below and above; NaN where there is none.
    """
    one = series[number]
    names = all_parameters(series)
    place = np.array([names.index(name) for name in one.parameters], dtype=float)
    step = _WIDTH / max(len(series) - 1, 1)
    shift = step * (number - (len(series) - 1) / 2)
    return axes.errorbar(
        place + shift,
        values,
        yerr=np.nan_to_num(np.maximum(bars, 0.0)),
        **ESTIMATOR_LOOKS.get(one.estimator, _OTHER_LOOK),
        linestyle="none",
        markersize=3.2,
        elinewidth=0.9,
        capsize=0,
        label=f"{one.label} ({one.estimates})",
        zorder=3,
    )


CLEAR = 3.5
"""Standard errors from which on a bias is no chance: one in 2 000."""

_LINEAR_BIAS = 12.0


def draw_bias(series: Series) -> Figure:
    """Draw the bias with its standard error, and the band in which chance leaves it.

    The axis is linear near zero and logarithmic further out when biases are large.
    """
    band = CLEAR / np.sqrt(min(one.estimates for one in series))
    figure = new_figure(3.3)
    axes = figure.subplots()
    handles = []
    largest = band
    for number, one in enumerate(series):
        bias, error = one.bias, one.bias_std_error
        largest = max(largest, float(np.nanmax(np.abs(bias) + np.nan_to_num(error))))
        handles.append(points(axes, series, number, bias, np.stack([error, error])))
    axes.axhspan(-band, band, color=FAINT, alpha=0.35, linewidth=0, zorder=1)
    axes.axhline(0.0, color=MUTED, linewidth=0.8, zorder=2)
    room = 1.25
    if largest > _LINEAR_BIAS * band:
        room = 2.0
        axes.set_yscale("symlog", linthresh=2 * band, linscale=0.8)
        axes.yaxis.set_major_formatter(plain_ticks())
        decades = 10.0 ** np.arange(np.ceil(np.log10(2 * band)), np.ceil(np.log10(room * largest)))
        axes.set_yticks([*-decades[::-1], 0.0, *decades])
    axes.set_ylim(-room * largest, room * largest)
    margin_text(axes, 0.0, f"±{CLEAR:g} standard\nerrors at\nthe bound", MUTED)
    parameter_axis(axes, all_parameters(series), parted=True)
    axes.set_xlabel("Parameter")
    axes.set_ylabel("Bias / Cramér–Rao bound")
    axes.set_title("Bias")
    legend_above(axes, handles)
    return figure


BIAS = FigureDefinition(
    key="montecarlo_bias",
    caption="Mean error of every parameter over all repetitions with its standard error, in units "
    "of the Cramér–Rao bound; in brackets the number of estimates. Within the band, of 3.5 "
    "standard errors of an estimator that reaches the bound, a bias cannot be told from chance.",
    draw=draw_bias,
)


NOMINAL = 95.0
"""What the intervals should cover, %."""

_LINEAR_RATIO = 3.0


def draw_efficiency(series: Series) -> Figure:
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
        parameter_axis(axes, all_parameters(series), parted=True)
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
    if not len(known) or np.max(known) < _LINEAR_RATIO:
        return
    axes.set_yscale("log")
    plain_decades(axes.yaxis)


EFFICIENCY = FigureDefinition(
    key="montecarlo_efficiency",
    caption="Above: root mean square error of every parameter relative to the Cramér–Rao bound; 1 "
    "cannot be improved. Below: how often the estimators' 95 % intervals hold the truth. Bars are "
    "95 % intervals of the numbers themselves; in brackets the number of estimates.",
    draw=draw_efficiency,
)

STUDY_FIGURES: tuple[FigureDefinition[Series], ...] = (BIAS, EFFICIENCY)
"""In the order of a report."""
