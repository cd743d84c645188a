"""The path of the tool centre point: under the robot at home, and alone."""

from __future__ import annotations

from itertools import combinations, product
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import Bbox

from constraints.arrays import Array
from expdesign.experiment import DesignRecord
from results.figures.drawing import figure_definition
from results.notation import DisplayUnit, handy_unit
from results.style import EMPHASIS, FAINT, INK, MUTED, STRUT_COLOURS

_ELEVATION, _AZIMUTH = 20.0, -62.0
_NAME_AT = 0.3
"""Where on a strut its number stands, as a share of its length from the base."""
_FITS = 3
"""Rounds of fitting a view: labels do not grow with it, so that one does not suffice."""
_DOT = 0.15
"""A path smaller than this share of the workspace is drawn without it …"""
_AWAY = 2.0
"""… and without home when that is more than so many of its sizes away."""
_AXES = (("x", (-2.0, -2.0), 0.0), ("y", (-2.0, -2.0), 0.12), ("z", (1.0, 2.5), 0.0))
"""Axis, distances of its label and of its numbers (points), and the share at its lower end that is
left without numbers: x ends where y begins."""
_VIEWS = ((0.01, 0.01, 0.47, 0.86), (0.52, 0.01, 0.47, 0.86))
"""Left, bottom, width and height of the views, as shares of the figure."""


@figure_definition(
    "path",
    "Path of the tool centre point over one period: with base joints, struts and platform "
    "joints at the home pose (left), and within the limits of its position, or from home where "
    "these are far (right). Scales are equal within each view.",
    height=3.9,
)
def path_figure(figure: Figure, record: DesignRecord) -> None:
    """Draw both views, each with one scale for its three axes."""
    # The layout engine does not know how far the labels of three-dimensional axes reach out.
    figure.set_layout_engine("none")
    # Matplotlib has no types for three dimensions.
    views: list[Any] = [
        figure.add_axes(view, projection="3d", computed_zorder=False) for view in _VIEWS
    ]
    _draw_robot(views[0], record)
    _draw_path(views[1], record)
    bounded = _workspace(record) is not None
    alone = "Displacement from home"
    titles = ("With the robot at home", "Within the limits of its position" if bounded else alone)
    for axes, view, title in zip(views, _VIEWS, titles, strict=True):
        figure.text(view[0], 0.885, title, fontsize=8.5, fontweight="bold")
        _fill(axes, view)
    handles = [
        Line2D([], [], color=EMPHASIS, label="path of the TCP"),
        Line2D([], [], color=FAINT, label="its shadow"),
        Line2D([], [], color=EMPHASIS, marker="o", markersize=4, linestyle="none", label="start"),
        Line2D([], [], color=INK, marker="+", linestyle="none", label="TCP at home"),
        Line2D([], [], color=INK, label="base, platform"),
    ]
    if bounded:
        handles.append(Line2D([], [], color=MUTED, dashes=(3, 2), linewidth=0.8, label="limits"))
    figure.legend(handles=handles, loc="upper center", ncols=len(handles))


def _draw_robot(axes: Any, record: DesignRecord) -> None:
    robot = record.configuration.robot
    base, joints = robot.base_joints, robot.struts_at(robot.home).joints
    path = _closed(record.motion.pose[:, :3])
    unit = handy_unit("m", np.concatenate([base, joints, path]))
    base, joints, path = unit.shown(base), unit.shown(joints), unit.shown(path)
    home = unit.shown(record.robot.home[:3])
    names = base + _NAME_AT * (joints - base)
    _bound(axes, unit, np.concatenate([base, joints, path]))
    # What is drawn later covers what was drawn before: the path comes last.
    axes.plot(*_polygon(base).T, color=INK, linewidth=1.2)
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
    axes.plot(*_polygon(joints).T, color=INK, linewidth=1.2)
    tool = np.stack([np.mean(joints, axis=0), home])
    axes.plot(*tool.T, color=INK, linewidth=0.8, linestyle=":")
    axes.plot(*path.T, color=EMPHASIS, linewidth=1.0)
    axes.plot(*home[:, None], color=INK, marker="+", markersize=7, linestyle="none")


def _draw_path(axes: Any, record: DesignRecord) -> None:
    path, home = _closed(record.motion.pose[:, :3]), record.robot.home[:3]
    corners = _workspace(record)
    if corners is None:
        # Where home is would only hide how small a motion is.
        path, home, corners = path - home, np.zeros(3), path[:0]
    away = np.max(np.abs(home - np.mean(path, axis=0)))
    marked = home[None, :] if away < _AWAY * np.max(np.ptp(path, axis=0)) else path[:0]
    shown = np.concatenate([path, corners, marked])
    unit = handy_unit("m", np.ptp(shown, axis=0))
    path, marked, corners, shown = (unit.shown(part) for part in (path, marked, corners, shown))
    floor = _bound(axes, unit, shown)
    for one, other in combinations(corners, 2):
        if np.count_nonzero(one != other) == 1:
            edge = np.stack([one, other])
            axes.plot(*edge.T, color=MUTED, linewidth=0.8, dashes=(3, 2))
    axes.plot(path[:, 0], path[:, 1], floor, color=FAINT, linewidth=0.9)
    axes.plot(*path.T, color=EMPHASIS, linewidth=1.3)
    axes.plot(*path[:1].T, color=EMPHASIS, marker="o", markersize=4.5, linestyle="none")
    axes.plot(*marked.T, color=INK, marker="+", markersize=7, linestyle="none")


def _workspace(record: DesignRecord) -> Array | None:
    """Return the eight corners that the position may reach, SI.

    None when it is not bounded, or by so much that the path would be a dot within.
    """
    limit = record.robot.limit("position")
    if limit is None or not np.all(np.isfinite([limit.lower, limit.upper])):
        return None
    size = float(np.max(np.ptp(record.motion.pose[:, :3], axis=0)))
    if size < _DOT * float(np.max(limit.upper - limit.lower)):
        return None
    return np.array(list(product(*zip(limit.lower, limit.upper, strict=True))))


def _bound(axes: Any, unit: DisplayUnit, points: Array) -> float:
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


def _fill(axes: Any, view: tuple[float, float, float, float]) -> None:
    """Zoom and move the axes until they and their labels fill a part of the figure."""
    left, bottom, width, height = view
    aspect, zoom = np.diff([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()])[:, 0], 1.0
    for _ in range(_FITS):
        used = _extent(axes)
        zoom *= min(width / used.width, height / used.height)
        axes.set_box_aspect(aspect, zoom=zoom)
        used, place = _extent(axes), axes.get_position(original=True)
        x = place.x0 + left + width / 2 - (used.x0 + used.x1) / 2
        y = place.y0 + bottom + height / 2 - (used.y0 + used.y1) / 2
        axes.set_position((x, y, place.width, place.height))


def _extent(axes: Any) -> Bbox:
    """Return what box and labels cover, as shares of the figure."""
    axes.figure.draw_without_rendering()
    corners = np.array(list(product(axes.get_xlim(), axes.get_ylim(), axes.get_zlim())))
    projected = np.column_stack([corners, np.ones(len(corners))]) @ axes.get_proj().T
    box = axes.transData.transform(projected[:, :2] / projected[:, 3:])
    labels = [axis.get_tightbbox() for axis in (axes.xaxis, axes.yaxis, axes.zaxis)]
    parts = [Bbox([np.min(box, axis=0), np.max(box, axis=0)]), *labels]
    return Bbox.union(parts).transformed(axes.figure.transFigure.inverted())


def _polygon(points: Array) -> Array:
    """Return points in their order around their centre, closed."""
    centred = points - np.mean(points, axis=0)
    _, _, axes = np.linalg.svd(centred)
    angle = np.arctan2(centred @ axes[1], centred @ axes[0])
    return _closed(points[np.argsort(angle, kind="stable")])


def _closed(points: Array) -> Array:
    return np.concatenate([points, points[:1]])
