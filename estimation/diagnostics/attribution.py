"""What the residuals come from: forward selection among causes, judged together, with rivals.

An unmodelled force in one strut also leaves traces in the others, through the parameters that it
has moved and through correlated noise. Therefore the most significant effect is taken as known,
with its columns among the unknowns, and all others are tested again, until none is left. Then all
that were selected are judged beside each other, and what is not significant there is dropped; an
effect gives way to another that explains more in its place. As long as there is no effect nothing
is selected but at the levels of the families.

An effect is named for sure when no rival is left: another candidate, put in its place, would have
to leave nothing significant for the effect itself. Rivals that do are named with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from estimation.diagnostics.cause import Cause
from estimation.diagnostics.channel_test import POSITION_PERIODIC, Strut
from estimation.diagnostics.joint_system import JointSystem, SolvedSystem
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.position_periodic import (
    PeriodicForce,
    PitchScan,
    periodic_force,
)
from estimation.diagnostics.search import (
    PERIODIC,
    Candidate,
    EffectTests,
    Search,
    periodic_fit,
    places_of,
    without,
)
from estimation.diagnostics.signature import Signature
from expdesign.runfolder import Numbers, OpenNumber, described

REMAINDER = 0.02
"""Share of the strongest effect's statistic below which another may be what it leaves."""
_MOST = 12
"""Effects that are looked for: whoever has more needs another model."""


@dataclass(frozen=True)
class Rival:
    """Another effect that explains the residuals about as well in the place of one."""

    kind: Annotated[str, described("", "as of an effect")]
    strut: Annotated[Strut, described("1", "number of the strut; null: all of them")]
    parameter: Annotated[str, described("", "as of an effect")]
    log_p: Annotated[OpenNumber, described("1", "logarithm of p in the effect's place")]


@dataclass(frozen=True, eq=False)
class Effect:
    """Something in the residuals that the model does not have, fitted with all other effects."""

    kind: Annotated[str, described("", "position-periodic, or a family of causes")]
    strut: Annotated[Strut, described("1", "number of the strut; null: all of them")]
    parameter: Annotated[
        str, described("", "of a column; base or platform of a joint; empty otherwise")
    ]
    log_p: Annotated[
        OpenNumber,
        described("1", "logarithm of p beside all other effects, corrected for its family"),
    ]
    force: Annotated[PeriodicForce | None, described("", "of a position-periodic effect")]
    value: Annotated[OpenNumber, described("SI", "its size, or the first of its values")]
    std: Annotated[OpenNumber, described("SI", "standard deviation of the value")]
    values: Annotated[Numbers, described("SI", "all of its values: coordinates of a joint")]
    stds: Annotated[Numbers, described("SI", "their standard deviations")]
    constant: Annotated[OpenNumber, described("SI", "a speed, of Stribeck friction")]
    rivals: Annotated[
        tuple[Rival, ...], described("", "that explain it about as well; empty: it is sure")
    ]

    remainder: Annotated[
        bool, described("", "so weak beside another that it may be what linearising that leaves")
    ] = False

    @property
    def sure(self) -> bool:
        """Whether nothing else explains the same."""
        return not self.rivals and not self.remainder


@dataclass(frozen=True, eq=False)
class Attribution:
    """All tests of effects."""

    causes: tuple[Cause, ...]
    """The families that were tested."""
    effects: tuple[Effect, ...]
    """What was found, most significant first."""
    first: EffectTests
    last: EffectTests
    """Before any effect is taken as known, and with all of them."""
    found: Signature
    """Columns of all effects."""
    best_forces: tuple[PeriodicForce | None, ...]
    """The best-fitting position-periodic force of every strut, significant or not."""
    periodic_level: float
    """Of all scans together."""


def attribute(
    system: JointSystem,
    part: Linearisation,
    families: tuple[Cause, ...],
    step: float,
    *,
    experiments: int = 1,
) -> Attribution:
    """Find the effects in the residuals of one experiment.

    Parameters
    ----------
    families : tuple of Cause
        What is looked for beside forces that are periodic in a strut's length.
    step : float
        Between two samples, s.
    experiments : int
        How many share the level of the periodic forces; those of the families are their own.
    """
    search = Search(system, part, families, step, POSITION_PERIODIC / experiments)
    first = last = search.tests(())
    found: list[Candidate] = []
    beside: list[Candidate] = []  # what the last tests were made beside
    seen: set[frozenset[tuple[str, int | None, str]]] = set()
    while len(found) < _MOST:
        best = search.most_significant(last, found)
        if best is None:
            break
        found = search.significant([*found, best])
        names = frozenset(item.name for item in found)
        if names in seen:
            break
        seen.add(names)
        last, beside = search.tests(found), found
    found, rivals = search.settled(found)
    if {id(item) for item in found} != {id(item) for item in beside}:
        last = search.tests(found) if found else first
    effects = _effects(search, found, rivals)
    known = {e.strut: e.force for e in reversed(effects) if e.force is not None}
    best_forces = tuple(
        known[scan.strut] if scan.strut in known else _best_force(last.solved, part, scan)
        for scan in last.scans
    )
    columns = search.signature.picked(places_of(found))
    return Attribution(families, effects, first, last, columns, best_forces, search.level)


def _effects(
    search: Search,
    found: Sequence[Candidate],
    rivals: Sequence[tuple[tuple[Candidate, float], ...]],
) -> tuple[Effect, ...]:
    """Fit all effects together."""
    fit = search.projection.beside(()).fit(places_of(found))
    effects, first = [], 0
    sizes = [search.statistic_beside(item, without(found, item)) for item in found]
    for item, others, size in zip(found, rivals, sizes, strict=True):
        chosen = slice(first, first + len(item.places))
        first = chosen.stop
        values, covariance = fit.values[chosen], fit.covariance[chosen, chosen]
        stds = np.sqrt(np.diag(covariance))
        if item.sized_by_constant:
            values = np.array([item.constant])
        force, value, std = None, float(values[0]), float(stds[0])
        if item.kind == PERIODIC and item.strut is not None:
            force = periodic_force(search.part, item.strut, item.pitch, values, covariance)
            value, std = force.amplitude, force.amplitude_std
        log_p = search.log_p_beside(item, without(found, item)) - item.limit
        level = _level(search, item.kind)
        effects.append(
            Effect(
                kind=item.kind,
                strut=item.strut,
                parameter=item.parameter,
                log_p=log_p + float(np.log(level)),
                force=force,
                value=value,
                std=std,
                values=values,
                stds=stds,
                constant=item.constant,
                remainder=size < REMAINDER * max(sizes),
                rivals=tuple(Rival(*rival.name, p) for rival, p in others),
            )
        )
    return tuple(effects)


def _level(search: Search, kind: str) -> float:
    if kind == PERIODIC:
        return search.level
    return next(cause.level for cause in search.families if cause.kind == kind)


def _best_force(solved: SolvedSystem, part: Linearisation, scan: PitchScan) -> PeriodicForce | None:
    if not np.isfinite(scan.best_pitch) or scan.best <= 0:
        return None
    _, values, covariance = periodic_fit(solved, part, scan)
    return periodic_force(part, scan.strut, scan.best_pitch, values, covariance)
