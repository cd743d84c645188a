"""The path of the tool centre point: under the robot at home, and alone."""

from __future__ import annotations

from itertools import combinations, product
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from results.figures.definition import FigureDefinition
from results.record import DesignRecord
from results.style import EMPHASIS, FAINT, INK, MUTED, STRUT_COLOURS, new_figure
from results.units import DisplayUnit, handy_unit

Array = NDArray[np.float64]

_ELEVATION, _AZIMUTH = 20.0, -52.0


def draw(record: DesignRecord) -> Figure:
    """Draw both views, each with one scale for its three axes."""
    figure = new_figure(4.1)
    # The layout engine does not know how far the labels of three-dimensional axes reach out.
    figure.set_layout_engine("none")
    # Matplotlib has no types for three dimensions.
    robot: Any = figure.add_axes((0.0, 0.03, 0.46, 0.84), projection="3d", computed_zorder=False)
    alone: Any = figure.add_axes((0.5, 0.03, 0.46, 0.84), projection="3d", computed_zorder=False)
    _draw_robot(robot, record)
    _draw_path(alone, record)
    titles = ("With the robot at home", "Path and limits of the TCP")
    for left, title in zip((0.02, 0.52), titles, strict=True):
        figure.text(left, 0.9, title, fontsize=8.5, fontweight="bold")
    handles = [
        Line2D([], [], color=EMPHASIS, label="path of the TCP"),
        Line2D([], [], color=FAINT, label="its shadow"),
        Line2D([], [], color=INK, marker="+", linestyle="none", label="TCP at home"),
        Line2D([], [], color=EMPHASIS, marker="o", markersize=4, linestyle="none", label="start"),
        Line2D([], [], color=INK, label="base, platform"),
        Line2D([], [], color=MUTED, linestyle=(0, (3, 2)), linewidth=0.8, label="limits"),
    ]
    figure.legend(handles=handles, loc="upper center", ncols=len(handles))
    return figure


def _draw_robot(axes: Any, record: DesignRecord) -> None:
    base, joints = record.robot.geometry.base_joints, record.home_joints()
    path = _closed(record.motion.pose[:, :3])
    unit = handy_unit("m", np.concatenate([base, joints, path]))
    base, joints, path = unit.shown(base), unit.shown(joints), unit.shown(path)
    home = unit.shown(record.robot.home[:3])
    struts = base - joints
    names = base + 0.09 * np.max(np.ptp(base, axis=0)) * struts / np.linalg.norm(
        struts, axis=1, keepdims=True
    )
    _fit(axes, unit, np.concatenate([names, joints, path]))
    # Struts behind the path and the platform first: the order is the one of drawing.
    axes.plot(*_polygon(base).T, color=INK, linewidth=1.2)
    for j, colour in enumerate(STRUT_COLOURS):
        strut = np.stack([base[j], joints[j]])
        axes.plot(*strut.T, color=colour, linewidth=2.0, marker="o", markersize=3.2)
        axes.text(*names[j], f"{j + 1}", color=colour, ha="center", va="center", weight="bold")
    axes.plot(*_polygon(joints).T, color=INK, linewidth=1.2)
    tool = np.stack([np.mean(joints, axis=0), home])
    axes.plot(*tool.T, color=INK, linewidth=0.8, linestyle=":")
    axes.plot(*path.T, color=EMPHASIS, linewidth=1.0)
    axes.plot(*home[:, None], color=INK, marker="+", markersize=7, linestyle="none")


def _draw_path(axes: Any, record: DesignRecord) -> None:
    path = _closed(record.motion.pose[:, :3])
    unit = handy_unit("m", np.ptp(path, axis=0))
    path, home = unit.shown(path), unit.shown(record.robot.home[:3])
    corners = _workspace(record)
    corners = path[:0] if corners is None else unit.shown(corners)
    floor = _fit(axes, unit, np.concatenate([path, corners]))
    for one, other in combinations(corners, 2):
        if np.count_nonzero(one != other) == 1:
            edge = np.stack([one, other])
            axes.plot(*edge.T, color=MUTED, linewidth=0.8, dashes=(3, 2))
    axes.plot(path[:, 0], path[:, 1], floor, color=FAINT, linewidth=0.9)
    axes.plot(*path.T, color=EMPHASIS, linewidth=1.3)
    axes.plot(*path[:1].T, color=EMPHASIS, marker="o", markersize=4.5, linestyle="none")
    axes.plot(*home[:, None], color=INK, marker="+", markersize=7, linestyle="none")


def _workspace(record: DesignRecord) -> Array | None:
    """Return the eight corners that the position may reach, SI; None when it is not bounded."""
    limit = record.limit("position")
    if limit is None or not np.all(np.isfinite([limit.lower, limit.upper])):
        return None
    return np.array(list(product(*zip(limit.lower, limit.upper, strict=True))))


def _fit(axes: Any, unit: DisplayUnit, points: Array) -> float:
    """Fit the axes around the points with one scale for all three; return the floor."""
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    air = 0.03 * float(np.max(high - low))
    # A planar path still needs a box with some depth.
    thin = np.maximum(0.1 * float(np.max(high - low)) - (high - low), 0.0) / 2
    low, high = low - air - thin, high + air + thin
    for k, name in enumerate("xyz"):
        getattr(axes, f"set_{name}lim")(low[k], high[k])
        getattr(axes, f"set_{name}label")(unit.label(f"${name}$"), labelpad=-1.0)
        axis = getattr(axes, f"{name}axis")
        axis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
        axis.set_tick_params(pad=-1.5)
        axis.set_pane_color((1.0, 1.0, 1.0, 0.0))
    axes.set_box_aspect(high - low, zoom=0.92)
    axes.view_init(_ELEVATION, _AZIMUTH)
    return float(low[2])


def _polygon(points: Array) -> Array:
    """Return points in their order around their centre, closed."""
    centred = points - np.mean(points, axis=0)
    _, _, axes = np.linalg.svd(centred)
    angle = np.arctan2(centred @ axes[1], centred @ axes[0])
    return _closed(points[np.argsort(angle, kind="stable")])


def _closed(points: Array) -> Array:
    return np.concatenate([points, points[:1]])


FIGURE = FigureDefinition(
    key="path",
    caption="Path of the tool centre point over one period: with base joints, struts and platform "
    "joints at the home pose (left), and within the limits of its position (right). Scales are "
    "equal within each view.",
    draw=draw,
)
