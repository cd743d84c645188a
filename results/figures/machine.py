"""The machine at home, in space and from two sides, to be held against the real one."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox
from scipy.spatial.distance import pdist

from constraints.arrays import Array
from expdesign.robot import Robot
from results.figures.drawing import INK, MUTED, STRUT_COLOURS, figure_definition
from results.notation import DisplayUnit, handy_unit

View = tuple[float, float, float, float]
"""Left, bottom, width and height of a part of a figure, as shares of it."""
_ELEVATION, _AZIMUTH = 20.0, -62.0
_NAME_AT = 0.3
"""Place of a strut's number, as a share of its length from the base."""
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
    around = [order_polygon(points)[:, columns] for points in (base, joints)]
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


def add_space(figure: Figure, view: View) -> Any:
    """Return three-dimensional axes in a part of a figure; Matplotlib has no types for them."""
    # The layout engine does not know how far the labels of such axes reach out.
    figure.set_layout_engine("none")
    return figure.add_axes(view, projection="3d", computed_zorder=False)


def bound_view(axes: Any, unit: DisplayUnit, points: Array) -> float:
    """Put the axes around the points, with one scale for all three; return the floor."""
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
    others = [one for one in axes.figure.axes if one is not axes and one.get_visible()]
    for one in others:  # the extent is found by drawing the figure
        one.set_visible(False)
    aspect, zoom = np.diff([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])[:, 0], 1.0
    used = view_extent(axes)
    for _ in range(_FITS):
        zoom *= min(width / used.width, height / used.height)
        axes.set_box_aspect(aspect, zoom=zoom)
        used = view_extent(axes)
    place = axes.get_position(original=True)
    x = place.x0 + left + width / 2 - (used.x0 + used.x1) / 2
    y = place.y0 + bottom + height / 2 - (used.y0 + used.y1) / 2
    axes.set_position((x, y, place.width, place.height))
    for one in others:
        one.set_visible(True)


def view_extent(axes: Any) -> Bbox:
    """Return the area of box and labels, as shares of the figure."""
    axes.figure.draw_without_rendering()
    corners = np.array(list(product(axes.get_xlim(), axes.get_ylim(), axes.get_zlim())))
    projected = np.column_stack([corners, np.ones(len(corners))]) @ axes.get_proj().T
    box = axes.transData.transform(projected[:, :2] / projected[:, 3:])
    labels = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    parts = [Bbox([np.min(box, axis=0), np.max(box, axis=0)]), *labels]
    return Bbox.union(parts).transformed(axes.figure.transFigure.inverted())


def order_polygon(points: Array) -> Array:
    """Return points in their order around their centre, closed."""
    centred = points - np.mean(points, axis=0)
    _, _, axes = np.linalg.svd(centred)
    angle = np.arctan2(centred @ axes[1], centred @ axes[0])
    return close_path(points[np.argsort(angle, kind="stable")])


def close_path(points: Array) -> Array:
    """Return points with the first one again at the end."""
    return np.concatenate([points, points[:1]])


_SPACE: View = (0.01, 0.01, 0.54, 0.87)
_LEFT, _WIDTH, _BOTTOM, _TOP, _BETWEEN = 0.66, 0.33, 0.11, 0.90, 0.11
"""Margins of the plane views, one above the other, as shares of the figure."""
_ABOVE = (0, 1)
_SIDES = {(0, 2): "From the front, along y", (1, 2): "From the side, along x"}
_NAMES = "xyz"
_AXIS = 0.18
"""Length of a cardan axis as a share of the base's radius."""
_AIR = 0.06


@figure_definition(
    "machine",
    "The machine at home: base, numbered struts, platform, TCP and first cardan axes. Scales are "
    "equal within each view.",
    height=4.4,
)
def machine_figure(figure: Figure, robot: Robot) -> None:
    """Draw the robot at home in three views."""
    about = robot.description
    base, joints, home = about.base_joints, about.struts_at(robot.home).joints, robot.home[:3]
    unit = handy_unit("m", np.concatenate([base, joints, home[None, :]]))
    way = _AXIS * float(np.max(np.linalg.norm(base - base.mean(axis=0), axis=1)))
    ends = np.stack([base - way * about.alpha_axes, base + way * about.alpha_axes])
    base, joints, home, ends = (unit.shown(part) for part in (base, joints, home, ends))
    points = np.concatenate([base, joints, home[None, :], *ends])
    space = add_space(figure, _SPACE)
    bound_view(space, unit, points)
    # The side whose struts hide each other least.
    middles = (base + joints) / 2
    side = max(_SIDES, key=lambda columns: float(np.min(pdist(middles[:, columns]))))
    shown = _ABOVE, side
    planes = [figure.add_axes(place) for place in _places(figure, points, side)]
    for axes, columns in ((space, (0, 1, 2)), *zip(planes, shown, strict=True)):
        for j in range(len(base)):
            axes.plot(*ends[:, j][:, columns].T, color=MUTED, linewidth=0.9)
        draw_robot(axes, base, joints, home, columns)
        axes.plot(*home[list(columns), None], color=INK, marker="+", markersize=7, linestyle="none")
    figure.text(_SPACE[0], _TOP + 0.01, "In space", fontsize=8.5, fontweight="bold")
    for axes, columns in zip(planes, shown, strict=True):
        _bound_plane(axes, unit, points, columns)
        axes.set_title(_SIDES.get(columns, "From above"))
    fill_view(space, _SPACE)
    handles = [
        Line2D([], [], color=INK, label="base, platform"),
        Line2D([], [], color=MUTED, linewidth=0.9, label="first cardan axis"),
        Line2D([], [], color=INK, marker="+", linestyle="none", label="TCP"),
    ]
    figure.legend(handles=handles, loc="upper center", ncols=len(handles))


def _range(points: Array) -> tuple[Array, Array]:
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    air = _AIR * float(np.max(high - low))
    return low - air, high + air


def _places(figure: Figure, points: Array, side: tuple[int, int]) -> tuple[View, View]:
    """Return the places of the views from above and from a side, with the largest common scale."""
    low, high = _range(points)
    width, height = figure.get_size_inches()
    free = (_TOP - _BOTTOM - _BETWEEN) * height
    x, y, z = high - low
    across = (high - low)[side[0]]
    scale = min(_WIDTH * width / max(x, across), free / (y + z))
    wide, above, front = (scale * x / width, scale * y / height, scale * z / height)
    left = _LEFT + (_WIDTH - scale * max(x, across) / width) / 2
    upper = (left, _TOP - above, wide, above)
    return upper, (left, upper[1] - _BETWEEN - front, scale * across / width, front)


def _bound_plane(axes: Axes, unit: DisplayUnit, points: Array, columns: tuple[int, int]) -> None:
    across, up = columns
    low, high = _range(points)
    axes.set_xlim(low[across], high[across])
    axes.set_ylim(low[up], high[up])
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.set_ylabel(unit.label(f"${_NAMES[up]}$"), labelpad=1)
    if columns in _SIDES:
        axes.set_xlabel(unit.label(f"${_NAMES[across]}$"), labelpad=1)
