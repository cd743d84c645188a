"""A panel with the curves of all struts between the limits that hold for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes

from constraints import Limit
from constraints.arrays import Array
from results.style import FORBIDDEN, INK, MUTED, STRUT_COLOURS
from results.units import DisplayUnit, handy_unit

_SHARE = 6.0
"""Limits are in view when their range is at most this many spans of the curves …"""
_NEAR = 1.0
"""… and each of them when it is at most this many spans away."""
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
    axes.set_title(quantity.title)
    axes.set_ylabel(unit.label(quantity.label))
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
