"""Figures of a Monte-Carlo study: bias, efficiency and coverage of the estimators."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from constraints.arrays import Array
from estimation.montecarlo.result import StatisticsRow
from results.figures.drawing import (
    figure_definition,
    legend_above,
    margin_text,
    parameter_axis,
    plain_decades,
    plain_ticks,
)
from results.style import BLACK, ESTIMATOR_LOOKS, FAINT, MUTED

Rows = Sequence[StatisticsRow]

_OTHER_LOOK = ESTIMATOR_LOOKS["ml"] | {"color": BLACK, "marker": "D"}
_WIDTH = 0.56


def _by_estimator(rows: Rows) -> dict[str, list[StatisticsRow]]:
    found: dict[str, list[StatisticsRow]] = {}
    for row in rows:
        found.setdefault(row.estimator, []).append(row)
    return found


def _parameters(rows: Rows) -> list[str]:
    return list(dict.fromkeys(row.parameter for row in rows))


def _points(axes: Axes, rows: Rows, estimator: str, values: Array, bars: Array) -> Any:
    """Draw one estimator's points, (m,), with their bars; return them for the legend.

    The bars are lengths below and above, (2, m), NaN where there is none.
    """
    groups, names = _by_estimator(rows), _parameters(rows)
    own = groups[estimator]
    place = np.array([names.index(row.parameter) for row in own], dtype=float)
    step = _WIDTH / max(len(groups) - 1, 1)
    shift = step * (list(groups).index(estimator) - (len(groups) - 1) / 2)
    return axes.errorbar(
        place + shift,
        values,
        yerr=np.nan_to_num(np.maximum(bars, 0.0)),
        capsize=0,
        label=f"{estimator.upper()} ({own[0].estimates})",
        **ESTIMATOR_LOOKS.get(estimator, _OTHER_LOOK),
    )


CLEAR = 3.5
"""Standard errors from which a bias is significant: chance exceeds them once in 2 000."""

_LINEAR_BIAS = 12.0


@figure_definition(
    "montecarlo_bias",
    "Mean error of every parameter over all repetitions with its standard error, in units "
    "of the Cramér–Rao bound; in brackets the number of estimates. Within the band, of 3.5 "
    "standard errors of an estimator that reaches the bound, a bias cannot be told from chance.",
    height=3.3,
)
def bias_figure(figure: Figure, rows: Rows) -> None:
    """Draw the bias with its standard error, and the band in which chance leaves it.

    The axis is linear near zero and logarithmic further out when biases are large.
    """
    band = CLEAR / np.sqrt(min(row.estimates for row in rows))
    axes = figure.subplots()
    handles = []
    largest = band
    for estimator, own in _by_estimator(rows).items():
        bias = np.array([row.bias / row.bound for row in own])
        error = np.array([row.bias_std_error / row.bound for row in own])
        largest = max(largest, float(np.nanmax(np.abs(bias) + np.nan_to_num(error))))
        handles.append(_points(axes, rows, estimator, bias, np.stack([error, error])))
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
    parameter_axis(axes, _parameters(rows), parted=True)
    axes.set(ylabel="Bias / Cramér–Rao bound", title="Bias")
    legend_above(axes, handles)


NOMINAL = 95.0
"""Nominal coverage of the intervals, %."""

_LINEAR_RATIO = 3.0


@figure_definition(
    "montecarlo_efficiency",
    "Above: root mean square error of every parameter relative to the Cramér–Rao bound; 1 "
    "cannot be improved. Below: how often the estimators' 95 % intervals hold the truth. Bars are "
    "95 % intervals of the numbers themselves; in brackets the number of estimates.",
    height=4.6,
)
def efficiency_figure(figure: Figure, rows: Rows) -> None:
    """Draw two panels over the parameters, every point with its 95 % interval."""
    above, below = figure.subplots(2, 1, sharex=True)
    handles = []
    for estimator, own in _by_estimator(rows).items():
        ratio, cover = _interval(own, "rmse_over_bound"), 100 * _interval(own, "coverage")
        handles.append(_points(above, rows, estimator, ratio[:, 0], _bars(ratio)))
        _points(below, rows, estimator, cover[:, 0], _bars(cover))
    for axes, target, label in ((above, 1.0, ""), (below, NOMINAL, "Parameter")):
        axes.axhline(target, color=MUTED, linewidth=1.0, zorder=2)
        parameter_axis(axes, _parameters(rows), label, parted=True)
    ratios = _interval(rows, "rmse_over_bound")
    if np.max(ratios[np.isfinite(ratios)], initial=0.0) >= _LINEAR_RATIO:
        above.set_yscale("log")
        plain_decades(above.yaxis)
    above.set(ylabel="RMSE / Cramér–Rao bound", title="Efficiency")
    legend_above(above, handles)
    below.set_ylim(top=101.0)
    below.set_ylabel("Intervals that hold the truth (%)")
    below.set_title(f"Coverage of the {NOMINAL:g} % intervals")


def _interval(rows: Rows, key: str) -> Array:
    """Return a number with the lower and upper end of its 95 % interval, (m, 3)."""
    return np.array([[getattr(row, key + end) for end in ("", "_low", "_high")] for row in rows])


def _bars(values: Array) -> Array:
    return np.stack([values[:, 0] - values[:, 1], values[:, 2] - values[:, 0]])


STUDY_FIGURES = (bias_figure, efficiency_figure)
"""In the order of a report."""
