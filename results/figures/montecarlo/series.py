"""Estimators side by side over the parameters: places, colours and marks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from constraints.arrays import Array
from estimation.montecarlo.record import StatisticsRow
from results.style import BLACK, ESTIMATOR_LOOKS
from results.symbols import symbol


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


def parameter_axis(axes: Axes, series: Series) -> None:
    """Put the parameters on the horizontal axis, a faint line between each two."""
    names = all_parameters(series)
    axes.set_xticks(np.arange(len(names)), [symbol(name) for name in names])
    axes.set_xticks(np.arange(len(names) - 1) + 0.5, minor=True)
    axes.tick_params(axis="x", which="both", length=0)
    axes.grid(visible=False, axis="x")
    axes.grid(visible=True, axis="x", which="minor")
    axes.set_xlim(-0.6, len(names) - 0.4)


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
