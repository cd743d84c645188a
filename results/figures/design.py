"""The figures of a design; here the shares of its limits and the eigenvalues of F."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import Container
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from constraints.arrays import Array
from expdesign.experiment import DesignResult
from expdesign.experiment.judging import criterion_symbol
from expdesign.information.criteria import criteria
from expdesign.information.identifiable import listed
from expdesign.recheck.limit_check import REACHED, TOLERANCE, LimitCheck
from expdesign.solver.phases import PHASE_TITLES, Iteration
from results.figures import motion
from results.figures.drawing import (
    ALERT,
    EMPHASIS,
    GREY,
    INK,
    MUTED,
    ORANGE,
    SECOND,
    add_legend_above,
    figure_definition,
    write_centred,
    write_margin,
    write_small,
)
from results.figures.parameters import precision_figure
from results.notation import count_text, handy_unit, percent, plain_number, readable, symbol

_ACTIVE = 100 * REACHED
"""From this share on, %, a limit counts as one that holds the design back."""
_DIGITS = (4, 5, 6)
_MOST = 130.0
_COLUMNS = (6.0, 92.0)
"""Offsets of the two texts of a bar, points."""
_BROKEN, _FULL, _FREE = "broken", f"at least {_ACTIVE:g} % used", f"below {_ACTIVE:g} %"
_LOOK: dict[str, dict[str, Any]] = {
    _BROKEN: {"color": ALERT},
    _FULL: {"color": EMPHASIS},
    _FREE: {"color": SECOND},
}


def _limits_seen(result: DesignResult) -> str:
    """Return the limits that are reached, or the one that is used most."""
    if not result.checks:
        return ""
    reached = [check.title for check in result.checks if check.used >= REACHED]
    if reached:
        return f"The design reaches {listed(reached)}."
    most = max(result.checks, key=lambda check: np.nan_to_num(check.used))
    return f"The design reaches none; {most.title} is used to {percent(most.used, 3)}."


@figure_definition(
    "limits_used",
    "Share of every limit that the design uses at its worst moment, with value, bound, "
    "place and time.",
    height=1.0,
    seen=_limits_seen,
)
def limits_used_figure(figure: Figure, result: DesignResult) -> None:
    """Draw one bar per limit, the fullest on top, with its worst moment at the right."""
    figure.set_figheight(0.9 + 0.27 * max(len(result.checks), 2))
    share = np.array([100 * check.used for check in result.checks])
    order = np.argsort(-np.nan_to_num(share, nan=np.inf), kind="stable")
    worst, share = [result.checks[k] for k in order], share[order]
    axes = figure.subplots()
    axes.set_xlabel("Share of the limit used at its worst moment (%)")
    if not worst:
        axes.set_yticks([])
        write_centred(axes, "this run has no limits")
        return
    most = max(100.0, min(float(np.fmax.reduce(share, initial=0.0)), _MOST))
    drawn = np.clip(np.nan_to_num(share, nan=most), 0, most)
    position = np.arange(len(worst), dtype=float)
    state = np.where(share >= _ACTIVE, _FULL, _FREE)
    state[[not check.kept for check in worst]] = _BROKEN
    handles: list[Container] = []
    for name, look in _LOOK.items():
        rows = state == name
        if np.any(rows):
            handles.append(axes.barh(position[rows], drawn[rows], height=0.62, label=name, **look))
    axes.axvline(100, color=INK, linewidth=0.9)
    axes.set_xlim(0, most)
    for k, check in enumerate(worst):
        colour = ALERT if state[k] == _BROKEN else INK
        write_margin(axes, position[k], _amount(check), colour, _COLUMNS[0])
        time = f"at {check.time:.2f} s" if np.isfinite(check.time) else ""
        moment = ", ".join(part for part in (symbol(check.row), time) if part)
        write_margin(axes, position[k], moment, colour, _COLUMNS[1])
    write_margin(axes, -0.85, "worst value (bound)", MUTED, _COLUMNS[0])
    write_margin(axes, -0.85, "where and when", MUTED, _COLUMNS[1])
    axes.set_yticks(position, [check.title[:1].upper() + check.title[1:] for check in worst])
    axes.set_ylim(len(worst) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    add_legend_above(axes, handles)


def _amount(check: LimitCheck) -> str:
    unit = handy_unit(check.unit, [check.bound])
    bound = unit.number(check.bound)
    # A value gets the digits that distinguish it from the bound.
    texts = (unit.number(check.value, digits) for digits in _DIGITS)
    value = next((text for text in texts if text != bound), bound)
    return f"{value} ({unit.quantity(check.bound)})"


_HEADROOM = 0.2
"""Free above the largest eigenvalue, for the text there, as a share of the decades shown."""


@figure_definition(
    "eigenvalues",
    "Eigenvalues of the scaled Fisher information matrix over one period, with their "
    "condition number.",
    height=2.9,
)
def eigenvalues_figure(figure: Figure, result: DesignResult) -> None:
    """Draw one panel per scaling, eigenvalues ascending over their index."""
    panels = {
        "Columns scaled to unit length": [value.unit_diagonal for value in result.eigenvalues],
        "Columns scaled by nominal values": [value.nominal for value in result.eigenvalues],
    }
    for axes, (title, values) in zip(figure.subplots(1, 2), panels.items(), strict=True):
        axes.set_title(title)
        axes.set_xlabel("Index of the eigenvalue")
        information = result.configuration.run.design.information
        axes.set_ylabel(f"Eigenvalue of scaled ${information}$ (dimensionless)")
        _stems(axes, np.array(values))


def _stems(axes: Axes, values: Array) -> None:
    index = np.arange(1, values.size + 1)
    positive = values > 0
    axes.set_yscale("log")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlim(0.2, values.size + 0.8)
    axes.grid(visible=False, axis="x")
    if not np.any(positive):
        write_centred(axes, "no eigenvalue is positive")
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
        text = f"condition number {readable(high / low, 3)}"
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


FLOOR = TOLERANCE
"""Smaller violations are drawn here: the recheck counts such a limit as kept."""
_SETTLED = 0.25
"""The scale of the objective leaves out this first part of every start."""
_BEYOND = 0.25
"""Room above the written design, as a share of its distance from the worst in view."""
_LOGARITHMIC = 50.0
"""Objectives that differ by more than this factor get a logarithmic axis."""
_KEPT = 1e-2
"""Violation at its end up to which a start sets the scale of the iterations."""
_APART = 0.12
"""Names of phases that are closer than this share of the axis would overlap."""
_BEST, _OTHER, _HOP = "best", "starts", "hops"
_LINES: dict[str, dict[str, Any]] = {
    _BEST: {"color": EMPHASIS, "linewidth": 1.5, "zorder": 3},
    _OTHER: {"color": GREY, "linewidth": 0.8, "zorder": 2},
    _HOP: {"color": ORANGE, "linewidth": 0.6, "alpha": 0.6, "zorder": 1.9},
}
_ROLE_NAMES = {_OTHER: "other start", _HOP: "hop"}
_OPAQUE = 40
"""Largest number of opaque lines of a kind; more lines are fainter, so that all are visible."""
_FAINTEST = 0.08


@dataclass(frozen=True, eq=False)
class Trace:
    """The iterations of one start: number, objective and violation of each, (K,)."""

    start: int
    kind: str
    phases: tuple[str, ...]
    iteration: Array
    objective: Array
    violation: Array


def traces(iterations: Sequence[Iteration]) -> tuple[Trace, ...]:
    """Return the iterations start by start, in the order of their numbers."""
    key = attrgetter("start", "iteration")
    found = []
    for start, group in groupby(sorted(iterations, key=key), attrgetter("start")):
        points = tuple(group)
        numbers = np.array([(p.iteration, p.objective, p.violation) for p in points])
        phases = tuple(point.phase for point in points)
        found.append(Trace(start, points[0].kind, phases, *numbers.T))
    return tuple(found)


@figure_definition(
    "convergence",
    "Objective (smoothed friction, as the optimiser sees it) and largest violation of a "
    "limit over the iterations of all starts.",
    height=4.4,
)
def convergence_figure(figure: Figure, result: DesignResult) -> None:
    """Draw all starts, the one that the design came from in front."""
    found = traces(result.iterations)
    objective, violation = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    best = result.solver.best_start
    roles = [
        _BEST if trace.start == best else _HOP if trace.kind == "hop" else _OTHER for trace in found
    ]
    # One that cannot get within its limits may take far longer than all others.
    kept = [trace for trace in found if trace.violation[-1] <= _KEPT] or found
    longest = max((float(trace.iteration[-1]) for trace in kept), default=1.0)
    looks, handles = {}, []
    for role, look in _LINES.items():
        count = roles.count(role)
        opacity = look.get("alpha", 1.0) * min(1.0, _OPAQUE / max(1, count))
        looks[role] = look | {"alpha": max(_FAINTEST, opacity)}
        label = "the best" if role == _BEST else count_text(count, _ROLE_NAMES[role])
        handles += [Line2D([], [], **look, label=label)] if count else []
    for trace, role in zip(found, roles, strict=True):
        objective.plot(trace.iteration, trace.objective, **looks[role])
        violation.plot(trace.iteration, np.fmax(trace.violation, FLOOR), **looks[role])
        if role == _BEST:
            _mark_phases(objective, trace, longest)
    value_line = _objective_axis(objective, result, found)
    violation.set_yscale("log")
    violation.set_ylim(bottom=FLOOR / 2)
    violation.set_title("Largest violation of a limit")
    violation.set(ylabel="Share of its range (1)", xlabel=_iteration_label(result, found))
    if not found:
        write_centred(objective, "no iterations were recorded", height=0.7)
    first = min((float(trace.iteration[0]) for trace in found), default=0.0)
    violation.set_xlim(first - 0.02 * (longest - first) if first > 1 else 0, 1.02 * longest)
    handles += value_line
    if handles:
        figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    figure.align_ylabels()


def _iteration_label(result: DesignResult, found: Sequence[Trace]) -> str:
    criterion = criteria().get(result.criterion)
    phases = {phase for trace in found for phase in trace.phases}
    if not found or "blunt" in phases or criterion is None or not criterion.flat:
        return "Iteration of the start"
    log_det = criteria()["d"].named(result.configuration.run.design.information)
    return f"Iteration of the start (the rough search before is on {log_det})"


def _mark_phases(axes: Axes, trace: Trace, longest: float) -> None:
    """Mark where the best start entered each phase, out of `longest` iterations in view."""
    written = -np.inf
    for k, phase in enumerate(trace.phases):
        if k and phase == trace.phases[k - 1]:
            continue
        at = trace.iteration[k]
        axes.axvline(at, color=EMPHASIS, linewidth=0.6, alpha=0.5, zorder=1)
        if at - written < _APART * longest:
            continue
        written = at
        title, above = PHASE_TITLES.get(phase, phase), ("data", "axes fraction")
        write_small(axes, title, (at, 1.0), (0, 2), xycoords=above, color=EMPHASIS)


def _objective_axis(axes: Axes, result: DesignResult, found: Sequence[Trace]) -> list[Line2D]:
    """Name the axis, scale it to what matters; draw and return the written design's value."""
    criterion = criteria().get(result.criterion)
    information = criterion_symbol(result.configuration)
    title = result.criterion if criterion is None else criterion.named(information)
    scaling = {"si": "SI units", "nominal": "nominal scaling"}.get(result.scaling, result.scaling)
    invariant = criterion is not None and criterion.invariant
    axes.set_title("Objective, smoothed as the optimiser sees it", pad=13)
    axes.set_ylabel(f"{title} ({'SI units' if invariant else scaling})")
    parts = [trace.objective[int(_SETTLED * trace.objective.size) :] for trace in found]
    settled, value = np.concatenate([*parts, []]), result.criterion_value
    settled = settled[np.isfinite(settled)]
    shown = np.append(settled, value) if np.isfinite(value) else settled
    if np.isfinite(value) and criterion is not None and criterion.larger_is_better:
        # What is better by far has left the limits behind, and does not set the scale.
        shown = np.minimum(shown, value + _BEYOND * (value - np.min(shown)))
    if shown.size and np.min(shown) > 0 and np.max(shown) > _LOGARITHMIC * np.min(shown):
        axes.set_yscale("log")
        axes.set_ylim(np.min(shown) / 1.5, np.max(shown) * 1.5)
    elif shown.size:
        air = 0.06 * (np.ptp(shown) or 1.0)
        axes.set_ylim(np.min(shown) - air, np.max(shown) + air)
    if not np.isfinite(value):
        return []
    label = f"written design, not smoothed: {plain_number(value, 5)}"
    return [axes.axhline(value, color=INK, linewidth=0.9, dashes=(4, 2), zorder=4, label=label)]


DESIGN_FIGURES = (
    motion.excitation_figure,
    motion.path_figure,
    motion.struts_figure,
    motion.cardan_angles_figure,
    limits_used_figure,
    precision_figure,
    eigenvalues_figure,
    convergence_figure,
)
"""All figures of a design, in the order in which a report shows them."""
