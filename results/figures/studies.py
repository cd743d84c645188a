"""Figures of many runs: a Monte-Carlo study of the estimators, and the designs of a sweep."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from constraints.arrays import Array
from expdesign.configuration.several_runs import value_text
from expdesign.experiment.plan import PlanResult
from expdesign.experiment.sweep import SweepResult, point_label
from results.figures import drawing

if TYPE_CHECKING:  # as in `results.figures.parameters`
    from estimation.montecarlo.result import StatisticsRow

Rows = Sequence["StatisticsRow"]
_OTHER_LOOK = drawing.ESTIMATOR_LOOKS["ml"] | {"color": drawing.BLACK, "marker": "D"}
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
        **drawing.ESTIMATOR_LOOKS.get(estimator, _OTHER_LOOK),
    )


CLEAR = 3.5
"""Standard errors from which a bias is significant: chance exceeds them once in 2 000."""
_LINEAR_BIAS = 12.0


@drawing.figure_definition(
    "montecarlo_bias",
    "Mean error of every parameter over all repetitions with its standard error, in units "
    "of the Cramér–Rao bound; in brackets the number of estimates. Within the band, of 3.5 "
    "standard errors of an estimator that reaches the bound, a bias is not significant.",
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
    axes.axhspan(-band, band, color=drawing.FAINT, alpha=0.35, linewidth=0, zorder=1)
    axes.axhline(0.0, color=drawing.MUTED, linewidth=0.8, zorder=2)
    room = 1.25
    if largest > _LINEAR_BIAS * band:
        room = 2.0
        axes.set_yscale("symlog", linthresh=2 * band, linscale=0.8)
        axes.yaxis.set_major_formatter(drawing.plain_ticks())
        decades = 10.0 ** np.arange(np.ceil(np.log10(2 * band)), np.ceil(np.log10(room * largest)))
        axes.set_yticks([*-decades[::-1], 0.0, *decades])
    axes.set_ylim(-room * largest, room * largest)
    drawing.write_margin(axes, 0.0, f"±{CLEAR:g} standard\nerrors at\nthe bound", drawing.MUTED)
    drawing.set_parameter_axis(axes, _parameters(rows), parted=True)
    axes.set(ylabel="Bias / Cramér–Rao bound", title="Bias")
    drawing.add_legend_above(axes, handles)


NOMINAL = 95.0
"""Nominal coverage of the intervals, %."""
_LINEAR_RATIO = 3.0


@drawing.figure_definition(
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
        axes.axhline(target, color=drawing.MUTED, linewidth=1.0, zorder=2)
        drawing.set_parameter_axis(axes, _parameters(rows), label, parted=True)
    ratios = _interval(rows, "rmse_over_bound")
    if np.max(ratios[np.isfinite(ratios)], initial=0.0) >= _LINEAR_RATIO:
        above.set_yscale("log")
        drawing.label_decades(above.yaxis)
    above.set(ylabel="RMSE / Cramér–Rao bound", title="Efficiency")
    drawing.add_legend_above(above, handles)
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


_MOST_WORDS, _LONGEST_WORDS = 12, 16
"""So many designs at most are named by their values, and where no name is longer; others by their
numbers."""
_LOGARITHMIC = 8.0
"""Values that differ by more than this factor get a logarithmic axis."""
_AIR, _SHARE = 1.4, 0.15
"""Room around the designs: a factor of a logarithmic axis, a share of a linear one."""
_COSTS = {
    "measuring_time": "Measuring time of the experiment (s)",
    "cpu_seconds": "Processor time of the search (s)",
}
_PRECISIONS = {
    "median_rel_std_percent": "Median of the parameters",
    "worst_rel_std_percent": "Worst parameter",
}


@drawing.figure_definition(
    "sweep",
    "Precision of the designs against their cost: predicted standard deviation of the "
    "experiment over the nominal value, over the time of measuring and over the processor time of "
    "the search. Hollow: not every limit is proved to be kept. A line joins the complete designs "
    "that no other one beats in both, if all judge the same parameters with the same prior. "
    "Numbers are those of the table.",
    height=5.2,
)
def sweep_figure(figure: Figure, result: SweepResult) -> None:
    """Draw precision over measuring time and over the processor time of the search."""
    panels = figure.subplots(len(_PRECISIONS), len(_COSTS), sharex="col", sharey="row")
    looks = _looks(result)
    for row, (precision, title) in zip(panels, _PRECISIONS.items(), strict=True):
        for axes, cost in zip(row, _COSTS, strict=True):
            _draw(axes, result, cost, precision, looks)
        row[0].set_title(title)
        row[0].set_ylabel("Predicted std / nominal (%)")
    for axes, title in zip(panels[-1], _COSTS.values(), strict=True):
        axes.set_xlabel(title)
    if looks.legend:
        figure.legend(handles=looks.legend, loc="outside upper center", ncols=len(looks.legend))
    figure.align_ylabels()
    # Last: where a name can stand depends on everything else.
    for axes, (precision, cost) in zip(panels.flat, product(_PRECISIONS, _COSTS), strict=True):
        points, shown = _designs_of(result, cost, precision)
        names, colours = ([each[k] for k in shown] for each in (looks.names, looks.colours))
        label_points(axes, points[shown], names, colours)


def _draw(axes: Axes, result: SweepResult, cost: str, precision: str, looks: _Looks) -> None:
    points, shown = _designs_of(result, cost, precision)
    if not shown:
        drawing.write_centred(axes, "no design", color=drawing.MUTED)
        return
    for k in shown:
        colour = looks.colours[k]
        face = colour if result.designs[k].certified else "white"
        axes.plot(*points[k], "o", color=colour, markerfacecolor=face, markersize=4.5, zorder=4)
    complete = [k for k in shown if result.comparable and result.designs[k].complete]
    best = _unbeaten(points, complete)
    axes.plot(*points[best].T, color=drawing.GREY, linewidth=0.8, zorder=1.5)
    for way, each in zip("xy", points[shown].T, strict=True):
        low, high = float(np.min(each)), float(np.max(each))
        if low > 0 and high > _LOGARITHMIC * low:
            axes.set(**{f"{way}scale": "log", f"{way}lim": (low / _AIR, high * _AIR)})
            drawing.label_decades(getattr(axes, f"{way}axis"))
        else:
            air = _SHARE * ((high - low) or high or 1.0)
            axes.set(**{f"{way}lim": (low - air, high + air)})
            getattr(axes, f"{way}axis").set_major_formatter(drawing.plain_ticks())


def _designs_of(result: SweepResult, cost: str, precision: str) -> tuple[Array, list[int]]:
    """Return cost and precision of every design, (K, 2), and the designs that have both."""
    points = np.array([(getattr(one, cost), getattr(one, precision)) for one in result.designs])
    return points, np.flatnonzero(np.all(np.isfinite(points), axis=1)).tolist()


class _Looks(NamedTuple):
    """Colour and name of every design, and the legend of the colours."""

    colours: list[str]
    names: list[str]
    legend: list[Line2D]


def _looks(result: SweepResult) -> _Looks:
    """Return colours and names of the designs.

    Colours are the values of one key, where there are two or more with several values: of those
    with the fewest. Names are the values of the others.
    """
    grid, others, legend = result.grid, result.varied, []
    colours = [drawing.BLUE] * len(result.designs)
    path = min(others, key=lambda one: len(grid[one]))
    if len(others) > 1 and len(grid[path]) <= len(drawing.PALETTE):
        labels = {value_text(v): point_label({path: v}, [path]) for v in grid[path]}
        by_value = dict(zip(labels, drawing.PALETTE, strict=False))
        others = tuple(one for one in others if one != path)
        colours = [by_value[value_text(point[path])] for point in result.points]
        legend = [
            Line2D([], [], color=by_value[v], label=labels[v], marker="o", markersize=4.5, ls="")
            for v in labels
        ]
    names = [point_label(point, others) for point in result.points]
    if len(names) > _MOST_WORDS or max(map(len, names)) > _LONGEST_WORDS:
        names = [str(one.number) for one in result.designs]
    return _Looks(colours, names, legend)


def _unbeaten(points: Array, shown: Iterable[int]) -> list[int]:
    """Return the Pareto-optimal designs, from the cheapest to the most expensive."""
    found: list[int] = []
    for k in sorted(shown, key=lambda k: tuple(points[k])):
        if not found or points[k, 1] < points[found[-1], 1]:
            found.append(k)
    return found


_STEPS = (6.0, 15.0, 26.0, 38.0)
_ALIGNED = {-1: ("right", "top"), 0: ("center", "center"), 1: ("left", "bottom")}
_WAYS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
_PLACES = tuple((step, right, up) for step in _STEPS for right, up in _WAYS)
"""Places of a name: distance from its point, in points, and direction; the best first."""
_POINT = 2.5
"""Half the size of a marker, in points."""
_OUTSIDE = 10
"""Penalty of a name beyond the axes, in overlaps."""
_INCH = 72.0


def label_points(axes: Axes, points: Array, texts: Sequence[str], colours: Sequence[str]) -> None:
    """Name points, (K, 2) in units of the data, of axes that have their final limits."""
    figure = axes.figure
    if not isinstance(figure, Figure):
        raise TypeError("names are placed in a figure, not in a part of one")
    figure.draw_without_rendering()  # until then nothing has its place
    reach = _POINT * figure.dpi / _INCH * np.array([[-1], [1]])
    taken = [Bbox(place + reach) for place in axes.transData.transform(points)]
    frame = axes.get_window_extent()

    def cost(box: Bbox) -> int:
        inside = frame.x0 <= box.x0 and box.x1 <= frame.x1
        inside = inside and frame.y0 <= box.y0 and box.y1 <= frame.y1
        return sum(box.overlaps(other) for other in taken) + (0 if inside else _OUTSIDE)

    for point, text, colour in zip(points, texts, colours, strict=True):
        at = float(point[0]), float(point[1])
        name = drawing.write_small(
            axes, text, at, (0, 0), color=colour, annotation_clip=False, zorder=5
        )
        costs = [cost(_put(name, *place)) for place in _PLACES]
        step, right, up = _PLACES[int(np.argmin(costs))]
        taken.append(_put(name, step, right, up))
        if step > _STEPS[0]:
            line = {"arrowstyle": "-", "color": colour, "linewidth": 0.4, "shrinkB": 3}
            drawing.write_small(axes, "", at, name.get_position(), arrowprops=line)


def _put(name: Text, step: float, right: int, up: int) -> Bbox:
    horizontal, vertical = _ALIGNED[right][0], _ALIGNED[up][1]
    name.set_position((step * right, step * up))
    name.set(horizontalalignment=horizontal, verticalalignment=vertical)
    return name.get_window_extent()


@drawing.figure_definition(
    "plan",
    "Predicted standard deviation of the deciding quantity of every goal over the wanted one, "
    "against measuring time. Dashed: the floor by the tolerances; dot: the planned time.",
    height=3.3,
)
def plan_figure(figure: Figure, result: PlanResult) -> None:
    """Draw precision over measuring time with floors and planned times."""
    axes = figure.subplots()
    handles: list[Line2D] = []
    for place, goal in enumerate(result.goals):
        colour = drawing.PALETTE[place % len(drawing.PALETTE)]
        points = np.array([(p.minutes, p.std) for p in result.curves if p.goal == goal.goal])
        label = goal.goal if goal.quantity == goal.goal else f"{goal.goal} ({goal.quantity})"
        handles += axes.plot(points[:, 0], points[:, 1] / goal.wanted, color=colour, label=label)
        if goal.floor > 0:
            axes.axhline(goal.floor / goal.wanted, color=colour, linestyle="--", linewidth=0.8)
        if goal.reachable and goal.minutes > 0:
            std = np.exp(np.interp(np.log(goal.minutes), *np.log(points).T))
            axes.plot(goal.minutes, std / goal.wanted, "o", color=colour, markersize=4)
    axes.axhline(1.0, color=drawing.MUTED, linewidth=1.2, zorder=3)
    drawing.write_margin(axes, 1.0, "goal", drawing.MUTED)
    axes.set(xscale="log", yscale="log", xlabel="Measuring time (min)")
    ratios = [p.std / g.wanted for g in result.goals for p in result.curves if p.goal == g.goal]
    low, high = min(*ratios, 1.0), max(*ratios, 1.0)
    axes.set(ylabel="Predicted std / wanted std", ylim=(low / 1.5, high * 1.5))
    drawing.label_decades(axes.xaxis)
    drawing.label_decades(axes.yaxis)
    drawing.add_legend_above(axes, handles)
