"""Draw the frames and bodies of docs/model.md: python docs/figures/frames_and_bodies.py."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon

from constraints.arrays import Array
from results.figures.drawing import (
    MUTED,
    PAGE_WIDTH,
    RESOLUTION,
    STRUT_COLOURS,
    house_style,
    new_figure,
)

A, B, TCP = np.array([1.1, 0.5]), np.array([2.75, 3.35]), np.array([5.0, 4.55])
TILT = np.radians(9)
"""Of the platform."""
PARTS = dict(zip(("ring", "stator", "slider", "platform", "payload"), STRUT_COLOURS, strict=False))


def _bar(axes: Axes, start: Array, end: Array, width: float, colour: str) -> None:
    along = (end - start) / np.linalg.norm(end - start)
    across = width / 2 * np.array([-along[1], along[0]])
    corners = [start - across, end - across, end + across, start + across]
    axes.add_patch(Polygon(corners, facecolor=colour, edgecolor=colour, alpha=0.35, linewidth=1.2))


def _frame(
    axes: Axes, origin: Array, names: tuple[str, str, str], angle: float, size: float = 0.75
) -> None:
    """Draw a frame: its first and third axis in the plane, its second out of it or into it."""
    first, second, third = names
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for vector, name in ((turn @ [size, 0], first), (turn @ [0, size], third)):
        axes.annotate(
            "",
            origin + vector,
            (origin[0], origin[1]),
            arrowprops={"arrowstyle": "-|>", "color": "black", "shrinkA": 0, "shrinkB": 0},
        )
        _name(axes, origin + 1.22 * vector, name)
    axes.add_patch(Circle(tuple(origin), 0.07, facecolor="white", edgecolor="black", zorder=5))
    for slope in (1, -1):
        ends = np.array([[-1, -slope], [1, slope]]) * 0.045
        axes.plot(
            origin[0] + ends[:, 0], origin[1] + ends[:, 1], color="black", linewidth=0.9, zorder=6
        )
    _name(axes, origin - turn @ [0.3, 0.16], second)


def _name(axes: Axes, place: Array, text: str) -> None:
    axes.text(float(place[0]), float(place[1]), text, ha="center", va="center", fontsize=9)


def _label(axes: Axes, place: tuple[float, float], text: str, colour: str = "black") -> None:
    axes.text(place[0], place[1], text, color=colour, fontsize=9, va="center", ha="left")


def main() -> None:
    """Write the picture beside this file."""
    with house_style():
        figure = new_figure(4.6, PAGE_WIDTH)
        axes = figure.subplots()
        along = (B - A) / np.linalg.norm(B - A)
        lean = np.arctan2(-along[0], along[1])
        level = np.array([np.cos(TILT), np.sin(TILT)])
        up = np.array([-level[1], level[0]])
        # base, ring, stator and slider, platform and payload
        axes.plot([-0.2, 6.6], [0.05, 0.05], color=MUTED, linewidth=3)
        axes.plot([A[0], A[0]], [0.05, A[1]], color=MUTED, linewidth=3)
        _bar(axes, A + 0.5 * along, A + 2.25 * along, 0.5, PARTS["stator"])
        axes.plot(
            [A[0], A[0] + 0.5 * along[0]],
            [A[1], A[1] + 0.5 * along[1]],
            color=PARTS["stator"],
            linewidth=2,
        )
        _bar(axes, A + 1.35 * along, B, 0.2, PARTS["slider"])
        axes.add_patch(Circle(tuple(A), 0.2, fill=False, edgecolor=PARTS["ring"], linewidth=3))
        middle = TCP - 0.85 * up
        _bar(axes, B - 0.35 * level, B + 4.3 * level, 0.3, PARTS["platform"])
        _bar(
            axes,
            middle + 0.2 * level + 0.1 * up,
            middle + 0.2 * level + 0.75 * up,
            0.7,
            PARTS["payload"],
        )
        _frame(axes, np.array([4.7, 0.05]), ("$x$", "$y$", "$z$"), 0.0)
        _frame(axes, A, ("$x$", "$y$", "$z$"), lean)
        _frame(axes, B, ("$x$", "$y$", "$z$"), lean)
        _frame(axes, TCP, ("$x_E$", "$y_E$", "$z_E$"), TILT)
        _label(axes, (5.05, 0.3), "base frame, gravity against $z$", MUTED)
        _label(axes, (1.75, 0.9), "$A$: ring, stator;  $y = e_\\beta$, $z = u$")
        _label(axes, (3.75, 2.85), "$B$: slider;  $y = e_\\beta$, $z = u$")
        _label(axes, (5.35, 5.0), "TCP: platform and payload")
        _label(axes, (0.2, 0.75), "ring", PARTS["ring"])
        _label(axes, (0.75, 1.9), "stator", PARTS["stator"])
        _label(axes, (1.65, 2.95), "slider", PARTS["slider"])
        _label(axes, (6.0, 3.55), "platform", PARTS["platform"])
        _label(axes, (5.75, 4.25), "payload", PARTS["payload"])
        axes.set_aspect("equal")
        axes.set_xlim(-0.3, 7.6)
        axes.set_ylim(-0.2, 5.6)
        axes.axis("off")
        path = Path(__file__).with_suffix(".png")
        figure.savefig(path, dpi=RESOLUTION)


if __name__ == "__main__":
    main()
