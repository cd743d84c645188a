"""Forward and backward selection of terms, from the robot's own to those that the data support.

A step is judged by Schwarz's criterion, an F test, or the prediction of held-out forces. Each of
these is a potential that every step must lower, so that no model occurs twice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Annotated

import numpy as np

from estimation.diagnostics.joint_system import EffectFit, Places
from estimation.diagnostics.significance import log_tail
from estimation.selection.evidence import Evidence, InformationShare, RecordingInformation
from expdesign.configuration import InputError
from expdesign.configuration.estimate import SelectionCriterion
from expdesign.information.fisher import EXCITABLE, ScaledInformation
from expdesign.runfolder import OpenNumber, described


@dataclass(frozen=True)
class SelectionRow:
    """Row of the selection's table: one term tried in one step."""

    step: Annotated[int, described("1", "number of the step, from 1")]
    direction: Annotated[str, described("", "add or drop")]
    term: Annotated[str, described("", "the term tried")]
    beside: Annotated[str, described("", "other candidates in the model")]
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
    found = []
    for term in terms:
        others = tuple(other for other in model if other != term)
        one = judge.try_term(term, others)
        found.append((one, others, judge.worth(one)))
    if not found:
        return model, []
    best = max(found, key=lambda each: each[2] if adding else -each[2])
    done = best[2] > 0 if adding else best[2] <= 0
    rows = [
        SelectionRow(
            step=before + 1,
            direction=direction,
            term=one.term,
            beside=" ".join(others),
            parameters=one.rank,
            statistic=one.statistic,
            log_p=one.log_p,
            samples=judge.samples[one.term],
            bic=-one.bic,
            held_out=-one.held_out,
            worth=worth,
            chosen=done and one is best[0],
        )
        for one, others, worth in found
    ]
    if not done:
        return model, rows
    return ((*model, best[0].term) if adding else best[1]), rows


@dataclass(frozen=True)
class TermTrial:
    """Statistics of one term given some others."""

    term: str
    statistic: float
    """χ² of the term, over the dispersion."""
    rank: int
    """Its degrees of freedom: identifiable combinations of its parameters."""
    log_p: float
    """Logarithm of the F test's p, uncorrected."""
    bic: float
    """Decrease of Schwarz's criterion."""
    held_out: float
    """Decrease of −2 log L of held-out data; NaN if not computed."""


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

    def try_term(self, term: str, others: Sequence[str]) -> TermTrial:
        """Compute the statistics of a term given the other terms of a model."""
        known = [self.evidence.places(other) for other in others]
        scores = self._scores.conditional_on(np.concatenate([np.zeros(0, dtype=np.intp), *known]))
        fit: EffectFit = scores.fit(self.evidence.places(term))
        statistic = fit.statistic / self.dispersion
        log_p = 0.0
        if fit.rank:
            log_p = float(log_tail(np.array(statistic), np.array(fit.rank), scores.freedom))
        held_out = np.nan
        if self.by == "holdout":
            # A term that is indistinguishable from the others does not change the prediction.
            held_out = 0.0
            if fit.rank:
                held_out = self._held_out_error(others) - self._held_out_error([*others, term])
        bic = statistic - fit.rank * float(np.log(self.samples[term]))
        return TermTrial(term, statistic, fit.rank, log_p, bic, held_out)

    def worth(self, trial: TermTrial) -> float:
        """Return the gain of a term by the criterion: it is supported above zero."""
        if self.by == "bic":
            return trial.bic
        if self.by == "f":
            return self.limit - trial.log_p
        return trial.held_out

    def _held_out_error(self, terms: Sequence[str]) -> float:
        """Return −2 log L of held-out data, relative to the point of linearisation."""
        model = frozenset(terms)
        if model not in self._errors:
            kept = [self.evidence.blocks[term] for term in model]
            places = np.sort(np.concatenate([self.evidence.own_terms, *kept]))
            total = sum(split.error(places) for split in self._splits)
            self._errors[model] = total / len(self._splits)
        return self._errors[model]


@dataclass(frozen=True, eq=False)
class Split:
    """Fitted data and the data that they predict; every column of g is one such pair."""

    fitted: InformationShare
    """Fitted data, with the priors."""
    predicted: InformationShare

    def error(self, places: Places) -> float:
        """Return the mean −2 log L of predictions with the parameters at some places fitted."""
        own = np.ix_(places, places)
        scaled = ScaledInformation.of(self.fitted.information[own])
        values, vectors = np.linalg.eigh(scaled.matrix)
        # Combinations that the fitted data do not determine keep the values of linearisation.
        kept = values > EXCITABLE * values[-1]
        scales = np.where(scaled.scales > 0, scaled.scales, 1.0)
        root = vectors[:, kept] / np.sqrt(values[kept]) / scales[:, None]
        steps = root @ (root.T @ self.fitted.gradient[places])
        error = self.predicted.information[own] @ steps - 2 * self.predicted.gradient[places]
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
        rest = InformationShare(
            whole.information - few.information, whole.gradient[:, None] - few.gradient
        )
        return (Split(_add_prior(evidence, few), rest),)
    found = []
    for number, recording in enumerate(recordings):
        others = [few for place, few in enumerate(fitted) if place != number]
        count = max(few.gradient.shape[1] for few in others)
        alike = [
            InformationShare(
                few.information, few.gradient[:, np.arange(count) % few.gradient.shape[1]]
            )
            for few in others
        ]
        whole = recording.total
        predicted = InformationShare(whole.information, whole.gradient[:, None])
        found.append(
            Split(_add_prior(evidence, reduce(InformationShare.__add__, alike)), predicted)
        )
    return tuple(found)


def _fitted_periods(recording: RecordingInformation, share: float) -> InformationShare:
    """Return a share of a recording's periods, at least one, starting at each period in turn."""
    count = recording.periods.shape[1]
    length = max(1, min(round(share * count), count - 1))
    following = np.arange(count)[:, None] + np.arange(length)
    gradients = recording.periods[:, following % count].sum(axis=2)
    return InformationShare(recording.total.information * (length / count), gradients)


def _add_prior(evidence: Evidence, few: InformationShare) -> InformationShare:
    """Add the priors to some data."""
    prior = evidence.prior
    return InformationShare(
        prior.information + few.information, prior.gradient[:, None] + few.gradient
    )
