"""The search among candidate causes: what is significant beside others, and what rivals it.

Candidates are columns of one projection (`estimation.diagnostics.joint_system`), in which every
subset of them is fitted and compared; forces that are periodic in a strut's length are scanned for,
and appended when one is found.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import numpy as np
from scipy.optimize import minimize_scalar

from constraints.arrays import Array
from estimation.diagnostics.hypothesis import Hypothesis, HypothesisTest, evaluate_hypothesis
from estimation.diagnostics.joint_system import (
    ConditionalScores,
    EffectFit,
    JointSystem,
    Places,
    SolvedSystem,
)
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.diagnostics.periodic_forces import (
    PitchScan,
    log_exceedance,
    periodic_columns,
    scan_pitches,
)
from estimation.diagnostics.significance import log_tail
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.progress import track

PERIODIC = "position-periodic"
"""Kind of the effects that are periodic in a strut's length."""
REJECTED = 0.001
"""Level at which an effect must be seen beside a rival that takes its place."""
_ROUNDS = 4
"""Of exchanges of effects for better ones."""
_REACH = 1.2
"""How far, in its logarithm, a constant is looked for around that of a candidate."""
_TRIALS = 8


@dataclass(frozen=True, eq=False)
class EffectTests:
    """The search for effects in the residuals of one experiment, with some taken as known."""

    solved: SolvedSystem
    """The fit with these effects among its unknowns."""
    beside: ConditionalScores
    """What is seen of every candidate's columns beside them."""
    scans: tuple[PitchScan, ...]
    """Of the six struts."""
    families: Mapping[str, HypothesisTest]
    """The test of every family of causes, by its kind."""


@dataclass(frozen=True, eq=False)
class EffectCandidate:
    """A candidate that may take a place among the effects."""

    kind: str
    strut: int | None
    parameter: str
    places: Places
    """Of its columns in the projection."""
    limit: float
    """Largest log p, uncorrected, with which it is significant."""
    constant: float = np.nan
    contains: str = ""
    sized_by_constant: bool = False
    pitch: float = np.nan
    reach: float = 0.0
    """Of the scan that a position-periodic force comes from."""

    @property
    def name(self) -> tuple[str, int | None, str]:
        """What tells it from others; candidates that differ in a constant are one."""
        return self.kind, self.strut, self.parameter

    def log_p(self, fit: EffectFit, freedom: float) -> float:
        """Return the logarithm of p of its fit, uncorrected for its family."""
        if not fit.rank:
            return 0.0
        if self.kind == PERIODIC:
            return log_exceedance(fit.statistic, self.reach, freedom)
        return float(log_tail(np.array(fit.statistic), np.array(fit.rank), freedom))


class Search:
    """The candidates of one experiment; position-periodic ones are added as they are found."""

    def __init__(
        self,
        system: JointSystem,
        part: Linearisation,
        families: tuple[Hypothesis, ...],
        step: float,
        level: float,
    ) -> None:
        self.system, self.part, self.families = system, part, families
        self.step, self.level = step, level
        nothing = Signature.of_forces(part, np.zeros((*part.forces.shape, 0)))
        self.signature = Signature.joined(
            [nothing, *(hypothesis.columns for hypothesis in families)]
        )
        self.projection = system.solved.projection(self.signature)
        counts = [hypothesis.columns.count for hypothesis in families]
        self.first = dict(
            zip(
                (hypothesis.kind for hypothesis in families),
                np.cumsum([0, *counts[:-1]]).tolist(),
                strict=True,
            )
        )

    # --- tests ------------------------------------------------------------------------------------

    def tests(self, known: Sequence[EffectCandidate]) -> EffectTests:
        """Test everything beside some effects."""
        solved = self.system.solved
        if known:
            solved = self.system.with_effects(self.signature.picked(places_of(known))).solved
        beside = self.projection.conditional_on(places_of(known))
        beside_known = f" beside {len(known)}" if known else ""
        struts = track(f"diagnosis: effects{beside_known}, strut by strut", range(ACTUATORS))
        scans = tuple(self._scan(solved, strut) for strut in struts)
        return EffectTests(solved, beside, scans, self._family_tests(beside))

    def _family_tests(self, beside: ConditionalScores) -> dict[str, HypothesisTest]:
        return {c.kind: evaluate_hypothesis(beside, c, self.first[c.kind]) for c in self.families}

    def _scan(self, solved: SolvedSystem, strut: int) -> PitchScan:
        return scan_pitches(solved, self.part, strut, self.step, self.level)

    def _periodic(self, solved: SolvedSystem, scan: PitchScan) -> EffectCandidate:
        """Return the best pitch of a scan as a candidate."""
        columns, _, _ = periodic_fit(solved, self.part, scan)
        return EffectCandidate(
            PERIODIC,
            scan.strut,
            "",
            self._appended(Signature.of_forces(self.part, columns)),
            float(np.log(self.level / ACTUATORS)),
            pitch=scan.best_pitch,
            reach=scan.reach,
        )

    def _candidates(
        self, tests: Mapping[str, HypothesisTest]
    ) -> Iterator[tuple[EffectCandidate, float]]:
        """Yield every candidate of the families with its log p."""
        for test in tests.values():
            hypothesis, limit = test.hypothesis, test.limit
            for number in np.flatnonzero(np.isfinite(test.log_p)).tolist():
                name, strut = hypothesis.labels[number]
                item = EffectCandidate(
                    hypothesis.kind,
                    strut,
                    name,
                    test.places(number),
                    limit,
                    hypothesis.constant_of(number),
                    hypothesis.contains,
                    hypothesis.sized_by_constant,
                )
                yield item, float(test.log_p[number])

    def _refined(self, item: EffectCandidate, known: Sequence[EffectCandidate]) -> EffectCandidate:
        """Return a candidate with the constant that explains most beside the effects known."""
        at = next(hypothesis.at for hypothesis in self.families if hypothesis.kind == item.kind)
        if at is None:
            return item
        label, solved = (item.parameter, item.strut), self.system.solved
        others, places = self.projection, places_of(known)

        own = self._fit(item, self.projection.conditional_on(places))
        start = float(own.values[0]) if item.sized_by_constant else item.constant

        def explained(factor: float) -> float:
            new = solved.projection(at(label, float(start * np.exp(factor))))
            fit = others.joined(new).conditional_on(places).fit([len(others.score)])
            return -fit.statistic

        best = minimize_scalar(
            explained, bounds=(-_REACH, _REACH), method="bounded", options={"maxiter": _TRIALS}
        )
        if -float(best.fun) <= own.statistic and not item.sized_by_constant:
            return item
        constant = float(start * np.exp(best.x))
        return replace(item, places=self._appended(at(label, constant)), constant=constant)

    def _appended(self, new: Signature) -> Places:
        """Append columns to the projection; return their places."""
        start = self.signature.count
        self.signature = Signature.joined([self.signature, new])
        self.projection = self.projection.joined(self.system.solved.projection(new))
        return np.arange(start, start + new.count)

    # --- selection --------------------------------------------------------------------------------

    def most_significant(
        self, tests: EffectTests, known: Sequence[EffectCandidate]
    ) -> EffectCandidate | None:
        """Return the effect with the smallest p-value, corrected for its family, if significant.

        `tests` are beside those that are known.

        Families of equal significance are compared by what the selection risks: p relative to
        level, which is that of all scans.
        """
        scan = min(tests.scans, key=attrgetter("log_p"))
        relative = scan.log_p - float(np.log(self.level / ACTUATORS))
        found = min(
            self._candidates(tests.families), key=lambda one: one[1] - one[0].limit, default=None
        )
        if found is not None and found[1] - found[0].limit < min(relative, 0.0):
            return self._refined(found[0], known)
        return self._periodic(tests.solved, scan) if relative < 0 else None

    def significant(self, found: list[EffectCandidate]) -> list[EffectCandidate]:
        """Drop, one by one, what is not significant beside all others."""
        while found:
            relative = [
                self.conditional_log_p(item, without(found, item)) - item.limit for item in found
            ]
            worst = int(np.argmax(relative))
            if relative[worst] < 0:
                break
            found = without(found, found[worst])
        return found

    def exchange_for_rivals(
        self, found: list[EffectCandidate]
    ) -> tuple[list[EffectCandidate], list[tuple[tuple[EffectCandidate, float], ...]]]:
        """Exchange effects for rivals that are more significant in their place; sort what is left.

        Returns the effects, most significant first, and the rivals of each with their log p.
        """
        for _ in range(_ROUNDS):
            changed = False
            for number, item in enumerate(found):
                others = without(found, item)
                rivals = self.rivals(item, others)
                if rivals and rivals[0][1] - rivals[0][0].limit < (
                    self.conditional_log_p(item, others) - item.limit
                ):
                    found, changed = [*found[:number], rivals[0][0], *found[number + 1 :]], True
            found = self.significant(found)
            if not changed:
                break
        found = sorted(found, key=lambda i: self.conditional_log_p(i, without(found, i)) - i.limit)
        return found, [self.rivals(item, without(found, item)) for item in found]

    def rivals(
        self, item: EffectCandidate, others: Sequence[EffectCandidate]
    ) -> tuple[tuple[EffectCandidate, float], ...]:
        """Return what explains an item about as well in its place, and with which log p."""
        beside = self.projection.conditional_on(places_of(others))
        own = self._fit(item, beside)
        found: dict[tuple[str, int | None, str], tuple[EffectCandidate, float]] = {}
        tests = self._family_tests(beside)
        candidates = list(self._candidates(tests))
        if item.kind != PERIODIC and item.strut is not None:
            solved = self.system.solved
            if others:
                solved = self.system.with_effects(self.signature.picked(places_of(others))).solved
            scan = self._scan(solved, item.strut)
            if np.isfinite(scan.best_pitch) and scan.log_p < np.log(REJECTED):
                candidates.append((self._periodic(solved, scan), scan.log_p))
                beside = self.projection.conditional_on(places_of(others))
        taken = {item.name, *(other.name for other in others)}
        for rival, log_p in candidates:
            if rival.name in taken or log_p > np.log(REJECTED):
                continue
            if rival.contains == item.kind and rival.strut == item.strut:
                continue
            # What the item adds to a rival is at least the difference of what both explain.
            least = own.statistic - self._fit(rival, beside).statistic
            if self._rejects(
                item, EffectFit(max(least, 0.0), own.rank, own.values, own.covariance)
            ):
                continue
            both = self.projection.conditional_on(places_of([*others, rival]))
            if self._rejects(item, self._fit(item, both)):
                continue
            if rival.name not in found or log_p < found[rival.name][1]:
                found[rival.name] = (rival, log_p)
        return tuple(sorted(found.values(), key=lambda one: one[1] - one[0].limit))

    def _rejects(self, item: EffectCandidate, fit: EffectFit) -> bool:
        return item.log_p(fit, self.projection.freedom) < np.log(REJECTED)

    def _fit(self, item: EffectCandidate, beside: ConditionalScores) -> EffectFit:
        # The third column of a periodic force, of a change of its pitch, is no size of it.
        places = item.places[:2] if item.kind == PERIODIC else item.places
        return beside.fit(places)

    def conditional_statistic(
        self, item: EffectCandidate, others: Sequence[EffectCandidate]
    ) -> float:
        """Return χ² of a candidate beside others."""
        return self._fit(item, self.projection.conditional_on(places_of(others))).statistic

    def conditional_log_p(self, item: EffectCandidate, others: Sequence[EffectCandidate]) -> float:
        """Return the logarithm of p of a candidate beside others, uncorrected for its family."""
        fit = self._fit(item, self.projection.conditional_on(places_of(others)))
        return item.log_p(fit, self.projection.freedom)


def places_of(items: Sequence[EffectCandidate]) -> Places:
    """Return the places of all columns of candidates in the projection."""
    return np.concatenate([np.zeros(0, dtype=np.intp), *(item.places for item in items)])


def without(items: Sequence[EffectCandidate], one: EffectCandidate) -> list[EffectCandidate]:
    """Return all candidates but one."""
    return [item for item in items if item is not one]


def periodic_fit(
    solved: SolvedSystem, part: Linearisation, scan: PitchScan
) -> tuple[Array, Array, Array]:
    """Return the three columns of the best pitch of a strut, their coefficients and covariance."""
    fixed = periodic_columns(part, scan.strut, scan.best_pitch, (0.0, 0.0))[:, :, :2]
    a, b = solved.fitted(Signature.of_forces(part, fixed)).values
    columns = periodic_columns(part, scan.strut, scan.best_pitch, (float(a), float(b)))
    fit = solved.fitted(Signature.of_forces(part, columns))
    return columns, fit.values, fit.covariance
