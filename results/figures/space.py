"""The robot in space, and three-dimensional views with one scale for their three axes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from constraints.arrays import Array
from results.notation import DisplayUnit
from results.style import INK, STRUT_COLOURS

if TYPE_CHECKING:
    from matplotlib.transforms import Bbox

View = tuple[float, float, float, float]
"""Left, bottom, width and height of a part of a figure, as shares of it."""

_ELEVATION, _AZIMUTH = 20.0, -62.0
_NAME_AT = 0.3
"""Where on a strut its number stands, as a share of its length from the base."""
_FITS = 2
"""Rounds of fitting a view: labels do not grow with it, so that one does not suffice. A third one
moves nothing by more than a ten-thousandth of the figure."""
_AXES = (("x", (-2.0, -2.0), 0.0), ("y", (-2.0, -2.0), 0.12), ("z", (1.0, 2.5), 0.0))
"""Axis, distances of its label and of its numbers (points), and the share at its lower end that is
left without numbers: x ends where y begins."""


def draw_robot(
    axes: Any, base: Array, joints: Array, tool: Array, columns: Sequence[int] = (0, 1, 2)
) -> None:
    """Draw base, numbered struts, platform and the line to the TCP.

    `base` and platform `joints` are (6, 3), `tool` is (3,), in the unit of the axes; `columns` are
    those of x, y, z that the axes show.
    """
    names = (base + _NAME_AT * (joints - base))[:, columns]
    line = np.stack([np.mean(joints, axis=0), tool])[:, columns]
    around = [polygon(points)[:, columns] for points in (base, joints)]
    base, joints = base[:, columns], joints[:, columns]
    # What is drawn later covers what was drawn before.
    axes.plot(*around[0].T, color=INK, linewidth=1.2)
    for j, colour in enumerate(STRUT_COLOURS):
        strut = np.stack([base[j], joints[j]])
        axes.plot(*strut.T, color=colour, linewidth=2.0, marker="o", markersize=3.2)
        axes.text(
            *names[j],
            f"{j + 1}",
            color=colour,
            fontsize="small",
            fontweight="bold",
            ha="center",
            va="center",
            bbox={"boxstyle": "circle,pad=0.15", "facecolor": "white", "edgecolor": colour},
        )
    axes.plot(*around[1].T, color=INK, linewidth=1.2)
    axes.plot(*line.T, color=INK, linewidth=0.8, linestyle=":")


def bound_view(axes: Any, unit: DisplayUnit, points: Array) -> float:
    """Put the axes around the points, with one scale for all three; return the floor."""
    from matplotlib.ticker import MaxNLocator

    low, high = np.min(points, axis=0), np.max(points, axis=0)
    air = 0.03 * float(np.max(high - low))
    # A planar path still needs a box with some depth.
    thin = np.maximum(0.1 * float(np.max(high - low)) - (high - low), 0.0) / 2
    low, high = low - air - thin, high + air + thin
    for k, (name, pads, free) in enumerate(_AXES):
        getattr(axes, f"set_{name}lim")(low[k], high[k])
        getattr(axes, f"set_{name}label")(unit.label(f"${name}$"), labelpad=pads[0])
        axis = getattr(axes, f"{name}axis")
        ticks = np.asarray(MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(low[k], high[k]))
        begin = low[k] + free * (high[k] - low[k])
        axis.set_ticks(ticks[(ticks >= begin) & (ticks <= high[k])])
        axis.set_tick_params(pad=pads[1])
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
    axes.set_box_aspect(high - low)
    axes.view_init(_ELEVATION, _AZIMUTH)
    return float(low[2])


def fill_view(axes: Any, view: View) -> None:
    """Zoom and move the axes until they and their labels fill a part of the figure."""
    left, bottom, width, height = view
    aspect, zoom = np.diff([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])[:, 0], 1.0
    for _ in range(_FITS):
        used = view_extent(axes)
        zoom *= min(width / used.width, height / used.height)
        axes.set_box_aspect(aspect, zoom=zoom)
        used, place = view_extent(axes), axes.get_position(original=True)
        x = place.x0 + left + width / 2 - (used.x0 + used.x1) / 2
        y = place.y0 + bottom + height / 2 - (used.y0 + used.y1) / 2
        axes.set_position((x, y, place.width, place.height))


def view_extent(axes: Any) -> Bbox:
    """Return what box and labels cover, as shares of the figure."""
    from matplotlib.transforms import Bbox

    axes.figure.draw_without_rendering()
    corners = np.array(list(product(axes.get_xlim(), axes.get_ylim(), axes.get_zlim())))
    projected = np.column_stack([corners, np.ones(len(corners))]) @ axes.get_proj().T
    box = axes.transData.transform(projected[:, :2] / projected[:, 3:])
    labels = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    parts = [Bbox([np.min(box, axis=0), np.max(box, axis=0)]), *labels]
    return Bbox.union(parts).transformed(axes.figure.transFigure.inverted())


def polygon(points: Array) -> Array:
    """Return points in their order around their centre, closed."""
    centred = points - np.mean(points, axis=0)
    _, _, axes = np.linalg.svd(centred)
    angle = np.arctan2(centred @ axes[1], centred @ axes[0])
    return closed(points[np.argsort(angle, kind="stable")])


def closed(points: Array) -> Array:
    """Return points with the first one again at the end."""
    return np.concatenate([points, points[:1]])
