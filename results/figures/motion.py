"""The motion over one period and from rest to rest, and the struts against their limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.experiment import DesignResult
from expdesign.mechanism.hexapod import COORDINATE_NAMES
from expdesign.motion.executable import ExecutableMotion, SampledMotion
from expdesign.robot import Robot, robot_from
from results.figures.drawing import (
    AXIS_COLOURS,
    AXIS_DASHES,
    EMPHASIS,
    FAINT,
    FORBIDDEN,
    INK,
    MUTED,
    STRUT_COLOURS,
    add_legend_above,
    add_strut_legend,
    figure_definition,
)
from results.figures.machine import add_space, bound_view, close_path, draw_robot, fill_view
from results.notation import DisplayUnit, handy_unit, symbol

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
def path_figure(figure: Figure, result: DesignResult) -> None:
    """Draw both views, each with one scale for its three axes."""
    views = [add_space(figure, view) for view in _VIEWS]
    _draw_robot(views[0], result)
    _draw_path(views[1], result)
    bounded = _workspace(result) is not None
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


def _draw_robot(axes: Any, result: DesignResult) -> None:
    robot = result.configuration.robot
    base, joints = robot.base_joints, robot.struts_at(robot.home).joints
    path = close_path(result.motion.pose[:, :3])
    unit = handy_unit("m", np.concatenate([base, joints, path]))
    base, joints, path = unit.shown(base), unit.shown(joints), unit.shown(path)
    home = unit.shown(result.robot.home[:3])
    bound_view(axes, unit, np.concatenate([base, joints, path]))
    draw_robot(axes, base, joints, home)
    # What is drawn later covers what was drawn before: the path comes last.
    axes.plot(*path.T, color=EMPHASIS, linewidth=1.0)
    axes.plot(*home[:, None], color=INK, marker="+", markersize=7, linestyle="none")


def _draw_path(axes: Any, result: DesignResult) -> None:
    path, home = close_path(result.motion.pose[:, :3]), result.robot.home[:3]
    corners = _workspace(result)
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


def _workspace(result: DesignResult) -> Array | None:
    """Return the eight corners that the position may reach, SI.

    None when it is not bounded, or by so much that the path would be a dot within.
    """
    limit = result.robot.limit("position")
    if limit is None or not np.all(np.isfinite([limit.lower, limit.upper])):
        return None
    size = float(np.max(np.ptp(result.motion.pose[:, :3], axis=0)))
    if size < _DOT * float(np.max(limit.upper - limit.lower)):
        return None
    return np.array(list(product(*zip(limit.lower, limit.upper, strict=True))))


@dataclass(frozen=True, eq=False)
class RestToRestMotion:
    """The motion of controller tables, from rest to rest."""

    configuration: RunConfiguration
    executable: ExecutableMotion

    @cached_property
    def robot(self) -> Robot:
        """Robot of the run."""
        return robot_from(self.configuration.robot)

    @cached_property
    def motion(self) -> SampledMotion:
        """Motion at the controller's steps, both ends included."""
        step, executable = self.configuration.run.controller_period, self.executable
        steps = np.arange(sum(executable.steps(step)) + 1.0)
        return SampledMotion.of(
            self.robot, executable, np.minimum(step * steps, executable.duration)
        )


_SHARE = 6.0
"""Limits are in view when their range is at most this many spans of the curves …"""
_NEAR = 1.0
"""… and each of them when it is at most this many spans away."""
_BAND = 0.11
"""Height of the visible forbidden area, as a share of the range between the bounds."""
_AIR = 0.06
_BEYOND = 0.35
"""How far the close-up of a ramp reaches into the periods, as a share of the ramp."""
_WIDTHS = (1.0, 1.6, 1.0)


@dataclass(frozen=True)
class StrutQuantity:
    """A quantity that every strut has.

    The label is that of its axis, without the unit; the unit is SI; `limit` is the key of the limit
    that bounds it, `attribute` where a `SampledMotion` has its values.
    """

    title: str
    label: str
    unit: str
    limit: str
    attribute: str


LENGTH = StrutQuantity("Lengths", "Strut length", "m", "strut_length", "length")
SPEED = StrutQuantity("Speeds", "Strut speed", "m/s", "strut_speed", "speed")
ACCELERATION = StrutQuantity(
    "Accelerations", "Strut acceleration", "m/s^2", "strut_acceleration", "acceleration"
)
FORCE = StrutQuantity("Forces", "Actuator force", "N", "actuator_force", "force")
ALPHA = StrutQuantity("First cardan angle", r"Cardan angle $\alpha$", "rad", "alpha", "alpha")
BETA = StrutQuantity("Second cardan angle", r"Cardan angle $\beta$", "rad", "beta", "beta")


@figure_definition(
    "struts",
    "Lengths, speeds, accelerations and actuator forces (nominal parameters) of the six "
    "struts over one period. What the limits forbid is hatched.",
    height=5.4,
)
def struts_figure(figure: Figure, result: DesignResult) -> None:
    """Draw four panels over one period; the forces are those of the nominal parameters."""
    panels = figure.subplots(2, 2, sharex=True)
    _draw_period(result, panels, (LENGTH, SPEED, ACCELERATION, FORCE))
    figure.align_ylabels()


@figure_definition(
    "cardan_angles",
    "Cardan angles of the six struts over one period. What the limits forbid is hatched.",
    height=2.9,
)
def cardan_angles_figure(figure: Figure, result: DesignResult) -> None:
    """Draw α and β of all struts over one period."""
    _draw_period(result, figure.subplots(1, 2, sharex=True, squeeze=False), (ALPHA, BETA))


def _draw_period(result: DesignResult, panels: Any, quantities: Sequence[StrutQuantity]) -> None:
    """Draw one quantity into each panel over one period; name the struts above all."""
    for axes, quantity in zip(panels.flat, quantities, strict=True):
        _limited_panel(axes, quantity, result)
        axes.set_xlim(0, result.motion.period)
    for axes in panels[-1]:
        axes.set_xlabel("Time (s)")
    add_strut_legend(panels.flat[0].figure)


@figure_definition(
    "motion",
    "Lengths, speeds and actuator forces (nominal parameters) of the six struts from rest "
    "to rest. Left and right the ramps, close up; what the limits forbid is hatched.",
    height=6.2,
)
def motion_figure(figure: Figure, result: RestToRestMotion) -> None:
    """Draw lengths, speeds and forces: the whole motion, and its two ramps close up."""
    panels = figure.subplots(3, 3, sharex="col", sharey="row", width_ratios=_WIDTHS)
    starts = result.executable.starts
    begin, leave, end = (float(starts[k]) for k in (1, -2, -1))
    views = ((0, begin * (1 + _BEYOND)), (0, end), (leave - (end - leave) * _BEYOND, end))
    for row, quantity in zip(panels, (LENGTH, SPEED, FORCE), strict=True):
        for axes, view in zip(row, views, strict=True):
            _limited_panel(axes, quantity, result)
            for text in axes.texts[:] if axes is not row[1] else ():
                text.remove()
            axes.set_title("")
            axes.set_xlim(*view)
            for start in starts[1:-1]:
                axes.axvline(start, color=INK, linewidth=0.8, dashes=(3, 2))
        for axes in row[1:]:
            axes.set_ylabel("")
    for axes in panels[-1]:
        axes.set_xlabel("Time (s)")
    _name_segments(panels[0, 0], result.executable, slice(None, 2))
    _name_segments(panels[0, 2], result.executable, slice(-2, None))
    panels[0, 1].set_title("whole motion")
    figure.align_ylabels()
    add_strut_legend(figure)


def _name_segments(axes: Axes, motion: ExecutableMotion, shown: slice) -> None:
    """Write each segment's name above the middle of its visible part."""
    low, high = axes.get_xlim()
    for k, name in list(enumerate(segment.name for segment in motion.segments))[shown]:
        middle = np.clip(motion.starts[k : k + 2], low, high).mean()
        axes.text(
            (middle - low) / (high - low),
            1.03,
            name,
            transform=axes.transAxes,
            ha="center",
            fontsize="small",
            color=MUTED if name == "periods" else INK,
            bbox={"facecolor": "white", "edgecolor": FAINT, "pad": 1.5, "linewidth": 0.0},
        )


def _limited_panel(
    axes: Axes, quantity: StrutQuantity, result: DesignResult | RestToRestMotion
) -> None:
    """Draw the curves, shade what the limit forbids and write the bounds into the shade.

    Where bounds differ from strut to strut, the shade begins at the widest, and each strut's own
    bound is a dashed line in its colour.
    """
    motion, limit = result.motion, result.robot.limit(quantity.limit)
    values: Array = getattr(motion, quantity.attribute)
    nothing = np.full(values.shape[1], np.inf)
    lower = -nothing if limit is None else limit.lower
    upper = nothing if limit is None else limit.upper
    finite = np.concatenate([values.ravel(), lower, upper])
    unit = handy_unit(quantity.unit, finite[np.isfinite(finite)])
    for j, colour in enumerate(STRUT_COLOURS):
        axes.plot(motion.time, unit.shown(values[:, j]), color=colour, label=f"strut {j + 1}")
    axes.set(title=quantity.title, ylabel=unit.label(quantity.label))
    _show_bounds(axes, unit, values, lower, upper)


def _show_bounds(axes: Axes, unit: DisplayUnit, values: Array, lower: Array, upper: Array) -> None:
    low, high = float(np.min(values)), float(np.max(values))
    span = (high - low) or max(abs(high), 1.0) * 1e-3
    least, most = float(np.min(lower)), float(np.max(upper))
    near = most - least <= _SHARE * span
    below = near or low - least <= _NEAR * span
    above = near or most - high <= _NEAR * span
    bottom, top = min(low, least) if below else low, max(high, most) if above else high
    height = top - bottom
    bottom -= height * (_BAND if below else _AIR)
    top += height * (_BAND if above else _AIR)
    axes.set_ylim(*unit.shown([bottom, top]))
    hidden = []
    for bounds, widest, edge, seen in ((lower, least, bottom, below), (upper, most, top, above)):
        if seen:
            _forbid(axes, unit, bounds, widest, edge)
        elif np.isfinite(widest):
            hidden.append(widest)
    if hidden:
        text = f"{_hidden_text(unit, hidden)} not in view"
        axes.set_title(text, loc="right", fontsize="small", fontweight="normal", color=MUTED)


def _hidden_text(unit: DisplayUnit, bounds: Sequence[float]) -> str:
    if len(bounds) == 1:
        return f"limit {unit.quantity(bounds[0])}"
    if bounds[0] == -bounds[1]:
        return f"limits ±{unit.quantity(bounds[1])}"
    return f"limits {unit.number(bounds[0])} … {unit.quantity(bounds[1])}"


def _forbid(axes: Axes, unit: DisplayUnit, bounds: Array, widest: float, edge: float) -> None:
    """Shade from the widest bound to the edge of the view; draw the bounds."""
    boundary, end = unit.shown([widest, edge])
    axes.axhspan(boundary, end, **FORBIDDEN, zorder=0.6)
    axes.axhline(boundary, color=INK, linewidth=0.8, zorder=1.5)
    for colour, bound in zip(STRUT_COLOURS, bounds, strict=True):
        if np.isfinite(bound) and bound != widest:
            axes.axhline(
                unit.shown(bound).item(), color=colour, linewidth=0.9, dashes=(4, 2), zorder=1.4
            )
    axes.text(
        0.012,
        (boundary + end) / 2,
        _bounds_text(unit, bounds),
        transform=axes.get_yaxis_transform(),
        fontsize="small",
        color=INK,
        verticalalignment="center",
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        zorder=3,
    )


def _bounds_text(unit: DisplayUnit, bounds: Array) -> str:
    smallest, largest = float(np.min(bounds)), float(np.max(bounds))
    if smallest == largest:
        return f"limit {unit.quantity(largest)}"
    return f"limits by strut {unit.number(smallest)} … {unit.quantity(largest)}"


_PANELS = (
    ("Displacements of the TCP from home", "Displacement", "m", slice(None, 3)),
    ("Rotation angles", "Angle", "rad", slice(3, None)),
)


@figure_definition(
    "excitation",
    "One period of the excitation trajectory: displacements of the tool centre point from "
    "the home pose (above) and rotation angles of the platform (below).",
    height=4.4,
)
def excitation_figure(figure: Figure, result: DesignResult) -> None:
    """Draw x, y, z from home and φ, θ, ψ, as Fig. 2 of the paper does."""
    panels = figure.subplots(2, 1, sharex=True)
    time = result.motion.time
    # Where home is belongs to the place of the robot; angles are shown as they are limited.
    origin = result.robot.home * [1, 1, 1, 0, 0, 0]
    values = result.motion.pose - origin
    for axes, (title, label, si, part) in zip(panels, _PANELS, strict=True):
        unit = handy_unit(si, values[:, part])
        axes.axhline(0, color=MUTED, linewidth=0.7, zorder=1)
        names = COORDINATE_NAMES[part]
        for k, (name, colour, dashes) in enumerate(
            zip(names, AXIS_COLOURS, AXIS_DASHES, strict=True)
        ):
            shown = unit.shown(values[:, part][:, k])
            axes.plot(time, shown, color=colour, linestyle=dashes, label=symbol(name))
        axes.set(title=title, ylabel=unit.label(label))
        axes.set_xlim(0, result.motion.period)
        add_legend_above(axes, axes.get_lines()[1:])
    panels[-1].set_xlabel("Time (s)")
    figure.align_ylabels()
