"""What a step of the selection is judged by: Schwarz's criterion, an F test, or held-out forces.

Each of them is a potential that every step must lower, so that no model comes twice.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.projection import Fit
from estimation.diagnostics.tails import log_tail
from estimation.selection.evidence import Evidence, Share
from expdesign.configuration import InputError
from expdesign.configuration.sections.data import SelectionCriterion
from expdesign.information.fisher import ScaledInformation


@dataclass(frozen=True)
class Tried:
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
        self._seen = evidence.beside_own()
        self._splits = tuple(splits(evidence)) if by == "holdout" else ()
        self._errors: dict[frozenset[str], float] = {}

    def tried(self, term: str, others: Sequence[str]) -> Tried:
        """Return what a block is worth beside a model's others."""
        known = [self.evidence.places(other) for other in others]
        beside = self._seen.beside(np.concatenate([np.zeros(0, dtype=np.intp), *known]))
        fit: Fit = beside.fit(self.evidence.places(term))
        statistic = fit.statistic / self.dispersion
        log_p = 0.0
        if fit.rank:
            log_p = float(log_tail(np.array(statistic), np.array(fit.rank), beside.freedom))
        held_out = np.nan
        if self.by == "holdout":
            held_out = self._error(others) - self._error([*others, term])
        bic = statistic - fit.rank * float(np.log(self.samples[term]))
        return Tried(term, statistic, fit.rank, log_p, bic, held_out)

    def worth(self, tried: Tried) -> float:
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
    """Data that parameters are fitted to, and others that they predict."""

    fitted: Share
    """With what is known beside the data."""
    predicted: Share

    def error(self, places: Array) -> float:
        """Return −2 log L of the prediction by a fit of the parameters at some places."""
        own = np.ix_(places, places)
        scaled = ScaledInformation.of(self.fitted.information[own])
        if scaled.is_singular():
            raise InputError(
                "one period does not determine the parameters that shall predict the others",
                key="estimate.select.by",
                allowed="bic, f, or motions that tell more",
            )
        step = np.linalg.solve(scaled.matrix, self.fitted.gradient[places] / scaled.scales)
        step /= scaled.scales
        information = self.predicted.information[own]
        return float(step @ information @ step - 2 * self.predicted.gradient[places] @ step)


def splits(evidence: Evidence) -> Iterator[Split]:
    """Yield how the recordings are divided.

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
    recordings, prior = evidence.recordings, evidence.prior
    folds = [each.periods or (each.whole,) for each in recordings]
    share = 1 / max(np.log(sum(each.samples for each in recordings)) - 1, 1.0)
    if len(recordings) == 1:
        (own,) = folds
        if len(own) == 1:
            raise InputError(
                "one recording without whole periods leaves nothing to predict",
                key="estimate.select.by",
                allowed="bic, f, or a further recording (--data twice)",
            )
        for first in range(len(own)):
            few = _window(own, first, share)
            rest = [fold for fold in own if not any(fold is each for each in few)]
            yield Split(sum_of([prior, *few]), sum_of(rest))
        return
    for number, recording in enumerate(recordings):
        others = [fold for place, fold in enumerate(folds) if place != number]
        for first in range(max(map(len, others))):
            few = [fold for own in others for fold in _window(own, first, share)]
            yield Split(sum_of([prior, *few]), recording.whole)


def _window(folds: Sequence[Share], first: int, share: float) -> list[Share]:
    """Return a share of the periods of a recording, one at least, from one of them on."""
    count = max(1, round(share * len(folds)))
    return [folds[(first + k) % len(folds)] for k in range(count)]


def sum_of(shares: Sequence[Share]) -> Share:
    """Return what all of several shares say, of at least one."""
    first, *others = shares
    for other in others:
        first = first + other
    return first
