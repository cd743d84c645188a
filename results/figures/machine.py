"""The machine at home, in space and from two sides, to be held against the real one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from constraints.arrays import Array
from expdesign.robot import Robot
from results.figures.drawing import figure_definition
from results.figures.space import View, bound_view, draw_robot, fill_view
from results.notation import DisplayUnit, handy_unit
from results.style import INK, MUTED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SPACE: View = (0.01, 0.01, 0.54, 0.87)
_LEFT, _WIDTH, _BOTTOM, _TOP, _BETWEEN = 0.66, 0.33, 0.11, 0.90, 0.11
"""Of the plane views, which stand one above the other, as shares of the figure."""
_TITLES = ("In space", "From above", "From the front, along y")
_COLUMNS = ((0, 1), (0, 2))
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
    from matplotlib.lines import Line2D

    # The layout engine does not know how far the labels of three-dimensional axes reach out.
    figure.set_layout_engine("none")
    about = robot.description
    base, joints, home = about.base_joints, about.struts_at(robot.home).joints, robot.home[:3]
    unit = handy_unit("m", np.concatenate([base, joints, home[None, :]]))
    way = _AXIS * float(np.max(np.linalg.norm(base - base.mean(axis=0), axis=1)))
    ends = np.stack([base - way * about.alpha_axes, base + way * about.alpha_axes])
    base, joints, home, ends = (unit.shown(part) for part in (base, joints, home, ends))
    points = np.concatenate([base, joints, home[None, :], *ends])
    # Matplotlib has no types for three dimensions.
    space: Any = figure.add_axes(_SPACE, projection="3d", computed_zorder=False)
    bound_view(space, unit, points)
    places = _places(figure, points)
    planes = [figure.add_axes(place) for place in places]
    for axes, columns in ((space, (0, 1, 2)), *zip(planes, _COLUMNS, strict=True)):
        for j in range(len(base)):
            axes.plot(*ends[:, j][:, columns].T, color=MUTED, linewidth=0.9)
        draw_robot(axes, base, joints, home, columns)
        axes.plot(*home[list(columns), None], color=INK, marker="+", markersize=7, linestyle="none")
    for axes, columns in zip(planes, _COLUMNS, strict=True):
        _bound_plane(axes, unit, points, columns)
    figure.text(_SPACE[0], _TOP + 0.01, _TITLES[0], fontsize=8.5, fontweight="bold")
    for axes, title in zip(planes, _TITLES[1:], strict=True):
        axes.set_title(title)
    fill_view(space, _SPACE)
    handles = [
        Line2D([], [], color=INK, label="base, platform"),
        Line2D([], [], color=MUTED, linewidth=0.9, label="first cardan axis"),
        Line2D([], [], color=INK, marker="+", linestyle="none", label="TCP"),
    ]
    figure.legend(handles=handles, loc="upper center", ncols=len(handles))


def _range(points: Array) -> tuple[Array, Array]:
    """Return the ends of what the views show, (3,) each."""
    low, high = np.min(points, axis=0), np.max(points, axis=0)
    air = _AIR * float(np.max(high - low))
    return low - air, high + air


def _places(figure: Figure, points: Array) -> tuple[View, View]:
    """Return where the plane views stand: one scale for both, as large as it gets."""
    low, high = _range(points)
    width, height = figure.get_size_inches()
    free = (_TOP - _BOTTOM - _BETWEEN) * height
    x, y, z = high - low
    scale = min(_WIDTH * width / x, free / (y + z))
    wide, above, front = (scale * x / width, scale * y / height, scale * z / height)
    left = _LEFT + (_WIDTH - wide) / 2
    upper = (left, _TOP - above, wide, above)
    return upper, (left, upper[1] - _BETWEEN - front, wide, front)


def _bound_plane(axes: Axes, unit: DisplayUnit, points: Array, columns: tuple[int, int]) -> None:
    from matplotlib.ticker import MaxNLocator

    across, up = columns
    low, high = _range(points)
    axes.set_xlim(low[across], high[across])
    axes.set_ylim(low[up], high[up])
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    axes.set_ylabel(unit.label(f"${_NAMES[up]}$"), labelpad=1)
    if columns == _COLUMNS[-1]:
        axes.set_xlabel(unit.label(f"${_NAMES[across]}$"), labelpad=1)
