"""The path of the tool centre point: under the robot at home, and alone."""

from __future__ import annotations

from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from constraints.arrays import Array
from expdesign.experiment import DesignRecord
from results.figures.drawing import figure_definition
from results.figures.space import bound_view, closed, draw_robot, fill_view
from results.notation import handy_unit
from results.style import EMPHASIS, FAINT, INK, MUTED

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_DOT = 0.15
"""A path smaller than this share of the workspace is drawn without it …"""
_AWAY = 2.0
"""… and without home when that is more than so many of its sizes away."""
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
    from matplotlib.lines import Line2D

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
        fill_view(axes, view)
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
    path = closed(record.motion.pose[:, :3])
    unit = handy_unit("m", np.concatenate([base, joints, path]))
    base, joints, path = unit.shown(base), unit.shown(joints), unit.shown(path)
    home = unit.shown(record.robot.home[:3])
    bound_view(axes, unit, np.concatenate([base, joints, path]))
    draw_robot(axes, base, joints, home)
    # What is drawn later covers what was drawn before: the path comes last.
    axes.plot(*path.T, color=EMPHASIS, linewidth=1.0)
    axes.plot(*home[:, None], color=INK, marker="+", markersize=7, linestyle="none")


def _draw_path(axes: Any, record: DesignRecord) -> None:
    path, home = closed(record.motion.pose[:, :3]), record.robot.home[:3]
    corners = _workspace(record)
    if corners is None:
        # Where home is would only hide how small a motion is.
        path, home, corners = path - home, np.zeros(3), path[:0]
    away = np.max(np.abs(home - np.mean(path, axis=0)))
    marked = home[None, :] if away < _AWAY * np.max(np.ptp(path, axis=0)) else path[:0]
    shown = np.concatenate([path, corners, marked])
    unit = handy_unit("m", np.ptp(shown, axis=0))
    path, marked, corners, shown = (unit.shown(part) for part in (path, marked, corners, shown))
    floor = bound_view(axes, unit, shown)
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
