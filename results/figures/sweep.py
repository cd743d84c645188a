"""Figure of a sweep: predicted precision against measuring time and search time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.transforms import Bbox

from constraints.arrays import Array
from expdesign.configuration.grid import value_text
from expdesign.experiment.sweep import SweepResult, point_label
from results.figures.drawing import (
    centred_text,
    figure_definition,
    plain_decades,
    plain_ticks,
)
from results.style import BLUE, GREY, MUTED, PALETTE

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


@figure_definition(
    "sweep",
    "What the designs promise against what they cost: predicted standard deviation of the "
    "experiment over the nominal value, over the time of measuring and over the processor time of "
    "the search. Hollow: not every limit is proved to be kept. A line joins the designs that no "
    "other one beats in both. Numbers are those of the table.",
    height=5.2,
)
def sweep_figure(figure: Figure, record: SweepResult) -> None:
    """Draw precision over measuring time and over the processor time of the search."""
    panels = figure.subplots(len(_PRECISIONS), len(_COSTS), sharex="col", sharey="row")
    looks = _looks(record)
    for row, (precision, title) in zip(panels, _PRECISIONS.items(), strict=True):
        for axes, cost in zip(row, _COSTS, strict=True):
            _draw(axes, record, cost, precision, looks)
        row[0].set_title(title)
        row[0].set_ylabel("Predicted std / nominal (%)")
    for axes, title in zip(panels[-1], _COSTS.values(), strict=True):
        axes.set_xlabel(title)
    if looks.legend:
        figure.legend(handles=looks.legend, loc="outside upper center", ncols=len(looks.legend))
    figure.align_ylabels()
    # Last: where a name can stand depends on everything else.
    for axes, (precision, cost) in zip(panels.flat, product(_PRECISIONS, _COSTS), strict=True):
        points, shown = _points(record, cost, precision)
        names, colours = ([each[k] for k in shown] for each in (looks.names, looks.colours))
        label_points(axes, points[shown], names, colours)


def _draw(axes: Axes, record: SweepResult, cost: str, precision: str, looks: _Looks) -> None:
    """Draw the designs of one panel."""
    points, shown = _points(record, cost, precision)
    if not shown:
        centred_text(axes, "no design", color=MUTED)
        return
    for k in shown:
        colour = looks.colours[k]
        face = colour if record.designs[k].certified else "white"
        axes.plot(*points[k], "o", color=colour, markerfacecolor=face, markersize=4.5, zorder=4)
    best = _unbeaten(points, shown)
    axes.plot(*points[best].T, color=GREY, linewidth=0.8, zorder=1.5)
    for way, each in zip("xy", points[shown].T, strict=True):
        low, high = float(np.min(each)), float(np.max(each))
        if low > 0 and high > _LOGARITHMIC * low:
            axes.set(**{f"{way}scale": "log", f"{way}lim": (low / _AIR, high * _AIR)})
            plain_decades(getattr(axes, f"{way}axis"))
        else:
            air = _SHARE * ((high - low) or high or 1.0)
            axes.set(**{f"{way}lim": (low - air, high + air)})
            getattr(axes, f"{way}axis").set_major_formatter(plain_ticks())


def _points(record: SweepResult, cost: str, precision: str) -> tuple[Array, list[int]]:
    """Return cost and precision of every design, (K, 2), and the designs that have both."""
    points = np.array([(getattr(one, cost), getattr(one, precision)) for one in record.designs])
    return points, np.flatnonzero(np.all(np.isfinite(points), axis=1)).tolist()


class _Looks(NamedTuple):
    """Colour and name of every design, and the legend of the colours."""

    colours: list[str]
    names: list[str]
    legend: list[Line2D]


def _looks(record: SweepResult) -> _Looks:
    """Return colours and names of the designs.

    Colours are the values of one key, where there are two or more with several values: of those
    with the fewest. Names are the values of the others.
    """
    grid, others, legend = record.grid, record.varied, []
    colours = [BLUE] * len(record.designs)
    path = min(others, key=lambda one: len(grid[one]))
    if len(others) > 1 and len(grid[path]) <= len(PALETTE):
        labels = {value_text(v): point_label({path: v}, [path]) for v in grid[path]}
        by_value = dict(zip(labels, PALETTE, strict=False))
        others = tuple(one for one in others if one != path)
        colours = [by_value[value_text(point[path])] for point in record.points]
        legend = [
            Line2D([], [], color=by_value[v], label=labels[v], marker="o", markersize=4.5, ls="")
            for v in labels
        ]
    names = [point_label(point, others) for point in record.points]
    if len(names) > _MOST_WORDS or max(map(len, names)) > _LONGEST_WORDS:
        names = [str(one.number) for one in record.designs]
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
        name = axes.annotate(
            text,
            (float(point[0]), float(point[1])),
            xytext=(0, 0),
            textcoords="offset points",
            fontsize="small",
            color=colour,
            annotation_clip=False,
            zorder=5,
        )
        costs = [cost(_put(name, *place)) for place in _PLACES]
        step, right, up = _PLACES[int(np.argmin(costs))]
        taken.append(_put(name, step, right, up))
        if step > _STEPS[0]:
            axes.annotate(
                "",
                (float(point[0]), float(point[1])),
                xytext=name.get_position(),
                textcoords="offset points",
                arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.4, "shrinkB": 3},
            )


def _put(name: Text, step: float, right: int, up: int) -> Bbox:
    """Put a name there; return the box that it takes."""
    horizontal, vertical = _ALIGNED[right][0], _ALIGNED[up][1]
    name.set_position((step * right, step * up))
    name.set(horizontalalignment=horizontal, verticalalignment=vertical)
    return name.get_window_extent()
