"""Forward and backward steps from the robot's own terms to those that the data support.

What a step of the selection is judged by: Schwarz's criterion, an F test, or held-out forces.

Each of them is a potential that every step must lower, so that no model comes twice.
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
from expdesign.configuration.sections.estimate import SelectionCriterion
from expdesign.information.fisher import EXCITABLE, ScaledInformation
from expdesign.runfolder import OpenNumber, described


@dataclass(frozen=True)
class SelectionRow:
    """One block that was tried in one step."""

    step: Annotated[int, described("1", "number of the step, from 1")]
    direction: Annotated[str, described("", "add or drop")]
    term: Annotated[str, described("", "the term that was tried")]
    beside: Annotated[str, described("", "candidates that were in the model beside it")]
    parameters: Annotated[int, described("1", "combinations of its parameters that are seen")]
    statistic: Annotated[
        float, described("1", "chi-square of the term beside the others, over the dispersion")
    ]
    log_p: Annotated[float, described("1", "logarithm of p of its F test, of this test alone")]
    samples: Annotated[
        float, described("1", "independent samples that would tell as much of its parameters")
    ]
    bic: Annotated[float, described("1", "change of Schwarz's criterion with the term")]
    held_out: Annotated[
        OpenNumber,
        described("1", "change of -2 log L of what was not fitted; empty: not asked for"),
    ]
    worth: Annotated[
        float, described("1", "by how much the criterion is in favour: it belongs there above 0")
    ]
    chosen: Annotated[bool, described("", "the step was done: the term was added, or dropped")]


def select(judge: Judge) -> tuple[tuple[str, ...], tuple[SelectionRow, ...]]:
    """Return the candidates that belong into the model, in the order of entry, and the path.

    Forward, the candidate that is worth most enters, if it is worth anything; after each entry
    those that are worth nothing beside the others leave, the least worthy first. It ends when
    neither changes the model, or brings back one that was there. A term that takes the constants of
    another enters after it, and leaves before it.
    """
    model: tuple[str, ...] = ()
    rows: list[SelectionRow] = []
    seen = {frozenset(model)}
    while True:
        for direction in ("drop", "add"):
            changed, tried = _step(judge, model, direction, len(rows) and rows[-1].step)
            rows += tried
            if changed != model:
                break
        if changed == model or frozenset(changed) in seen:
            return changed, tuple(rows)
        model = changed
        seen.add(frozenset(model))


def _step(
    judge: Judge, model: tuple[str, ...], direction: str, before: int
) -> tuple[tuple[str, ...], list[SelectionRow]]:
    """Return the model after one step of a kind, and what was tried."""
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
        one = judge.tried(term, others)
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
    """What the data say of one block beside some others."""

    term: str
    statistic: float
    """χ² of the block, over the dispersion."""
    rank: int
    """Its degrees of freedom: combinations of its parameters that are seen."""
    log_p: float
    """Logarithm of the F test's p, uncorrected."""
    bic: float
    """By how much the block lowers Schwarz's criterion."""
    held_out: float
    """By how much it lowers −2 log L of what was not fitted; NaN where that is not asked."""


class Judge:
    """Weighs blocks against each other, each beside a model's others."""

    def __init__(
        self,
        evidence: Evidence,
        by: SelectionCriterion,
        level: float,
        needs: Mapping[str, str] | None = None,
    ) -> None:
        self.evidence, self.by = evidence, by
        self.needs = dict(needs or {})
        """Candidates that belong into no model without another one, and this one."""
        self.dispersion = evidence.dispersion()
        self.samples = {term: evidence.samples(term) for term in evidence.blocks}
        self.limit = float(np.log(level / len(evidence.blocks)))
        """Largest log p that is significant: the level's share of one of all candidates."""
        self._seen = evidence.conditional_on_own_terms()
        self._splits = splits(evidence) if by == "holdout" else ()
        self._errors: dict[frozenset[str], float] = {}

    def tried(self, term: str, others: Sequence[str]) -> TermTrial:
        """Return what a block is worth beside a model's others."""
        known = [self.evidence.places(other) for other in others]
        beside = self._seen.conditional_on(np.concatenate([np.zeros(0, dtype=np.intp), *known]))
        fit: EffectFit = beside.fit(self.evidence.places(term))
        statistic = fit.statistic / self.dispersion
        log_p = 0.0
        if fit.rank:
            log_p = float(log_tail(np.array(statistic), np.array(fit.rank), beside.freedom))
        held_out = np.nan
        if self.by == "holdout":
            # What nothing tells from the others predicts as they do.
            held_out = self._error(others) - self._error([*others, term]) if fit.rank else 0.0
        bic = statistic - fit.rank * float(np.log(self.samples[term]))
        return TermTrial(term, statistic, fit.rank, log_p, bic, held_out)

    def worth(self, tried: TermTrial) -> float:
        """Return how much a block is worth in a model: it belongs there above zero."""
        if self.by == "bic":
            return tried.bic
        if self.by == "f":
            return self.limit - tried.log_p
        return tried.held_out

    def _error(self, terms: Sequence[str]) -> float:
        """Return −2 log L of what was not fitted, less that of the values linearised about."""
        model = frozenset(terms)
        if model not in self._errors:
            kept = [self.evidence.blocks[term] for term in model]
            places = np.sort(np.concatenate([self.evidence.own, *kept]))
            total = sum(split.error(places) for split in self._splits)
            self._errors[model] = total / len(self._splits)
        return self._errors[model]


@dataclass(frozen=True, eq=False)
class Split:
    """Data that parameters are fitted to, and others that they predict: one pair a column of g."""

    fitted: InformationShare
    """With what is known beside the data."""
    predicted: InformationShare

    def error(self, places: Places) -> float:
        """Return −2 log L of the predictions by fits of the parameters at some places, in mean."""
        own = np.ix_(places, places)
        scaled = ScaledInformation.of(self.fitted.information[own])
        values, vectors = np.linalg.eigh(scaled.matrix)
        # Combinations that the fitted data do not tell stay where the model was linearised.
        kept = values > EXCITABLE * values[-1]
        scales = np.where(scaled.scales > 0, scaled.scales, 1.0)
        root = vectors[:, kept] / np.sqrt(values[kept]) / scales[:, None]
        steps = root @ (root.T @ self.fitted.gradient[places])
        error = self.predicted.information[own] @ steps - 2 * self.predicted.gradient[places]
        return float(np.mean(np.sum(error * steps, axis=0)))


def splits(evidence: Evidence) -> tuple[Split, ...]:
    """Return how the recordings are divided.

    Of several recordings each in turn is predicted, from some periods of all others. Of a single
    one some periods in turn predict the rest.

    Notes
    -----
    A model that is chosen by its prediction is the right one with many data only if nearly all of
    them are predicted and few are fitted (Shao, J. Am. Stat. Assoc. 88, 1993); with the share
    1 / (log n - 1) of n samples fitted it is the one of Schwarz's criterion (Shao, Statistica
    Sinica 7, 1997). One period left out would add superfluous terms however many there are.

    Raises
    ------
    InputError
        There is a single recording, without two single periods.
    """
    recordings = evidence.recordings
    share = 1 / max(np.log(sum(each.samples for each in recordings)) - 1, 1.0)
    fitted = [_fitted(each, share) for each in recordings]
    if len(recordings) == 1:
        whole, few = recordings[0].whole, fitted[0]
        if recordings[0].periods.shape[1] == 1:
            raise InputError(
                "one recording without whole periods leaves nothing to predict",
                key="estimate.select.by",
                allowed="bic, f, or a further recording (--data twice)",
            )
        rest = InformationShare(
            whole.information - few.information, whole.gradient[:, None] - few.gradient
        )
        return (Split(_known(evidence, few), rest),)
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
        whole = recording.whole
        predicted = InformationShare(whole.information, whole.gradient[:, None])
        found.append(Split(_known(evidence, reduce(InformationShare.__add__, alike)), predicted))
    return tuple(found)


def _fitted(recording: RecordingInformation, share: float) -> InformationShare:
    """Return a share of the periods of a recording, one at least, from each of them on."""
    count = recording.periods.shape[1]
    length = max(1, min(round(share * count), count - 1))
    following = np.arange(count)[:, None] + np.arange(length)
    gradients = recording.periods[:, following % count].sum(axis=2)
    return InformationShare(recording.whole.information * (length / count), gradients)


def _known(evidence: Evidence, few: InformationShare) -> InformationShare:
    """Return some data with what is known beside them."""
    prior = evidence.prior
    return InformationShare(
        prior.information + few.information, prior.gradient[:, None] + few.gradient
    )
