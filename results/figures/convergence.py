"""How the search went: objective and violation over the iterations of all starts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter
from typing import TYPE_CHECKING, Any

import numpy as np

from constraints.arrays import Array
from expdesign.experiment import DesignRecord
from expdesign.experiment.record import Iteration
from expdesign.information.criteria import CRITERIA
from expdesign.recheck.limit_check import TOLERANCE
from expdesign.solver.events import STAGE_TITLES
from results.figures.drawing import centred_text, figure_definition
from results.notation import counted, plain_number
from results.style import EMPHASIS, GREY, INK, ORANGE

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

FLOOR = TOLERANCE
"""Smaller violations are drawn here: the recheck counts such a limit as kept."""
_SETTLED = 0.25
"""The scale of the objective leaves out this first part of every start."""
_BEYOND = 0.25
"""Of what the written design is above the worst in view: that much above it is in view, too."""
_LOGARITHMIC = 50.0
"""Objectives that differ by more than this factor get a logarithmic axis."""

_KEPT = 1e-2
"""Violation at its end up to which a start sets the scale of the iterations."""
_APART = 0.12
"""Names of stages that are closer than this share of the axis would overlap."""

_BEST, _OTHER, _HOP = "best", "starts", "hops"
_LOOK: dict[str, dict[str, Any]] = {
    _BEST: {"color": EMPHASIS, "linewidth": 1.5, "zorder": 3},
    _OTHER: {"color": GREY, "linewidth": 0.8, "zorder": 2},
    _HOP: {"color": ORANGE, "linewidth": 0.6, "alpha": 0.6, "zorder": 1.9},
}
_OPAQUE = 40
"""Lines of a kind up to which they are drawn as they are; more are fainter, so that all show."""
_FAINTEST = 0.08


@dataclass(frozen=True, eq=False)
class Trace:
    """The iterations of one start: number, objective and violation of each, (K,)."""

    start: int
    kind: str
    stages: tuple[str, ...]
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
        stages = tuple(point.stage for point in points)
        found.append(Trace(start, points[0].kind, stages, *numbers.T))
    return tuple(found)


@figure_definition(
    "convergence",
    "Objective (smoothed friction, as the optimiser sees it) and largest violation of a "
    "limit over the iterations of all starts.",
    height=4.4,
)
def convergence_figure(figure: Figure, record: DesignRecord) -> None:
    """Draw all starts, the one that the design came from in front."""
    from matplotlib.lines import Line2D

    found = traces(record.iterations)
    objective, violation = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    roles = [_role(trace, record.summary.solver.best_start) for trace in found]
    # One that cannot get within its limits may take far longer than all others.
    kept = [trace for trace in found if trace.violation[-1] <= _KEPT] or found
    longest = max((float(trace.iteration[-1]) for trace in kept), default=1.0)
    looks = {role: _LOOK[role] | {"alpha": _opacity(role, roles)} for role in _LOOK}
    for trace, role in zip(found, roles, strict=True):
        objective.plot(trace.iteration, trace.objective, **looks[role])
        violation.plot(trace.iteration, np.fmax(trace.violation, FLOOR), **looks[role])
        if role == _BEST:
            _mark_stages(objective, trace, longest)
    value_line = _objective_axis(objective, record, found)
    violation.set_yscale("log")
    violation.set_ylim(bottom=FLOOR / 2)
    violation.set_title("Largest violation of a limit")
    violation.set(ylabel="Share of its range (1)", xlabel=_iteration_label(record, found))
    if not found:
        centred_text(objective, "no iterations were recorded", height=0.7)
    first = min((float(trace.iteration[0]) for trace in found), default=0.0)
    violation.set_xlim(first - 0.02 * (longest - first) if first > 1 else 0, 1.02 * longest)
    handles = [
        Line2D([], [], **_LOOK[role], label=_label(role, roles)) for role in _LOOK if role in roles
    ] + value_line
    if handles:
        figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    figure.align_ylabels()


def _iteration_label(record: DesignRecord, found: Sequence[Trace]) -> str:
    criterion = CRITERIA.get(record.summary.criterion)
    stages = {stage for trace in found for stage in trace.stages}
    if not found or "blunt" in stages or criterion is None or not criterion.flat:
        return "Iteration of the start"
    log_det = CRITERIA["d"].named(record.configuration.run.design.information)
    return f"Iteration of the start (the rough search before is on {log_det})"


def _role(trace: Trace, best: int) -> str:
    if trace.start == best:
        return _BEST
    return _HOP if trace.kind == "hop" else _OTHER


def _opacity(role: str, roles: Sequence[str]) -> float:
    whole: float = _LOOK[role].get("alpha", 1.0)
    return max(_FAINTEST, whole * min(1.0, _OPAQUE / max(1, roles.count(role))))


def _label(role: str, roles: Sequence[str]) -> str:
    if role == _BEST:
        return "the best"
    return counted(roles.count(role), {_OTHER: "other start", _HOP: "hop"}[role])


def _mark_stages(axes: Axes, trace: Trace, longest: float) -> None:
    """Mark where the best start entered each stage, out of `longest` iterations in view."""
    written = -np.inf
    for k, stage in enumerate(trace.stages):
        if k and stage == trace.stages[k - 1]:
            continue
        at = trace.iteration[k]
        axes.axvline(at, color=EMPHASIS, linewidth=0.6, alpha=0.5, zorder=1)
        if at - written < _APART * longest:
            continue
        written = at
        axes.annotate(
            STAGE_TITLES.get(stage, stage),
            (at, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2),
            textcoords="offset points",
            color=EMPHASIS,
            fontsize="small",
        )


def _objective_axis(axes: Axes, record: DesignRecord, found: Sequence[Trace]) -> list[Line2D]:
    """Name the axis, scale it to what matters; draw and return the written design's value."""
    summary = record.summary
    criterion = CRITERIA.get(summary.criterion)
    information = record.configuration.run.design.information
    title = summary.criterion if criterion is None else criterion.named(information)
    scaling = {"si": "SI units", "nominal": "nominal scaling"}.get(summary.scaling, summary.scaling)
    invariant = criterion is not None and criterion.invariant
    axes.set_title("Objective, smoothed as the optimiser sees it", pad=13)
    axes.set_ylabel(f"{title} ({'SI units' if invariant else scaling})")
    settled, value = _settled(found), summary.criterion_value
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


def _settled(found: Sequence[Trace]) -> Array:
    parts = [trace.objective[int(_SETTLED * trace.objective.size) :] for trace in found]
    values = np.concatenate(parts) if parts else np.array([])
    return values[np.isfinite(values)]
