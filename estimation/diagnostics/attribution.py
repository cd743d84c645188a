"""What the residuals come from: forward selection among position-periodic forces, columns, delay.

An unmodelled force in one strut also leaves traces in the others, through the parameters that it
has moved and through correlated noise. Therefore the most significant effect is taken as known,
with its columns among the unknowns, and all others are tested again, until none is left. As long
as there is no effect nothing is selected but at the levels of the families.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.channel_test import POSITION_PERIODIC, Strut
from estimation.diagnostics.column_test import (
    Cause,
    ColumnTest,
    DelayTest,
    causes,
    column_test,
    delay_test,
)
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
class Attribution:
    """All tests of effects.

    Attributes
    ----------
    causes : tuple of Cause
        The families of columns that were tested.
    scans, tests
        Of the pitches of the six struts and of each family by its kind, before any effect is
        taken as known.
    effects : tuple of Effect
        What was selected, most significant first.
    last_scans, last_tests
        The tests with these effects taken as known.
    best_forces : tuple of PeriodicForce or None
        The best-fitting position-periodic force of every strut, significant or not.
    solved : SolvedSystem
        The fit with the effects among its unknowns.
    periodic_level : float
        Of all scans together.
    """

    causes: tuple[Cause, ...]
    scans: tuple[PitchScan, ...]
    tests: Mapping[str, ColumnTest]
    effects: tuple[Effect, ...]
    last_scans: tuple[PitchScan, ...]
    last_tests: Mapping[str, ColumnTest]
    best_forces: tuple[PeriodicForce | None, ...]
    solved: SolvedSystem
    periodic_level: float

    @property
    def columns(self) -> ColumnTest:
        """The tests of the regressor's columns before any effect is taken as known."""
        return self.tests["column"]

    @property
    def last_columns(self) -> ColumnTest:
        """The same with the effects taken as known."""
        return self.last_tests["column"]

    @property
    def delay(self) -> DelayTest:
        """The test of the delay before any effect is taken as known."""
        return self._delay(self.tests)

    @property
    def last_delay(self) -> DelayTest:
        """The same with the effects taken as known."""
        return self._delay(self.last_tests)

    def _delay(self, tests: Mapping[str, ColumnTest]) -> DelayTest:
        (cause,) = (cause for cause in self.causes if cause.kind == "delay")
        return delay_test(tests[cause.kind], cause)


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
class _Search:
    """What is tested in one experiment, whatever is taken as known."""

    part: Linearisation
    causes: tuple[Cause, ...]
    step: float
    periodic_level: float

    def scans(self, solved: SolvedSystem) -> tuple[PitchScan, ...]:
        return tuple(
            scan_pitches(solved, self.part, strut, self.step, self.periodic_level)
            for strut in range(ACTUATORS)
        )

    def tests(self, solved: SolvedSystem) -> dict[str, ColumnTest]:
        return {cause.kind: column_test(solved, cause) for cause in self.causes}

    def most_significant(
        self, solved: SolvedSystem, scans: tuple[PitchScan, ...], tests: Mapping[str, ColumnTest]
    ) -> _Found | None:
        """Return the effect with the smallest p-value, corrected for its family, if significant.

        Families of equal significance are compared by what the selection risks: p relative to
        level.
        """
        scan = min(scans, key=lambda one: one.log_p)
        log_p = scan.log_p + float(np.log(ACTUATORS))
        best: tuple[float, Cause | None, int] = (log_p - np.log(self.periodic_level), None, 0)
        for cause in self.causes:
            test = tests[cause.kind]
            if not test.tested:
                continue
            index = int(np.nanargmin(test.log_p))
            relative = float(test.log_p[index] + np.log(test.tested / cause.level))
            if relative < best[0]:
                best, log_p = (relative, cause, index), relative + float(np.log(cause.level))
        relative, chosen, index = best
        if relative >= 0:
            return None
        if chosen is None:
            columns, _, _ = _periodic_fit(solved, self.part, scan)
            return _Found("position-periodic", scan.strut, "", log_p, scan.best_pitch, columns)
        name, strut = chosen.labels[index]
        columns = chosen.columns[:, :, index : index + 1]
        return _Found(chosen.kind, strut, name, log_p, np.nan, columns)


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
    families = causes(part, names, held_out=held_out, experiments=experiments)
    search = _Search(part, families, step, POSITION_PERIODIC / experiments)
    base = solved = system.solved
    first_scans = scans = search.scans(solved)
    first_tests = tests = search.tests(solved)
    found: list[_Found] = []
    while len(found) < _MOST:
        best = search.most_significant(solved, scans, tests)
        if best is None:
            break
        found.append(best)
        solved = system.with_columns(np.concatenate([f.columns for f in found], axis=2)).solved
        scans, tests = search.scans(solved), search.tests(solved)
    effects = _fitted(base, part, found)
    known = {e.strut: e.force for e in reversed(effects) if e.force is not None}
    return Attribution(
        causes=families,
        scans=first_scans,
        tests=first_tests,
        effects=effects,
        last_scans=scans,
        last_tests=tests,
        best_forces=tuple(
            known[scan.strut] if scan.strut in known else _best_force(solved, part, scan)
            for scan in scans
        ),
        solved=solved,
        periodic_level=search.periodic_level,
    )


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
