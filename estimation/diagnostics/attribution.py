"""What the residuals come from: forward selection among position-periodic forces, columns, delay.

An unmodelled force in one strut also leaves traces in the others, through the parameters that it
has moved and through correlated noise. Therefore the most significant effect is taken as known,
with its columns among the unknowns, and all others are tested again, until none is left. As long
as there is no effect nothing is selected but at the levels of the families.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.channel_test import POSITION_PERIODIC, Strut
from estimation.diagnostics.column_test import Cause, ColumnTest, causes, column_test
from estimation.diagnostics.joint_system import JointSystem, SolvedSystem
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.position_periodic import (
    PeriodicForce,
    PitchScan,
    periodic_columns,
    periodic_force,
    scan_pitches,
)
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.runfolder import OpenNumber, described

_MOST = 12
"""Effects that are looked for: whoever has more needs another model."""


@dataclass(frozen=True)
class Effect:
    """Something in the residuals that the model does not have, fitted with all other effects."""

    kind: Annotated[str, described("", "position-periodic, or a cause: column, delay")]
    strut: Annotated[Strut, described("1", "number of the strut; null: all of them")]
    parameter: Annotated[str, described("", "of a column; empty otherwise")]
    log_p: Annotated[
        OpenNumber,
        described("1", "logarithm of p, corrected for its family, when it was found"),
    ]
    force: Annotated[PeriodicForce | None, described("", "of a position-periodic effect")]
    value: Annotated[OpenNumber, described("SI", "of a column or the delay")]
    std: Annotated[OpenNumber, described("SI", "standard deviation of the value")]


@dataclass(frozen=True, eq=False)
class EffectTests:
    """The search for effects in the residuals of one experiment, with some taken as known."""

    solved: SolvedSystem
    """The fit with these effects among its unknowns."""
    scans: tuple[PitchScan, ...]
    """Of the six struts."""
    families: Mapping[str, ColumnTest]
    """The test of every family of columns, by its kind."""


@dataclass(frozen=True, eq=False)
class Attribution:
    """All tests of effects."""

    causes: tuple[Cause, ...]
    """The families of columns that were tested."""
    effects: tuple[Effect, ...]
    """What was selected, most significant first."""
    first: EffectTests
    last: EffectTests
    """Before any effect is taken as known, and with all of them."""
    best_forces: tuple[PeriodicForce | None, ...]
    """The best-fitting position-periodic force of every strut, significant or not."""
    periodic_level: float
    """Of all scans together."""


@dataclass(frozen=True, eq=False)
class _Found:
    """A selected effect with its columns."""

    kind: str
    strut: int | None
    parameter: str
    log_p: float
    pitch: float
    columns: Array


def attribute(
    system: JointSystem,
    part: Linearisation,
    names: tuple[str, ...],
    step: float,
    *,
    held_out: bool,
    experiments: int = 1,
) -> Attribution:
    """Find the effects in the residuals of one experiment.

    Parameters
    ----------
    names : tuple of str
        Of the regressor's columns.
    step : float
        Between two samples, s.
    held_out, experiments
        As of `causes`.
    """
    families = causes(part, names, held_out=held_out, experiments=experiments)
    level = POSITION_PERIODIC / experiments

    def tested(solved: SolvedSystem) -> EffectTests:
        return EffectTests(
            solved,
            tuple(scan_pitches(solved, part, strut, step, level) for strut in range(ACTUATORS)),
            {cause.kind: column_test(solved, cause) for cause in families},
        )

    first = last = tested(system.solved)
    found: list[_Found] = []
    while len(found) < _MOST:
        best = _most_significant(last, part, families, level)
        if best is None:
            break
        found.append(best)
        last = tested(system.with_columns(np.concatenate([f.columns for f in found], 2)).solved)
    effects = _fitted(system.solved, part, found)
    known = {e.strut: e.force for e in reversed(effects) if e.force is not None}
    best_forces = tuple(
        known[scan.strut] if scan.strut in known else _best_force(last.solved, part, scan)
        for scan in last.scans
    )
    return Attribution(families, effects, first, last, best_forces, level)


def _most_significant(
    tests: EffectTests, part: Linearisation, families: tuple[Cause, ...], level: float
) -> _Found | None:
    """Return the effect with the smallest p-value, corrected for its family, if significant.

    Families of equal significance are compared by what the selection risks: p relative to level,
    which is that of all scans.
    """
    scan = min(tests.scans, key=attrgetter("log_p"))
    log_p = scan.log_p + float(np.log(ACTUATORS))
    relative, found = log_p - np.log(level), None
    for cause in families:
        test = tests.families[cause.kind]
        if not test.tested:
            continue
        own = float(test.columns[test.best].log_p + np.log(test.tested / cause.level))
        if own < relative:
            relative, found = own, cause
    if relative >= 0:
        return None
    if found is None:
        columns, _, _ = _periodic_fit(tests.solved, part, scan)
        return _Found("position-periodic", scan.strut, "", log_p, scan.best_pitch, columns)
    index = tests.families[found.kind].best
    name, strut = found.labels[index]
    log_p = relative + float(np.log(found.level))
    return _Found(found.kind, strut, name, log_p, np.nan, found.columns[:, :, [index]])


def _fitted(base: SolvedSystem, part: Linearisation, found: list[_Found]) -> tuple[Effect, ...]:
    """Fit all effects together."""
    if not found:
        return ()
    values, covariance = base.fitted(np.concatenate([f.columns for f in found], axis=2))
    effects, first = [], 0
    for item in found:
        chosen = slice(first, first + item.columns.shape[2])
        first = chosen.stop
        force = None
        value = float(values[chosen.start])
        std = float(np.sqrt(covariance[chosen.start, chosen.start]))
        if item.kind == "position-periodic" and item.strut is not None:
            block = covariance[chosen, chosen]
            force = periodic_force(part, item.strut, item.pitch, values[chosen], block)
            value, std = force.amplitude, force.amplitude_std
        effects.append(Effect(item.kind, item.strut, item.parameter, item.log_p, force, value, std))
    return tuple(effects)


def _periodic_fit(
    solved: SolvedSystem, part: Linearisation, scan: PitchScan
) -> tuple[Array, Array, Array]:
    """Return the three columns of the best pitch of a strut, their coefficients and covariance."""
    fixed = periodic_columns(part, scan.strut, scan.best_pitch, (0.0, 0.0))[:, :, :2]
    (a, b), _ = solved.fitted(fixed)
    columns = periodic_columns(part, scan.strut, scan.best_pitch, (float(a), float(b)))
    return columns, *solved.fitted(columns)


def _best_force(solved: SolvedSystem, part: Linearisation, scan: PitchScan) -> PeriodicForce | None:
    if not np.isfinite(scan.best_pitch) or scan.best <= 0:
        return None
    _, values, covariance = _periodic_fit(solved, part, scan)
    return periodic_force(part, scan.strut, scan.best_pitch, values, covariance)
