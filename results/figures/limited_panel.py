"""A panel with the curves of all struts between the limits that hold for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from constraints import Limit
from results.style import FORBIDDEN, INK, MUTED, STRUT_COLOURS
from results.units import DisplayUnit, handy_unit

Array = NDArray[np.float64]

_FARTHEST = 2.5
"""A bound that is farther from the curves than this many of their spans is not in view."""
_BAND = 0.11
"""Height of the forbidden area in view, as a share of what lies between."""
_AIR = 0.06


@dataclass(frozen=True)
class StrutQuantity:
    """A quantity that every strut has.

    Attributes
    ----------
    title : str
        Of the panel.
    label : str
        Of its axis, without the unit.
    unit : str
        SI unit.
    limit : str
        Key of the limit that bounds it.
    """

    title: str
    label: str
    unit: str
    limit: str


def limited_panel(
    axes: Axes, quantity: StrutQuantity, time: Array, values: Array, limit: Limit | None
) -> None:
    """Draw the curves, shade what the limit forbids and write the bounds into the shade.

    Where bounds differ from strut to strut, the shade begins at the widest, and each strut's own
    bound is a dashed line in its colour.

    Parameters
    ----------
    axes : Axes
    quantity : StrutQuantity
    time : (N,)
        s.
    values : (N, 6)
        SI.
    limit : Limit or None
        None when the quantity is not limited.
    """
    nothing = np.full(values.shape[1], np.inf)
    lower = -nothing if limit is None else limit.lower
    upper = nothing if limit is None else limit.upper
    finite = np.concatenate([values.ravel(), lower, upper])
    unit = handy_unit(quantity.unit, finite[np.isfinite(finite)])
    for j, colour in enumerate(STRUT_COLOURS):
        axes.plot(time, unit.shown(values[:, j]), color=colour, label=f"strut {j + 1}")
    axes.set_xlim(time[0], time[-1])
    axes.set_title(quantity.title)
    axes.set_ylabel(unit.label(quantity.label))
    _show_bounds(axes, unit, values, lower, upper)


def _show_bounds(axes: Axes, unit: DisplayUnit, values: Array, lower: Array, upper: Array) -> None:
    low, high = float(np.min(values)), float(np.max(values))
    span = (high - low) or max(abs(high), 1.0) * 1e-3
    sides = {
        "below": (lower, float(np.min(lower)), low - float(np.min(lower))),
        "above": (upper, float(np.max(upper)), float(np.max(upper)) - high),
    }
    seen = {side: gap <= _FARTHEST * span for side, (_, _, gap) in sides.items()}
    bottom = min(low, sides["below"][1]) if seen["below"] else low
    top = max(high, sides["above"][1]) if seen["above"] else high
    height = top - bottom
    edges = {
        "below": bottom - (_BAND if seen["below"] else _AIR) * height,
        "above": top + (_BAND if seen["above"] else _AIR) * height,
    }
    for side, (bounds, widest, _) in sides.items():
        if seen[side]:
            _forbid(axes, unit, bounds, widest, edges[side])
    axes.set_ylim(*unit.shown([edges["below"], edges["above"]]))
    hidden = [
        _bounds_text(unit, bounds)
        for side, (bounds, widest, _) in sides.items()
        if np.isfinite(widest) and not seen[side]
    ]
    if hidden:
        text = f"out of view: {' and '.join(hidden)}"
        axes.set_title(text, loc="right", fontsize="small", fontweight="normal", color=MUTED)


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
    least = DisplayUnit("", unit.factor).quantity(smallest)
    return f"limits by strut {least} … {unit.quantity(largest)}"
