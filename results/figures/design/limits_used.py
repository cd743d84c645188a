"""How much of every limit the design uses."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import Container
from matplotlib.figure import Figure

from expdesign.experiment import DesignRecord
from expdesign.recheck.judge import LimitCheck
from results.figures.drawing import FigureDefinition, legend_above
from results.style import ALERT, EMPHASIS, INK, MUTED, SECOND, new_figure
from results.symbols import symbol
from results.units import handy_unit

_ACTIVE = 99.0
"""From this share on, %, a limit counts as one that holds the design back."""
_DIGITS = (4, 5, 6)
_MOST = 130.0
_COLUMNS = (6.0, 92.0)
"""Of the texts beside the bars, points."""

_BROKEN, _FULL, _FREE = "broken", f"at least {_ACTIVE:g} % used", f"below {_ACTIVE:g} %"
_LOOK: dict[str, dict[str, Any]] = {
    _BROKEN: {"color": ALERT},
    _FULL: {"color": EMPHASIS},
    _FREE: {"color": SECOND},
}


def draw(record: DesignRecord) -> Figure:
    """Draw one bar per limit, the fullest on top, with the worst moment beside it."""
    worst = list(record.checks)
    share = np.array([100 * check.used for check in worst])
    order = np.argsort(-np.nan_to_num(share, nan=np.inf), kind="stable")
    worst, share = [worst[k] for k in order], share[order]
    figure = new_figure(0.9 + 0.27 * max(len(worst), 2))
    axes = figure.subplots()
    axes.set_xlabel("Share of the limit used at its worst moment (%)")
    if not worst:
        axes.set_yticks([])
        axes.text(0.5, 0.5, "this run has no limits", transform=axes.transAxes, ha="center")
        return figure
    most = max(100.0, min(float(np.fmax.reduce(share, initial=0.0)), _MOST))
    drawn = np.clip(np.nan_to_num(share, nan=most), 0, most)
    position = np.arange(len(worst), dtype=float)
    state = np.array([_state(check) for check in worst])
    handles: list[Container] = []
    for name, look in _LOOK.items():
        rows = state == name
        if np.any(rows):
            handles.append(axes.barh(position[rows], drawn[rows], height=0.62, label=name, **look))
    axes.axvline(100, color=INK, linewidth=0.9)
    axes.set_xlim(0, most)
    for k, check in enumerate(worst):
        colour = ALERT if state[k] == _BROKEN else INK
        _beside(axes, position[k], _COLUMNS[0], _amount(check), colour)
        _beside(axes, position[k], _COLUMNS[1], _moment(check), colour)
    for offset, text in zip(_COLUMNS, ("worst value (bound)", "where and when"), strict=True):
        _beside(axes, -0.85, offset, text, MUTED)
    axes.set_yticks(position, [check.title[:1].upper() + check.title[1:] for check in worst])
    axes.set_ylim(len(worst) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    legend_above(axes, handles)
    return figure


def _state(check: LimitCheck) -> str:
    if not check.kept:
        return _BROKEN
    return _FULL if 100 * check.used >= _ACTIVE else _FREE


def _beside(axes: Axes, row: float, offset: float, text: str, colour: str) -> None:
    """Write a text right of the axes, in points from their edge."""
    axes.annotate(
        text,
        (1.0, row),
        xycoords=("axes fraction", "data"),
        xytext=(offset, 0),
        textcoords="offset points",
        va="center",
        fontsize="small",
        color=colour,
        annotation_clip=False,
    )


def _amount(check: LimitCheck) -> str:
    unit = handy_unit(check.unit, [check.bound])
    bound = unit.number(check.bound)
    # A value that is not the bound does not read as if it were: it gets the digits that tell.
    texts = (unit.number(check.value, digits) for digits in _DIGITS)
    value = next((text for text in texts if text != bound), bound)
    return f"{value} ({unit.quantity(check.bound)})"


def _moment(check: LimitCheck) -> str:
    time = f"at {check.time:.2f} s" if np.isfinite(check.time) else ""
    return ", ".join(part for part in (symbol(check.row), time) if part)


FIGURE = FigureDefinition(
    key="limits_used",
    caption="Share of every limit that the design uses at its worst moment, with value, bound, "
    "place and time.",
    draw=draw,
)
