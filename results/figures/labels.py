"""Names beside points, where they hide neither each other nor the points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from constraints.arrays import Array

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text
    from matplotlib.transforms import Bbox

_STEPS = (6.0, 15.0, 26.0, 38.0)
_ALIGNED = {-1: ("right", "top"), 0: ("center", "center"), 1: ("left", "bottom")}
_WAYS = ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1))
_PLACES = tuple((step, right, up) for step in _STEPS for right, up in _WAYS)
"""Where a name may stand: how many points from its own, and in which direction; the best first."""
_POINT = 2.5
"""Half the size of what is drawn at a point, in points."""
_OUTSIDE = 10
"""What it costs to leave the axes, in overlaps."""
_INCH = 72.0


def label_points(axes: Axes, points: Array, texts: Sequence[str], colours: Sequence[str]) -> None:
    """Name points, (K, 2) in units of the data, of axes that have their final limits."""
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox

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
