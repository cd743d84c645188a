"""Forward and backward selection of terms, from the robot's own to those that the data support.

A step is judged by Schwarz's criterion, an F test, or the prediction of held-out forces. Each of
these is a potential that every step must lower, so that no model occurs twice. A term with
parameters beyond their bounds is never supported, and a term that explains less than half of a
remaining lack of fit may only imitate its cause.

The information of the recordings on the parameters of candidate terms follows from the joint
regression of the diagnostics (`estimation.diagnostics.joint_system`): whitened forces and lengths,
one Gauss–Newton step in the parameters p, the deviations θ with tolerances, and the motion ξ. The
motion is eliminated for every recording; the remaining F and g of (p, θ) are added over the
recordings. They determine the decrease of −2 log L by any block of columns given any others, so
that thousands of models are compared without returning to the data.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Annotated, Self

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.joint_system import (
    ConditionalScores,
    EffectFit,
    JointSystem,
    motion_last,
)
from estimation.diagnostics.linearisation import (
    CandidateEffects,
    Signature,
    linearise,
)
from estimation.diagnostics.residual_covariance import empirical_noise, with_empirical_colour
from estimation.diagnostics.residuals import HarmonicLackOfFit, harmonic_lack_of_fit
from estimation.diagnostics.significance import HARMONIC_LACK_OF_FIT, are_possible, log_tail
from estimation.diagnostics.whitened_rows import Places, RowWhitening
from estimation.estimators import Experiment, ParameterPriors
from estimation.measurement_model.motion import (
    Elimination,
    NormalEquations,
    root_of_pseudo_inverse,
)
from expdesign.configuration import InputError
from expdesign.configuration.estimate import SelectionCriterion
from expdesign.information.fisher import EXCITABLE
from expdesign.mechanism.term import parameters_of
from expdesign.robot import Robot
from expdesign.runfolder import OpenNumber, described

_EXPLAINED = 0.5
"""Share of a remaining lack of fit that a term must explain."""
_SEEN = 0.25
"""Share of a term's χ² that the tested lines must contain to judge it."""


@dataclass(frozen=True)
class SelectionRow:
    """Row of the selection's table: one term tried in one step."""

    step: Annotated[int, described("1", "number of the step, from 1")]
    direction: Annotated[str, described("", "add or drop")]
    term: Annotated[str, described("", "the term tried")]
    others: Annotated[str, described("", "other candidates in the model")]
    parameters: Annotated[int, described("1", "identifiable combinations of its parameters")]
    statistic: Annotated[
        float, described("1", "chi-square of the term given the others, over the dispersion")
    ]
    log_p: Annotated[float, described("1", "logarithm of p of its F test, uncorrected")]
    samples: Annotated[
        float, described("1", "independent samples with the same information on its parameters")
    ]
    bic: Annotated[float, described("1", "change of Schwarz's criterion with the term")]
    held_out: Annotated[
        OpenNumber,
        described("1", "change of -2 log L of held-out data; empty: not computed"),
    ]
    possible: Annotated[bool, described("", "its parameters are within their bounds, or near")]
    worth: Annotated[float, described("1", "gain of the criterion: the term is supported above 0")]
    chosen: Annotated[bool, described("", "the step was taken: the term was added, or dropped")]


def select(judge: Judge) -> tuple[tuple[str, ...], tuple[SelectionRow, ...]]:
    """Select candidates; return them in the order of entry, and the path.

    A forward step adds the candidate with the largest gain, if it is positive. After each addition,
    candidates without gain given the others are dropped, the least useful first. The search ends
    if no step changes the model or if a model recurs. A term that uses the constants of another
    enters after it and leaves before it.
    """
    model: tuple[str, ...] = ()
    rows: list[SelectionRow] = []
    seen = {frozenset(model)}
    while True:
        for direction in ("drop", "add"):
            changed, trials = _take_step(judge, model, direction, len(rows) and rows[-1].step)
            rows += trials
            if changed != model:
                break
        if changed == model or frozenset(changed) in seen:
            return changed, tuple(rows)
        model = changed
        seen.add(frozenset(model))


def _take_step(
    judge: Judge, model: tuple[str, ...], direction: str, before: int
) -> tuple[tuple[str, ...], list[SelectionRow]]:
    """Return the model after one step in a direction, and the rows of its trials."""
    adding = direction == "add"
    needed = judge.needs
    held = {needed[term] for term in model if term in needed}
    terms = [
        term
        for term in judge.evidence.blocks
        if (term in model) != adding
        and (needed.get(term, term) in (*model, term) if adding else term not in held)
    ]
    if not terms:
        return model, []
    rows = [
        judge.try_term(term, [other for other in model if other != term], before + 1, direction)
        for term in terms
    ]
    best = (max if adding else min)(rows, key=lambda row: row.worth)
    if (best.worth > 0) != adding:
        return model, rows
    chosen = replace(best, chosen=True)
    rows = [chosen if row is best else row for row in rows]
    others = tuple(term for term in model if term != best.term)
    return ((*model, best.term) if adding else others), rows


class Judge:
    """Judge of single terms, each given the other terms of a model."""

    def __init__(
        self,
        evidence: Evidence,
        by: SelectionCriterion,
        level: float,
        needs: Mapping[str, str] | None = None,
    ) -> None:
        self.evidence, self.by = evidence, by
        self.needs = dict(needs or {})
        """Candidates that require another candidate, and that one."""
        self.dispersion = evidence.dispersion()
        self.samples = {term: evidence.samples(term) for term in evidence.blocks}
        self.limit = float(np.log(level / len(evidence.blocks)))
        """Largest significant log p: the level divided by the number of candidates."""
        self._scores = evidence.conditional_on_own_terms()
        self._splits = splits(evidence) if by == "holdout" else ()
        self._errors: dict[frozenset[str], float] = {}

    def try_term(
        self, term: str, others: Sequence[str], step: int = 1, direction: str = "add"
    ) -> SelectionRow:
        """Compute the statistics of a term given the other terms of a model."""
        known = [self.evidence.places(other) for other in others]
        scores = self._scores.conditional_on(np.concatenate([np.zeros(0, dtype=np.intp), *known]))
        fit: EffectFit = scores.fit(self.evidence.places(term))
        statistic, samples = fit.statistic / self.dispersion, self.samples[term]
        log_p = 0.0
        if fit.rank:
            log_p = float(log_tail(np.array(statistic), np.array(fit.rank), scores.freedom))
        held_out = np.nan
        if self.by == "holdout":
            # A term that is indistinguishable from the others does not change the prediction.
            held_out = 0.0
            if fit.rank:
                held_out = self._held_out_error([*others, term]) - self._held_out_error(others)
        bic = fit.rank * float(np.log(samples)) - statistic
        possible, worth = self.evidence.is_term_possible(term, fit), 0.0
        if possible:
            worth += {"bic": -bic, "f": self.limit - log_p, "holdout": -held_out}[self.by]
        return SelectionRow(
            step=step,
            direction=direction,
            term=term,
            others=" ".join(others),
            parameters=fit.rank,
            statistic=statistic,
            log_p=log_p,
            samples=samples,
            bic=bic,
            held_out=held_out,
            possible=possible,
            worth=worth,
            chosen=False,
        )

    def _held_out_error(self, terms: Sequence[str]) -> float:
        """Return −2 log L of held-out data, relative to the point of linearisation."""
        model = frozenset(terms)
        if model not in self._errors:
            kept = [self.evidence.blocks[term] for term in model]
            places = np.sort(np.concatenate([self.evidence.own_terms, *kept]))
            total = sum(split.error(places) for split in self._splits)
            self._errors[model] = total / len(self._splits)
        return self._errors[model]


def find_imitations(judge: Judge, chosen: Sequence[str]) -> tuple[str, ...]:
    """Return chosen terms that explain less than half of a lack of fit that remains.

    The lack of fit is that of the low harmonics. A term with less than a quarter of its χ² there,
    such as a fine cogging, is not judged by it.
    """
    evidence, needed = judge.evidence, judge.needs
    failed, rest = evidence.lack_of_fit(chosen)
    if not failed:
        return ()
    found = set()
    for term in chosen:
        others = [each for each in chosen if each != term]
        without = evidence.lack_of_fit(others)[1]
        whole = judge.try_term(term, others).statistic * judge.dispersion
        if rest > _EXPLAINED * without and without - rest > _SEEN * whole:
            found.add(term)
    return tuple(term for term in chosen if {term, needed.get(term, term)} & found)


@dataclass(frozen=True, eq=False)
class Split:
    """Fitted data and the data that they predict; every column of g, (u, n), is one such pair."""

    fitted: NormalEquations
    """Fitted data, with the priors."""
    predicted: NormalEquations

    def error(self, places: Places) -> float:
        """Return the mean −2 log L of predictions with the parameters at some places fitted."""
        own = np.ix_(places, places)
        # Combinations that the fitted data do not determine keep the values of linearisation.
        root = root_of_pseudo_inverse(self.fitted.matrix[own], EXCITABLE)
        steps = root @ (root.T @ self.fitted.gradient[places])
        error = self.predicted.matrix[own] @ steps - 2 * self.predicted.gradient[places]
        return float(np.mean(np.sum(error * steps, axis=0)))


def splits(evidence: Evidence) -> tuple[Split, ...]:
    """Divide the recordings into fitted and predicted data.

    With several recordings, each one in turn is predicted from some periods of all others. With a
    single one, some of its periods in turn predict the rest.

    Notes
    -----
    Selection by prediction is consistent only if nearly all data are predicted and few are fitted
    (Shao, J. Am. Stat. Assoc. 88, 1993); fitting the share 1 / (log n - 1) of n samples agrees with
    Schwarz's criterion (Shao, Statistica Sinica 7, 1997). Leaving out a single period would add
    superfluous terms, no matter how many periods there are.

    Raises
    ------
    InputError
        There is a single recording without two separate periods.
    """
    recordings = evidence.recordings
    share = 1 / max(np.log(sum(each.samples for each in recordings)) - 1, 1.0)
    fitted = [_fitted_periods(each, share) for each in recordings]
    if len(recordings) == 1:
        whole, few = recordings[0].total, fitted[0]
        if recordings[0].periods.shape[1] == 1:
            raise InputError(
                "a single recording without whole periods leaves no data to predict",
                key="estimate.select.by",
                allowed="bic, f, or a further recording (--data twice)",
            )
        rest = NormalEquations(
            0.0, whole.matrix - few.matrix, whole.gradient[:, None] - few.gradient
        )
        return (Split(few + _as_column(evidence.prior), rest),)
    found = []
    for number, recording in enumerate(recordings):
        others = [few for place, few in enumerate(fitted) if place != number]
        count = max(few.gradient.shape[1] for few in others)
        alike = [
            replace(few, gradient=few.gradient[:, np.arange(count) % few.gradient.shape[1]])
            for few in others
        ]
        few = sum(alike[1:], alike[0]) + _as_column(evidence.prior)
        found.append(Split(few, _as_column(recording.total)))
    return tuple(found)


def _as_column(equations: NormalEquations) -> NormalEquations:
    return replace(equations, gradient=equations.gradient[:, None])


def _fitted_periods(recording: RecordingInformation, share: float) -> NormalEquations:
    """Return a share of a recording's periods, at least one, starting at each period in turn."""
    count = recording.periods.shape[1]
    length = max(1, min(round(share * count), count - 1))
    following = np.arange(count)[:, None] + np.arange(length)
    gradients = recording.periods[:, following % count].sum(axis=2)
    return NormalEquations(0.0, recording.total.matrix * (length / count), gradients)


@dataclass(frozen=True, eq=False)
class RecordingInformation:
    """Information of one recording on (p, θ)."""

    total: Elimination
    """With the motion eliminated."""
    columns: Array
    """(k,), zᵀ W z of the parameters' columns, with the noise's own spectrum."""
    columns_white: Array
    """(k,), zᵀ W z under white noise of the same covariance."""
    samples: float
    """Number of single samples of the forces."""
    _system: JointSystem
    _order: Places
    """Order of the system's unknowns: (p, θ), then the motion."""
    _effects: CandidateEffects
    """The linearised recording."""

    @classmethod
    def of(cls, effects: CandidateEffects, deviations: Signature) -> Self:
        """Eliminate the motion of one recording; θ are the deviations with tolerances."""
        part, noise = effects.part, effects.experiment.noise
        count = int(np.count_nonzero(part.free))
        system = JointSystem.of(part, noise).with_effects(deviations)
        order, kept = motion_last(system, count, deviations.count), count + deviations.count
        own = part.regressors[:, :, part.free]
        columns, columns_white = (
            np.sum(RowWhitening.of(each, part.counts)(own) ** 2, axis=(0, 1))
            for each in (noise.forces, noise.forces.as_white())
        )
        return cls(
            total=system.equations.select(order).eliminate(kept),
            columns=columns,
            columns_white=columns_white,
            samples=float(np.sum(part.counts)),
            _system=system,
            _order=order,
            _effects=effects,
        )

    def lack_of_fit(
        self, places: Places, prior: NormalEquations, level: float
    ) -> HarmonicLackOfFit | None:
        """Test the low harmonics with some of (p, θ) as unknowns; None if they are not tested."""
        experiment = self._effects.experiment
        if experiment.fit is None or experiment.noise.forces.includes_model_error:
            return None
        first = len(self.total.gradient)
        system = self._system.select(np.concatenate([self._order[places], self._order[first:]]))
        solved = replace(system, equations=system.equations + prior.select(places)).solution
        harmonics = experiment.harmonics or 0
        return harmonic_lack_of_fit(experiment, self._effects.part, solved, harmonics, level=level)

    def residual_chi_square(self, step: Array) -> tuple[float, int]:
        """Return χ² of the forces after a step of (p, θ), (u,), and the number of rows."""
        motion = self.total.offset - self.total.slope @ step
        whole = np.zeros(len(self._order))
        whole[self._order] = np.concatenate([step, motion])
        rest, _ = self._system.split(self._system.residuals - self._system.columns @ whole)
        return float(np.sum(rest**2)), rest.size

    @cached_property
    def periods(self) -> Array:
        """(u, M), g of the single periods; their F is 1/M of the recording's.

        One column for all data if there are no separate periods.
        """
        experiment, system = self._effects.experiment, self._system
        forces, lengths = experiment.recording.forces, experiment.recording.lengths
        total = self.total.gradient[:, None]
        if forces.repeats is None or lengths.repeats is None:
            return total
        # All periods have the same columns and independent noise.
        count, first = len(forces.repeats), len(total)
        own = np.moveaxis(forces.repeats - forces.values, 0, 2)
        of_lengths = np.moveaxis(lengths.repeats - lengths.values, 0, 2)
        if not len(system.length_rows.counts):  # the lengths only made the motion, which is known
            of_lengths = of_lengths[:0]
        single = Signature(experiment.select_rows(own), of_lengths)
        gradients = (system.columns.T @ system.eliminate_signs(system.whiten(single)))[self._order]
        explained = self.total.slope.T @ gradients[first:]
        return np.asarray(total + gradients[:first] - explained) / count


@dataclass(frozen=True, eq=False)
class Evidence:
    """Information of all recordings on (p, θ); p includes the candidates' parameters."""

    blocks: Mapping[str, Places]
    """Indices of each candidate's parameters in (p, θ)."""
    prior: NormalEquations
    """Prior information on (p, θ)."""
    recordings: tuple[RecordingInformation, ...]
    freedom: float
    """Degrees of freedom of the noise's covariance; inf if it was given."""
    margins: Array
    """(u, 2), bounds of (p, θ), relative to the point of linearisation."""

    @classmethod
    def of(
        cls,
        robot: Robot,
        experiments: Sequence[Experiment],
        priors: ParameterPriors,
        values: Array,
        blocks: Mapping[str, tuple[str, ...]],
        known: Mapping[str, float] = MappingProxyType({}),
    ) -> Self:
        """Linearise the recordings at parameters, (m,), SI.

        The robot has all candidates among its terms, with the parameters of `blocks`, and contains
        the estimated deviations `known` already.
        """
        shares, precision, off = [], np.zeros(0), np.zeros(0)
        coloured = [with_empirical_colour(each.for_estimator("ml")) for each in experiments]
        reweighted = [replace(each, noise=empirical_noise(each)) for each in coloured]
        for experiment in reweighted:
            motion = None if experiment.fit is None else experiment.fit.motion
            part = linearise(robot, experiment, values, priors.free, motion)
            effects = CandidateEffects(robot, experiment, motion, values, part)
            deviations, precision, off = effects.tolerance_columns(known)
            shares.append(RecordingInformation.of(effects, deviations))
        names = [n for n, free in zip(priors.names, priors.free, strict=True) if free]
        size = len(names) + len(precision)
        margins = np.full((size, 2), [-np.inf, np.inf])
        bounds = {each.name: (each.lower, each.upper) for each in parameters_of(robot.terms)}
        margins[: len(names)] = [bounds.get(name, (-np.inf, np.inf)) for name in names]
        margins[: len(names)] -= values[priors.free][:, None]
        weights, pull = (np.pad(each, (len(names), 0)) for each in (precision, precision * off))
        tolerated = NormalEquations(0.0, np.diag(weights), pull)
        return cls(
            {
                term: np.array([names.index(name) for name in own], dtype=np.intp)
                for term, own in blocks.items()
            },
            tolerated + priors.equations(values),
            tuple(shares),
            min(each.noise.forces.weights_freedom for each in reweighted),
            margins,
        )

    @cached_property
    def total(self) -> NormalEquations:
        """Information of all recordings and the priors."""
        return sum((each.total for each in self.recordings), self.prior)

    @property
    def candidates(self) -> Places:
        """Indices of the parameters of all candidates."""
        return np.concatenate(list(self.blocks.values()))

    @property
    def own_terms(self) -> Places:
        """Indices of the unknowns that every model has."""
        return np.setdiff1d(np.arange(len(self.prior.gradient)), self.candidates)

    @cached_property
    def _reduced(self) -> Elimination:
        """Equations of the candidates, with all other unknowns eliminated."""
        order = np.concatenate([self.candidates, self.own_terms])
        return self.total.select(order).eliminate(len(self.candidates))

    def conditional_on_own_terms(self) -> ConditionalScores:
        """Return scores and information of the candidates given the robot's own terms.

        Raises
        ------
        numpy.linalg.LinAlgError
            The recordings do not determine the parameters of the robot's own terms.
        """
        reduced = self._reduced
        columns = np.sum([each.columns for each in self.recordings], axis=0)[self.candidates]
        return ConditionalScores(reduced.gradient, reduced.matrix, columns, self.freedom)

    def places(self, term: str) -> Places:
        """Return the indices of a candidate's parameters among those of all candidates."""
        return np.flatnonzero(np.isin(self.candidates, self.blocks[term]))

    def is_term_possible(self, term: str, fit: EffectFit) -> bool:
        """Return whether the fitted parameters of a candidate are within their bounds, or near."""
        lower, upper = self.margins[self.blocks[term]].T
        return are_possible(fit.values, fit.covariance, lower, upper)

    def lack_of_fit(self, terms: Sequence[str]) -> tuple[bool, float]:
        """Return whether a model with these candidates leaves a lack of fit, and its χ² excess."""
        kept = [self.blocks[term] for term in terms]
        places = np.sort(np.concatenate([self.own_terms, *kept]))
        level = HARMONIC_LACK_OF_FIT / len(self.recordings)
        found = [each.lack_of_fit(places, self.prior, level) for each in self.recordings]
        tests = [test for test in found if test is not None]
        return any(test.failed for test in tests), sum(test.excess for test in tests)

    def samples(self, term: str) -> float:
        """Return the number of independent samples with the same information on a candidate.

        It is the geometric mean over its parameters of zᵀ W z, divided by the mean information of
        a sample with white noise of the same covariance; with white noise, the number of samples.
        """
        at = self.blocks[term]
        actual = np.sum([each.columns[at] for each in self.recordings], axis=0)
        white = np.sum([each.columns_white[at] for each in self.recordings], axis=0)
        count = sum(each.samples for each in self.recordings)
        seen = white > 0
        if not np.any(seen):
            return count
        return float(np.exp(np.mean(np.log(count * actual[seen] / white[seen]))))

    def dispersion(self) -> float:
        """Return the residual variance of the largest model, relative to the noise; at least 1."""
        fit = self.conditional_on_own_terms().fit(np.arange(len(self.candidates)))
        step = np.zeros(len(self.prior.gradient))
        step[self.candidates] = fit.values
        step[self.own_terms] = self._reduced.offset - self._reduced.slope @ fit.values
        parts = [each.residual_chi_square(step) for each in self.recordings]
        chi_square, size = map(sum, zip(*parts, strict=True))
        return max(1.0, chi_square / (size - len(self.own_terms) - fit.rank))
