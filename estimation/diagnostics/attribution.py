"""What the residuals come from: forward selection among position-periodic forces, columns, delay.

An unmodelled force in one strut also leaves traces in the others, through the parameters that it
has moved and through correlated noise. Therefore the most significant effect is taken as known,
with its columns among the unknowns, and all others are tested again, until none is left. As long
as there is no effect nothing is selected but at the levels of the families.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.channel_test import Strut
from estimation.diagnostics.column_test import (
    Candidates,
    ColumnTest,
    column_candidates,
    column_test,
)
from estimation.diagnostics.delay import DelayTest, delay_test
from estimation.diagnostics.joint_system import JointSystem, SolvedSystem
from estimation.diagnostics.levels import COLUMNS, DELAY, POSITION_PERIODIC
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

    kind: Annotated[str, described("", "position-periodic, column or delay")]
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
class Attribution:
    """All tests of effects.

    Attributes
    ----------
    scans : tuple of PitchScan
        Of the six struts, before any effect is taken as known.
    columns : ColumnTest
        Likewise.
    delay : DelayTest
        Likewise.
    effects : tuple of Effect
        What was selected, most significant first.
    last_scans, last_columns, last_delay
        The tests with these effects taken as known.
    best_forces : tuple of PeriodicForce or None
        The best-fitting position-periodic force of every strut, significant or not.
    solved : SolvedSystem
        The fit with the effects among its unknowns.
    """

    scans: tuple[PitchScan, ...]
    columns: ColumnTest
    delay: DelayTest
    effects: tuple[Effect, ...]
    last_scans: tuple[PitchScan, ...]
    last_columns: ColumnTest
    last_delay: DelayTest
    best_forces: tuple[PeriodicForce | None, ...]
    solved: SolvedSystem


@dataclass(frozen=True, eq=False)
class _Levels:
    """Levels of the families, each divided by the number of experiments."""

    periodic: float
    columns: float
    delay: float


@dataclass(frozen=True, eq=False)
class _Found:
    """A selected effect with its columns."""

    kind: str
    strut: int | None
    parameter: str
    log_p: float
    pitch: float
    columns: Array


@dataclass(frozen=True, eq=False)
class _Tests:
    scans: tuple[PitchScan, ...]
    columns: ColumnTest
    delay: DelayTest


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
    held_out : bool
        The parameters were not estimated from these data.
    experiments : int
        How many are tested together: each gets its share of the levels.
    """
    levels = _Levels(POSITION_PERIODIC / experiments, COLUMNS / experiments, DELAY / experiments)
    candidates = column_candidates(part, names, held_out=held_out)
    base = system.solved()
    first = tests = _tests(base, part, candidates, step, levels)
    found: list[_Found] = []
    solved = base
    while len(found) < _MOST:
        best = _most_significant(tests, solved, part, candidates, levels)
        if best is None:
            break
        found.append(best)
        solved = system.with_columns(np.concatenate([f.columns for f in found], axis=2)).solved()
        tests = _tests(solved, part, candidates, step, levels)
    effects = _fitted(base, part, found)
    return Attribution(
        scans=first.scans,
        columns=first.columns,
        delay=first.delay,
        effects=effects,
        last_scans=tests.scans,
        last_columns=tests.columns,
        last_delay=tests.delay,
        best_forces=_best_forces(effects, tests.scans, solved, part),
        solved=solved,
    )


def _tests(
    solved: SolvedSystem,
    part: Linearisation,
    candidates: Candidates,
    step: float,
    levels: _Levels,
) -> _Tests:
    return _Tests(
        tuple(
            scan_pitches(solved, part, strut, step, levels.periodic) for strut in range(ACTUATORS)
        ),
        column_test(solved, candidates, levels.columns),
        delay_test(solved, part, levels.delay),
    )


def _most_significant(
    tests: _Tests,
    solved: SolvedSystem,
    part: Linearisation,
    candidates: Candidates,
    levels: _Levels,
) -> _Found | None:
    """Return the effect with the smallest p-value, corrected for its family, if it is significant.

    Families of equal significance are compared by what the selection risks: p relative to level.
    """
    options: list[tuple[float, str, int]] = []
    scan = min(tests.scans, key=lambda s: s.log_p)
    log_p = scan.log_p + np.log(ACTUATORS)
    if log_p < np.log(levels.periodic):
        options.append((log_p - np.log(levels.periodic), "position-periodic", scan.strut))
    if tests.columns.tested:
        index = int(np.nanargmin(tests.columns.log_p))
        log_p = float(tests.columns.log_p[index]) + np.log(tests.columns.tested)
        if log_p < np.log(levels.columns):
            options.append((log_p - np.log(levels.columns), "column", index))
    if tests.delay.failed:
        options.append((tests.delay.log_p - np.log(levels.delay), "delay", 0))
    if not options:
        return None
    relative, kind, index = min(options)
    if kind == "position-periodic":
        pitch = tests.scans[index].best_pitch
        fixed = periodic_columns(part, index, pitch, (0.0, 0.0))[:, :, :2]
        (a, b), _ = solved.fitted(fixed)
        columns = periodic_columns(part, index, pitch, (float(a), float(b)))
        return _Found(kind, index, "", relative + np.log(levels.periodic), pitch, columns)
    if kind == "column":
        name, strut = candidates.labels[index]
        columns = candidates.columns[:, :, index : index + 1]
        return _Found(kind, strut, name, relative + np.log(levels.columns), np.nan, columns)
    if part.delay_column is None:
        raise AssertionError("without a column there is no test")
    columns = part.delay_column[:, :, None]
    return _Found(kind, None, "", relative + np.log(levels.delay), np.nan, columns)


def _fitted(base: SolvedSystem, part: Linearisation, found: list[_Found]) -> tuple[Effect, ...]:
    if not found:
        return ()
    values, covariance = base.fitted(np.concatenate([f.columns for f in found], axis=2))
    effects, first = [], 0
    for item in found:
        chosen = slice(first, first + item.columns.shape[2])
        first = chosen.stop
        force = None
        if item.kind == "position-periodic" and item.strut is not None:
            force = periodic_force(
                part, item.strut, item.pitch, values[chosen], covariance[chosen, chosen]
            )
        effects.append(
            Effect(
                kind=item.kind,
                strut=item.strut,
                parameter=item.parameter,
                log_p=item.log_p,
                force=force,
                value=float(values[chosen.start]) if force is None else force.amplitude,
                std=float(np.sqrt(covariance[chosen.start, chosen.start]))
                if force is None
                else force.amplitude_std,
            )
        )
    return tuple(effects)


def _best_forces(
    effects: tuple[Effect, ...],
    scans: tuple[PitchScan, ...],
    solved: SolvedSystem,
    part: Linearisation,
) -> tuple[PeriodicForce | None, ...]:
    """Return the selected force of every strut, else the best one of the last scan."""
    known = {e.strut: e.force for e in reversed(effects) if e.force is not None}
    best: list[PeriodicForce | None] = []
    for scan in scans:
        if scan.strut in known:
            best.append(known[scan.strut])
            continue
        if not np.isfinite(scan.best_pitch) or scan.best <= 0:
            best.append(None)
            continue
        fixed = periodic_columns(part, scan.strut, scan.best_pitch, (0.0, 0.0))[:, :, :2]
        (a, b), _ = solved.fitted(fixed)
        columns = periodic_columns(part, scan.strut, scan.best_pitch, (float(a), float(b)))
        values, covariance = solved.fitted(columns)
        best.append(periodic_force(part, scan.strut, scan.best_pitch, values, covariance))
    return tuple(best)
