"""Search among candidate effects: conditional significance, and rival explanations.

The candidates are columns of one projection (`estimation.diagnostics.joint_system`), in which every
subset of them is fitted and compared. Forces periodic in a strut's length are found by a scan, and
their columns are appended.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from operator import attrgetter

import numpy as np
from scipy.optimize import minimize_scalar

from constraints.arrays import Array
from estimation.diagnostics.hypothesis import (
    PERIODIC,
    Hypothesis,
    HypothesisTest,
    Label,
    PitchScan,
    evaluate_hypothesis,
    log_exceedance,
    periodic_columns,
    scan_pitches,
)
from estimation.diagnostics.joint_system import (
    ConditionalScores,
    EffectFit,
    JointSystem,
    SolvedSystem,
)
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.diagnostics.significance import are_possible, log_tail
from estimation.diagnostics.whitened_rows import Places
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.progress import report_progress

RIVAL_LEVEL = 0.001
"""Level at which an effect must remain significant, given a rival, to exclude that rival."""
_ROUNDS = 4
"""Largest number of rounds of exchanging effects for better ones."""
_REACH = 1.2
_NEAR = 0.6
"""Half the ranges of the searches for a constant, in its logarithm, and for a size."""
_TRIALS = 8


@dataclass(frozen=True, eq=False)
class EffectTests:
    """Tests of all candidate effects in one experiment, given some known effects."""

    solution: SolvedSystem
    """Fit with the known effects among its unknowns."""
    conditional: ConditionalScores
    """Scores and information of all candidates' columns, given the known effects."""
    scans: tuple[PitchScan, ...]
    """Pitch scans of the six struts."""
    families: Mapping[str, HypothesisTest]
    """Tests of the families of hypotheses, by their kind."""


@dataclass(frozen=True, eq=False)
class EffectCandidate:
    """Candidate for an effect."""

    hypothesis: Hypothesis
    """Its family."""
    strut: int | None
    parameter: str
    places: Places
    """Indices of its columns in the projection."""
    limit: float
    """Largest log p, uncorrected, with which it is significant."""
    constant: float = np.nan
    scan: PitchScan | None = None
    """The scan that found a position-periodic force."""
    log_p: float = np.nan
    """Logarithm of p of its test, uncorrected for its family; NaN if it cannot be tested."""

    @property
    def kind(self) -> str:
        """Kind of the effect."""
        return self.hypothesis.kind

    @property
    def name(self) -> tuple[str, int | None, str]:
        """Identity of the candidate; candidates that differ only in a constant are the same."""
        return self.kind, self.strut, self.parameter

    def is_possible(self, values: Array, covariance: Array) -> bool:
        """Return whether its values are within their bounds, or beyond them by noise alone."""
        # Without parameters only the first value has bounds; others are auxiliary columns.
        count = 1 + self.parameter.count(",")
        return are_possible(values[:count], covariance[:count, :count], *self.hypothesis.bounds)

    def is_part_of(self, other: EffectCandidate) -> bool:
        """Return whether it is a special case of another candidate, which has further columns."""
        return other.hypothesis.contains == self.kind and other.strut == self.strut

    @property
    def fits_constant(self) -> bool:
        """Whether its constant is unknown, in addition to its size."""
        return self.hypothesis.at is not None and not self.hypothesis.sized_by_constant

    @property
    def excess(self) -> float:
        """Logarithm of p over its limit; negative: it is significant."""
        return self.log_p - self.limit

    def log_p_of(self, fit: EffectFit, freedom: float) -> float:
        """Return the logarithm of p of a fit, uncorrected for its family."""
        if not fit.rank:
            return 0.0
        if self.scan is not None:
            return log_exceedance(fit.statistic, self.scan.reach, freedom)
        return float(log_tail(np.array(fit.statistic), np.array(fit.rank), freedom))


def list_candidates(tests: Mapping[str, HypothesisTest]) -> Iterator[EffectCandidate]:
    """Yield every candidate of the families."""
    for test in tests.values():
        hypothesis = test.hypothesis
        for number, (name, strut) in enumerate(hypothesis.labels):
            places, constant = test.places(number), hypothesis.constant_of(number)
            limit, log_p = float(test.limits[number]), float(test.log_p[number])
            yield EffectCandidate(hypothesis, strut, name, places, limit, constant, log_p=log_p)


class Search:
    """Search among the candidates of one experiment."""

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
        columns = [hypothesis.columns for hypothesis in families]
        self.signature = Signature.concatenate([Signature.none(part), *columns])
        self.projection = system.solution.project(self.signature)
        first = np.cumsum([0, *(each.count for each in columns[:-1])]).tolist()
        kinds = [hypothesis.kind for hypothesis in families]
        self.first = dict(zip(kinds, first, strict=True))
        self._refined: dict[tuple[object, ...], EffectCandidate] = {}

    # --- tests ------------------------------------------------------------------------------------

    def run_tests(self, known: Sequence[EffectCandidate]) -> EffectTests:
        """Test all candidates, given some known effects."""
        solution = self._solution_given(known)
        conditional = self.projection.conditional_on(column_indices(known))
        report_progress(f"diagnosis: effects, {len(known)} found")
        scans = tuple(self._scan(solution, strut) for strut in range(ACTUATORS))
        return EffectTests(solution, conditional, scans, self._family_tests(conditional))

    def _solution_given(self, known: Sequence[EffectCandidate]) -> SolvedSystem:
        """Return the fit with known effects among its unknowns."""
        return self.system.solution.with_effects(self.signature.select(column_indices(known)))

    def _family_tests(self, conditional: ConditionalScores) -> dict[str, HypothesisTest]:
        return {
            c.kind: evaluate_hypothesis(conditional, c, self.first[c.kind]) for c in self.families
        }

    def _scan(self, solution: SolvedSystem, strut: int) -> PitchScan:
        return scan_pitches(solution, self.part, strut, self.step, self.level)

    def _periodic_candidate(self, solution: SolvedSystem, scan: PitchScan) -> EffectCandidate:
        """Return the best pitch of a scan as a candidate."""
        ((columns, _, _),) = periodic_fits(solution, self.part, [scan])
        new = Signature.of_forces(self.part, columns)
        family = Hypothesis(**vars(PERIODIC), labels=(), columns=new, level=self.level)
        limit, places = float(np.log(self.level / ACTUATORS)), self._append(new)
        return EffectCandidate(family, scan.strut, "", places, limit, scan=scan, log_p=scan.log_p)

    def _refine_constant(
        self, item: EffectCandidate, known: Sequence[EffectCandidate]
    ) -> EffectCandidate:
        """Return a candidate with its best-fitting constant, given the known effects.

        Rivals are looked for again and again: every search is made once.
        """
        at = item.hypothesis.at
        if at is None:
            return item
        key = item.name, item.constant, frozenset(column_indices(known).tolist())
        if key not in self._refined:
            self._refined[key] = self._search_constant(item, at, known)
        found = self._refined[key]
        return replace(item, places=found.places, constant=found.constant)

    def _search_constant(
        self,
        item: EffectCandidate,
        at: Callable[[Label, float], Signature],
        known: Sequence[EffectCandidate],
    ) -> EffectCandidate:
        label, solution = (item.parameter, item.strut), self.system.solution
        places = column_indices(known)
        others = self.projection.select(places)
        own, by_constant = self.fit_given(item, known), False
        start, reach, least = item.constant, _REACH, own.statistic
        if item.hypothesis.sized_by_constant:
            start, by_constant = float(own.values[0]), True
            reach, least = _NEAR, -np.inf

        def explained(factor: float) -> float:
            constant = float(start * np.exp(factor))
            new = others.append(solution.project(at(label, constant)))
            fit = new.conditional_on(range(len(places))).fit([len(places)])
            if not (by_constant and fit.rank):
                return -fit.statistic
            # A secant at the size of its effect has this size as its factor.
            return float((fit.values[0] - constant) ** 2 / fit.covariance[0, 0]) - fit.statistic

        best = minimize_scalar(
            explained, bounds=(-reach, reach), method="bounded", options={"maxiter": _TRIALS}
        )
        if -float(best.fun) <= least:
            return item
        constant = float(start * np.exp(best.x))
        refined = replace(item, places=self._append(at(label, constant)), constant=constant)
        # Among few samples a secant may contain no jump of dry friction at the size of its effect.
        lost = by_constant and self.conditional_log_p(refined, known) > item.limit
        if lost and self.conditional_log_p(item, known) < item.limit:
            return replace(item, constant=start)
        return refined

    def _append(self, new: Signature) -> Places:
        """Append columns to the projection; return their indices."""
        start = self.signature.count
        self.signature = Signature.concatenate([self.signature, new])
        self.projection = self.projection.append(self.system.solution.project(new))
        return np.arange(start, start + new.count)

    # --- selection --------------------------------------------------------------------------------

    def find_most_significant(
        self, tests: EffectTests, known: Sequence[EffectCandidate]
    ) -> EffectCandidate | None:
        """Return the effect with the smallest p-value, corrected for its family, if significant.

        `tests` are conditional on the known effects. Families with different levels are compared
        by p relative to the level. An effect is found once: another constant of it, such as a
        second delay, would be an error of its linearisation. A strut may have forces of several
        pitches.
        """
        taken = {item.name for item in known if item.scan is None}
        candidates = [
            one
            for one in list_candidates(tests.families)
            if one.name not in taken and np.isfinite(one.log_p)
        ]
        scan = min(tests.scans, key=attrgetter("log_p"))
        relative = scan.log_p - float(np.log(self.level / ACTUATORS))
        found = min(candidates, key=attrgetter("excess"), default=None)
        if found is not None and found.excess < min(relative, 0.0):
            if not found.hypothesis.sized_by_constant:
                return self._refine_constant(found, known)
            secants = self._size_secants(candidates, known)
            excess = np.array([one.excess for one in secants])
            # Of equal ones the simplest: the families are in this order.
            equal = excess < np.min(excess) - np.log(RIVAL_LEVEL)
            return secants[int(np.argmax(equal))]
        return self._periodic_candidate(tests.solution, scan) if relative < 0 else None

    def _size_secants(
        self, candidates: Sequence[EffectCandidate], known: Sequence[EffectCandidate]
    ) -> list[EffectCandidate]:
        """Return the best effects that are sized by their constants, one of each family, with them.

        A delay and a low pass differ less than their secants at the few constants of the tests.
        """
        sized = [one for one in candidates if one.hypothesis.sized_by_constant and one.excess < 0]
        refined = self._refine_best(sized, known)
        return [one for one in refined if one.constant > one.hypothesis.bounds[0]] or refined

    def _refine_best(
        self, candidates: Sequence[EffectCandidate], known: Sequence[EffectCandidate]
    ) -> list[EffectCandidate]:
        """Return the best candidate of each family with its best-fitting constant, and its p."""
        best: dict[str, EffectCandidate] = {}
        for item in candidates:
            if item.kind not in best or item.log_p < best[item.kind].log_p:
                best[item.kind] = item
        refined = [self._refine_constant(item, known) for item in best.values()]
        return [replace(one, log_p=self.conditional_log_p(one, known)) for one in refined]

    def drop_insignificant(self, found: list[EffectCandidate]) -> list[EffectCandidate]:
        """Drop, one by one, effects that are not significant given all others."""
        while found:
            excesses = self.conditional_excesses(found)
            worst = int(np.argmax(excesses))
            if excesses[worst] < 0:
                break
            found = exclude(found, found[worst])
        return found

    def exchange_for_rivals(
        self, found: list[EffectCandidate]
    ) -> tuple[list[EffectCandidate], list[tuple[EffectCandidate, ...]]]:
        """Exchange effects for rivals that are more significant in their place, and sort them.

        Returns the effects, most significant first, and the rivals of each.
        """
        rivals: list[tuple[EffectCandidate, ...]] = []
        for _ in range(_ROUNDS):
            before, rivals = found, []
            for number, item in enumerate(found):
                report_progress(f"diagnosis: rivals of {len(found)} effects")
                others = exclude(found, item)
                rivals.append(self.find_rivals(item, others))
                own = self.fit_given(item, others)
                # Any significant candidate is better than one beyond its bounds.
                least = 0.0
                if item.is_possible(own.values, own.covariance):
                    least = item.log_p_of(own, self.projection.freedom) - item.limit
                if not rivals[-1]:
                    continue
                # A special case that is no worse: the further columns are not significant.
                simpler = [one for one in rivals[-1] if one.is_part_of(item) and one.excess < 0]
                rival = (simpler or rivals[-1])[0]
                if rival.hypothesis.sized_by_constant:
                    rival = self._refine_constant(rival, others)
                    if item.hypothesis.sized_by_constant:  # equal ones stay
                        least += float(np.log(RIVAL_LEVEL))
                if simpler or rival.excess < least:
                    found = [*found[:number], rival, *found[number + 1 :]]
            found = self.drop_insignificant(found)
            if found is before:
                break
        else:
            rivals = [self.find_rivals(item, exclude(found, item)) for item in found]
        order = np.argsort(self.conditional_excesses(found), kind="stable").tolist()
        return [found[k] for k in order], [rivals[k] for k in order]

    def find_rivals(
        self, item: EffectCandidate, others: Sequence[EffectCandidate]
    ) -> tuple[EffectCandidate, ...]:
        """Return the candidates that explain an effect about as well, with their p in its place.

        A candidate with an unknown constant is excluded if it is with the constant that fits best.
        """
        conditional = self.projection.conditional_on(column_indices(others))
        found: dict[tuple[str, int | None, str], EffectCandidate] = {}
        taken = {item.name, *(other.name for other in others)}
        candidates = list(list_candidates(self._family_tests(conditional)))
        if item.scan is None and item.strut is not None:
            solution = self._solution_given(others)
            scan = self._scan(solution, item.strut)
            if np.isfinite(scan.best_pitch):
                candidates.append(self._periodic_candidate(solution, scan))
        candidates = [
            one for one in candidates if one.name not in taken and one.log_p < np.log(RIVAL_LEVEL)
        ]
        refined = self._refine_best([one for one in candidates if one.fits_constant], others)
        if item.hypothesis.sized_by_constant:
            refined += self._size_secants(candidates, others)
        # Within a step few samples show a jump of dry friction: a longer secant may fit better.
        names = {one.name for one in refined if one.fits_constant or abs(one.constant) > self.step}
        conditional = self.projection.conditional_on(column_indices(others))
        for rival in [*(one for one in candidates if one.name not in names), *refined]:
            if item.is_part_of(rival):
                continue
            fit = conditional.fit(_sizing_columns(rival))
            if not rival.is_possible(fit.values, fit.covariance):
                continue
            # A delay and a low pass act together if either is significant given the other.
            together = _is_same_lag(item, rival) and self._is_significant(
                rival, self.fit_given(rival, [*others, item])
            )
            given = [*others, rival]
            if not together and self._is_significant(item, self.fit_given(item, given)):
                continue
            if rival.name not in found or rival.log_p < found[rival.name].log_p:
                found[rival.name] = rival
        every = found.values()
        rivals = [one for one in every if not any(other.is_part_of(one) for other in every)]
        return tuple(sorted(rivals, key=attrgetter("excess")))

    def _is_significant(self, item: EffectCandidate, fit: EffectFit) -> bool:
        if fit.rank and item.fits_constant:
            fit = replace(fit, rank=fit.rank + 1)
        return item.log_p_of(fit, self.projection.freedom) < np.log(RIVAL_LEVEL)

    def fit_given(self, item: EffectCandidate, others: Sequence[EffectCandidate]) -> EffectFit:
        """Return the fit of a candidate, given others, without the columns of all further ones."""
        known, scores = column_indices(others), self.projection.conditional_on(())
        own = scores.select(np.concatenate([known, _sizing_columns(item)]))
        given = own.conditional_on(range(len(known)))
        return given.fit(range(len(known), len(own.whole)))

    def conditional_log_p(self, item: EffectCandidate, others: Sequence[EffectCandidate]) -> float:
        """Return log p of a candidate, given others, uncorrected for its family."""
        return item.log_p_of(self.fit_given(item, others), self.projection.freedom)

    def conditional_excesses(self, found: Sequence[EffectCandidate]) -> list[float]:
        """Return log p of every effect over its limit, given all others."""
        return [self.conditional_log_p(one, exclude(found, one)) - one.limit for one in found]


def _is_same_lag(item: EffectCandidate, rival: EffectCandidate) -> bool:
    """Return whether a delay has a low pass of the same forces as a rival."""
    late = item.kind in ("delay", "lag") and rival.kind == "low_pass"
    return late and item.strut == rival.strut and "length" not in (item.parameter, rival.parameter)


def _sizing_columns(item: EffectCandidate) -> Places:
    # The third column of a periodic force, a change of its pitch, does not measure its size.
    return item.places if item.scan is None else item.places[:2]


def column_indices(items: Sequence[EffectCandidate]) -> Places:
    """Return the indices of all columns of candidates in the projection."""
    return np.concatenate([np.zeros(0, dtype=np.intp), *(item.places for item in items)])


def exclude(items: Sequence[EffectCandidate], one: EffectCandidate) -> list[EffectCandidate]:
    """Return all candidates but one."""
    return [item for item in items if item is not one]


def periodic_fits(
    solution: SolvedSystem, part: Linearisation, scans: Sequence[PitchScan]
) -> list[tuple[Array, Array, Array]]:
    """Fit the best pitch of each strut alone: three columns, their coefficients and covariance."""

    def columns_at(coefficients: Sequence[Array]) -> list[Array]:
        return [
            periodic_columns(part, scan.strut, scan.best_pitch, (float(each[0]), float(each[1])))
            for scan, each in zip(scans, coefficients, strict=True)
        ]

    def fit_each(columns: Sequence[Array]) -> list[EffectFit]:
        effects = [Signature.of_forces(part, each) for each in columns]
        found = solution.project(Signature.concatenate([Signature.none(part), *effects]))
        ends = np.cumsum([0, *(each.count for each in effects)]).tolist()
        return [found.conditional_on(()).fit(range(*places)) for places in pairwise(ends)]

    waves = [each[:, :, :2] for each in columns_at([np.zeros(2)] * len(scans))]
    columns = columns_at([each.values for each in fit_each(waves)])
    fits = fit_each(columns)
    return [(own, fit.values, fit.covariance) for own, fit in zip(columns, fits, strict=True)]
