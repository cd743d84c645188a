"""The figures of a design; here the shares of its limits and the eigenvalues of F."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from constraints.arrays import Array
from expdesign.experiment import DesignRecord
from expdesign.recheck.limit_check import REACHED, LimitCheck
from results.figures.convergence import convergence_figure
from results.figures.drawing import centred_text, figure_definition, legend_above, margin_text
from results.figures.motion import cardan_angles_figure, excitation_figure, struts_figure
from results.figures.parameters import precision_figure
from results.figures.path import path_figure
from results.notation import handy_unit, symbol
from results.style import ALERT, EMPHASIS, INK, MUTED, SECOND

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.container import Container
    from matplotlib.figure import Figure

_ACTIVE = 100 * REACHED
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


@figure_definition(
    "limits_used",
    "Share of every limit that the design uses at its worst moment, with value, bound, "
    "place and time.",
    height=1.0,
)
def limits_used_figure(figure: Figure, record: DesignRecord) -> None:
    """Draw one bar per limit, the fullest on top, with the worst moment beside it."""
    figure.set_figheight(0.9 + 0.27 * max(len(record.checks), 2))
    share = np.array([100 * check.used for check in record.checks])
    order = np.argsort(-np.nan_to_num(share, nan=np.inf), kind="stable")
    worst, share = [record.checks[k] for k in order], share[order]
    axes = figure.subplots()
    axes.set_xlabel("Share of the limit used at its worst moment (%)")
    if not worst:
        axes.set_yticks([])
        centred_text(axes, "this run has no limits")
        return
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
        margin_text(axes, position[k], _amount(check), colour, _COLUMNS[0])
        margin_text(axes, position[k], _moment(check), colour, _COLUMNS[1])
    margin_text(axes, -0.85, "worst value (bound)", MUTED, _COLUMNS[0])
    margin_text(axes, -0.85, "where and when", MUTED, _COLUMNS[1])
    axes.set_yticks(position, [check.title[:1].upper() + check.title[1:] for check in worst])
    axes.set_ylim(len(worst) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    legend_above(axes, handles)


def _state(check: LimitCheck) -> str:
    if not check.kept:
        return _BROKEN
    return _FULL if 100 * check.used >= _ACTIVE else _FREE


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


_HEADROOM = 0.2
"""Free above the largest eigenvalue, for the text there, as a share of the decades shown."""
_MANY = 4
"""Digits before the point from which on a number is written with a power of ten."""


@figure_definition(
    "eigenvalues",
    "Eigenvalues of the scaled Fisher information matrix over one period, with their "
    "condition number.",
    height=2.9,
)
def eigenvalues_figure(figure: Figure, record: DesignRecord) -> None:
    """Draw one panel per scaling, eigenvalues ascending over their index."""
    panels = {
        "Columns scaled to unit length": [value.unit_diagonal for value in record.eigenvalues],
        "Columns scaled by nominal values": [value.nominal for value in record.eigenvalues],
    }
    for axes, (title, values) in zip(figure.subplots(1, 2), panels.items(), strict=True):
        axes.set_title(title)
        axes.set_xlabel("Index of the eigenvalue")
        information = record.configuration.run.design.information
        axes.set_ylabel(f"Eigenvalue of scaled ${information}$ (dimensionless)")
        _stems(axes, np.array(values))


def _stems(axes: Axes, values: Array) -> None:
    from matplotlib.ticker import MaxNLocator

    index = np.arange(1, values.size + 1)
    positive = values > 0
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0.2, values.size + 0.8)
    axes.grid(visible=False, axis="x")
    if not np.any(positive):
        centred_text(axes, "no eigenvalue is positive")
        return
    low, high = float(np.min(values[positive])), float(np.max(values[positive]))
    decades = max(np.log10(high / low), 1.0)
    floor = low / 10 ** (0.08 * decades)
    axes.set_ylim(floor, high * 10 ** (_HEADROOM * decades))
    axes.vlines(index[positive], floor, values[positive], color=EMPHASIS, linewidth=1.1)
    axes.plot(
        index[positive], values[positive], "o", color=EMPHASIS, markersize=3.4, label="eigenvalues"
    )
    if np.all(positive):
        text = f"condition number {_power(high / low)}"
    else:
        text = f"{np.count_nonzero(~positive)} not positive: singular to working precision"
        lost = index[~positive]
        axes.plot(
            lost, np.full(lost.size, floor), "x", color=ALERT, markersize=5, clip_on=False, zorder=4
        )
    axes.annotate(
        text,
        (0.02, 0.975),
        xycoords="axes fraction",
        va="top",
        color=MUTED,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )


def _power(value: float) -> str:
    exponent = int(np.floor(np.log10(value)))
    if exponent < _MANY:
        return f"{float(f'{value:.3g}'):g}"
    return rf"${value / 10.0**exponent:.1f} \times 10^{{{exponent}}}$"


DESIGN_FIGURES = (
    excitation_figure,
    path_figure,
    struts_figure,
    cardan_angles_figure,
    limits_used_figure,
    precision_figure,
    eigenvalues_figure,
    convergence_figure,
)
"""All figures of a design, in the order in which a report shows them."""
