"""A family of candidate causes: columns with their names, a level, and words.

Tests of the candidates of a family of causes, beside effects that are taken as known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Self

import numpy as np
import scipy
from pydantic import Field, model_serializer

from constraints.arrays import Array
from estimation.diagnostics.finding import Assumption
from estimation.diagnostics.joint_system import ConditionalScores, Places
from estimation.diagnostics.linearisation import Signature
from estimation.diagnostics.significance import Strut, log_tail
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.runfolder import OpenNumber, OpenNumbers, described

Label = tuple[str, int | None]
"""Parameter, or empty, and actuator (from 0; None: all of them)."""

THERE = "the model has the term, or its columns leave nothing to test"
"""Why nothing of a family is left to test."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A family of candidate causes that are tested alike and named in the same words."""

    kind: str
    """Of the effects that are found."""
    labels: tuple[Label, ...]
    """Of the candidates. Those that share one differ in a constant, such as a speed."""
    columns: Signature
    """Of q columns, per SI unit of the effect."""
    level: float
    """Of all its candidates together."""
    assumption: Assumption
    """That there is no such effect."""
    noun: str
    """What such an effect is: ``a constant force``."""
    absent: str
    """The sentence when none was found; a format of `p`, and of `value` and `std` of the most
    significant candidate."""
    reason_untested: str
    """Why there is no test when no column is left."""
    places: tuple[tuple[int, ...], ...] = ()
    """Columns of every candidate; by default one each, in their order."""
    constants: tuple[float, ...] = ()
    """Of every candidate, SI; none by default."""
    at: Callable[[Label, float], Signature] | None = None
    """The columns of a candidate for another constant: where its best value is looked for."""
    sized_by_constant: bool = False
    """The best constant is the size of the effect, such as a delay's of its secant."""
    scale: float = 1.0
    """From SI to the unit shown."""
    number: str = "+.3g"
    """Format of a value."""
    unit: Callable[[str], str] = parameter_unit
    """From the parameter to the unit shown."""
    values_shown: int | None = None
    """How many of a candidate's values tell its size; None: all."""
    paired: bool = False
    """Values are sine and cosine of one sinusoid after the other: amplitudes tell its size."""
    phrase: str = "{noun} {place}"
    """How an effect is named that has a place; a format of both."""
    contains: str = ""
    """Kind of the effects that are this one with a part of it zero: no rivals of it."""
    modelled: bool = False
    """Whether the model has a term for it: then nothing is assumed that could fail."""

    @property
    def candidates(self) -> int:
        """How many there are."""
        return len(self.labels)

    def columns_of(self, candidate: int) -> Places:
        """Return the places of a candidate's columns in the family."""
        own = self.places[candidate] if self.places else (candidate,)
        return np.array(own, dtype=np.intp)

    def constant_of(self, candidate: int) -> float:
        """Return a candidate's constant, NaN where the family has none."""
        return self.constants[candidate] if self.constants else np.nan


POWER = 0.8
"""Of the test, for which the smallest error that is found is stated."""


@dataclass(frozen=True, eq=False)
class HypothesisTest:
    """What is seen of every candidate of a family."""

    hypothesis: Hypothesis
    first: int
    """Place of its first column in the projection."""
    statistic: Array
    """(n,), χ², NaN where nothing is left to be seen."""
    rank: Array
    """(n,), its degrees of freedom."""
    log_p: Array
    """(n,), of each by itself."""

    @property
    def tested(self) -> int:
        """How many candidates leave something to test."""
        return int(np.count_nonzero(np.isfinite(self.log_p)))

    @property
    def best(self) -> int:
        """Number of the most significant candidate; -1 when none is left."""
        return int(np.nanargmin(self.log_p)) if self.tested else -1

    @property
    def limit(self) -> float:
        """Largest log p of a candidate that is significant in its family."""
        return float(np.log(self.hypothesis.level / max(self.tested, 1)))

    def places(self, candidate: int) -> Places:
        """Return the places of a candidate's columns in the projection."""
        return self.hypothesis.columns_of(candidate) + self.first


def evaluate_hypothesis(
    beside: ConditionalScores, hypothesis: Hypothesis, first: int
) -> HypothesisTest:
    """Test every candidate by itself; its columns stand in the projection from `first` on."""
    count = hypothesis.candidates
    statistic, rank = np.full(count, np.nan), np.ones(count)
    if hypothesis.places:
        for number in range(count):
            fit = beside.fit(hypothesis.columns_of(number) + first)
            if fit.rank:
                statistic[number], rank[number] = fit.statistic, fit.rank
    else:
        own = slice(first, first + count)
        seen = beside.seen[own]
        information = np.where(seen, np.diag(beside.information)[own], np.nan)
        statistic = beside.score[own] ** 2 / information
    log_p = np.full(count, np.nan)
    done = np.isfinite(statistic)
    log_p[done] = log_tail(statistic[done], rank[done], beside.freedom)
    return HypothesisTest(hypothesis, first, statistic, rank, log_p)


@dataclass(frozen=True, eq=False)
class CandidateResult:
    """Test of the residuals on the columns of one candidate."""

    parameter: Annotated[str, described("", "whose column it is, or base or platform; or empty")]
    actuator: Annotated[Strut, described("1", "number of the actuator; null: all of them")]
    constant: Annotated[OpenNumber, described("SI", "a constant of the columns; null: none")]
    statistic: Annotated[OpenNumber, described("1", "χ²; null where nothing is left to test")]
    freedom: Annotated[
        float, Field(alias="degrees_of_freedom"), described("1", "combinations that are seen")
    ]
    log_p: Annotated[OpenNumber, described("1", "logarithm of p of this test")]
    values: Annotated[OpenNumbers, described("SI", "what is asked for")]
    std: Annotated[OpenNumbers, described("SI", "standard deviations of the values")]
    detectable: Annotated[
        OpenNumbers, described("SI", "smallest values, each by itself, that are found with `power`")
    ]
    failed: Annotated[bool, described("", "residuals lie along the columns")]


@dataclass(frozen=True, eq=False)
class HypothesisResult:
    """Tests of all candidates of a family."""

    kind: Annotated[str, described("", "of the family")]
    power: Annotated[float, described("1", "of the test")]
    family_level: Annotated[float, described("1", "level of all candidates together")]
    tested: Annotated[int, described("1", "candidates that leave something to test")]
    candidates: Annotated[tuple[CandidateResult, ...], described("", "one by one")]

    @classmethod
    def of(cls, test: HypothesisTest, beside: ConditionalScores) -> Self:
        """State a test."""
        hypothesis = test.hypothesis
        far = scipy.stats.norm.isf(np.exp(test.limit) / 2) + scipy.stats.norm.ppf(POWER)
        rows = []
        own = slice(test.first, test.first + hypothesis.columns.count)
        information = np.where(beside.seen[own], np.diag(beside.information)[own], np.nan)
        alone = beside.score[own] / information, 1 / np.sqrt(information)
        for number, (name, strut) in enumerate(hypothesis.labels):
            values, std = (each[number : number + 1] for each in alone)
            if hypothesis.places:
                fit = beside.fit(test.places(number))
                values, std = fit.values, np.sqrt(np.diag(fit.covariance))
            rows.append(
                CandidateResult(
                    parameter=name,
                    actuator=strut,
                    constant=hypothesis.constant_of(number),
                    statistic=float(test.statistic[number]),
                    freedom=float(test.rank[number]),
                    log_p=float(test.log_p[number]),
                    values=values,
                    std=std,
                    detectable=far * std,
                    failed=bool(test.log_p[number] < test.limit),
                )
            )
        return cls(hypothesis.kind, POWER, hypothesis.level, test.tested, tuple(rows))

    @property
    def best(self) -> CandidateResult | None:
        """The most significant candidate; None when nothing was tested."""
        found = [each for each in self.candidates if np.isfinite(each.log_p)]
        return min(found, key=lambda each: each.log_p, default=None)


@dataclass(frozen=True)
class DelayTest:
    """By how much the forces lag behind the lengths, beyond the delays that were given."""

    refused: Annotated[str, described("", "why there is no test; empty when there is one")]
    delay: Annotated[
        OpenNumber, Field(alias="seconds"), described("s", "positive when the forces lag")
    ] = np.nan
    std: Annotated[OpenNumber, described("s", "standard deviation of the delay")] = np.nan
    log_p: Annotated[
        OpenNumber, described("1", "logarithm of p of the test of no delay, of all that were tried")
    ] = np.nan
    failed: Annotated[bool, described("", "there is a delay")] = False

    @classmethod
    def of(cls, result: HypothesisResult, hypothesis: Hypothesis) -> Self:
        """Take the most significant of its secants."""
        best = result.best
        if best is None:
            return cls(hypothesis.reason_untested)
        log_p = min(0.0, best.log_p + float(np.log(result.tested)))
        return cls("", float(best.values[0]), float(best.std[0]), log_p, best.failed)

    @model_serializer(mode="wrap")
    def _in_a_file(self, fields: Any) -> dict[str, Any]:
        return {"refused": self.refused} if self.refused else fields(self)
