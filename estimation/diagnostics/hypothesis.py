"""Family of candidate effects with a common hypothesis, and its conditional test.

A `Hypothesis` states the columns of its candidates, their level and their description;
`evaluate_hypothesis` tests every candidate, given known effects.
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
from estimation.diagnostics.significance import HYPOTHESES, Strut, log_tail
from expdesign.mechanism.terms import parameter_unit
from expdesign.runfolder import OpenNumber, OpenNumbers, described

Label = tuple[str, int | None]
"""Parameter, or empty, and actuator (from 0; None: all of them)."""

MODELLED = "the model has the term, or its columns explain the effect"
"""Reason why no candidate of a family can be tested."""

POWER = 0.8
"""Power of the test at the smallest detectable values."""


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """Family of candidate effects that are tested and described alike."""

    kind: str
    """Kind of the effects."""
    labels: tuple[Label, ...]
    """Labels of the candidates. Candidates with equal labels differ in a constant (a speed)."""
    columns: Signature
    """Columns of all candidates, per SI unit of the effect."""
    assumption: Assumption
    """Assumption that there is no such effect."""
    noun: str
    """Noun for such an effect, such as ``a constant force``."""
    absent: str
    """Sentence if none was found; a format of `p`, and of `value` and `std` of the most significant
    candidate."""
    reason_untested: str = MODELLED
    """Reason for an omitted test, if no column remains."""
    level: float = HYPOTHESES
    """Level of all candidates together."""
    places: tuple[tuple[int, ...], ...] = ()
    """Indices of every candidate's columns; by default one each, in their order."""
    constants: tuple[float, ...] = ()
    """Constant of every candidate, SI; by default none."""
    at: Callable[[Label, float], Signature] | None = None
    """Function for the columns of a candidate with another constant, to find the best one."""
    sized_by_constant: bool = False
    """Whether the best constant is the size of the effect, such as the delay of its secant."""
    scale: float = 1.0
    """Factor from SI to the displayed unit."""
    number: str = "+.3g"
    """Format of a displayed value."""
    unit: Callable[[str], str] = parameter_unit
    """Function from the parameter to the displayed unit."""
    values_shown: int | None = None
    """Number of a candidate's values that are displayed; None: all."""
    paired: bool = False
    """Whether values are pairs of sine and cosine; their amplitudes are displayed."""
    phrase: str = "{noun} {place}"
    """Format of the noun and the place of an effect."""
    contains: str = ""
    """Kind of the effects that are special cases of this one, and therefore no rivals."""
    modelled: bool = False
    """Whether the model has a term for it: then there is no assumption to test."""

    @property
    def candidates(self) -> int:
        """Number of candidates."""
        return len(self.labels)

    def columns_of(self, candidate: int) -> Places:
        """Return the indices of a candidate's columns in the family."""
        own = self.places[candidate] if self.places else (candidate,)
        return np.array(own, dtype=np.intp)

    def constant_of(self, candidate: int) -> float:
        """Return a candidate's constant; NaN if the family has none."""
        return self.constants[candidate] if self.constants else np.nan


@dataclass(frozen=True, eq=False)
class HypothesisTest:
    """Tests of every candidate of a family."""

    hypothesis: Hypothesis
    first: int
    """Index of its first column in the projection."""
    statistic: Array
    """(n,), χ²; NaN if a candidate cannot be tested."""
    rank: Array
    """(n,), degrees of freedom."""
    log_p: Array
    """(n,), log p of each candidate alone."""

    @property
    def tested(self) -> int:
        """Number of candidates that can be tested."""
        return int(np.count_nonzero(np.isfinite(self.log_p)))

    @property
    def best(self) -> int:
        """Index of the most significant candidate; -1 if none can be tested."""
        return int(np.nanargmin(self.log_p)) if self.tested else -1

    @property
    def limit(self) -> float:
        """Largest log p of a significant candidate."""
        return float(np.log(self.hypothesis.level / max(self.tested, 1)))

    def places(self, candidate: int) -> Places:
        """Return the indices of a candidate's columns in the projection."""
        return self.hypothesis.columns_of(candidate) + self.first


def evaluate_hypothesis(
    conditional: ConditionalScores, hypothesis: Hypothesis, first: int
) -> HypothesisTest:
    """Test every candidate alone; the family's columns start at `first` in the projection."""
    count = hypothesis.candidates
    statistic, rank = np.full(count, np.nan), np.ones(count)
    if hypothesis.places:
        for number in range(count):
            fit = conditional.fit(hypothesis.columns_of(number) + first)
            if fit.rank:
                statistic[number], rank[number] = fit.statistic, fit.rank
    else:
        own = slice(first, first + count)
        seen = conditional.identifiable[own]
        information = np.where(seen, np.diag(conditional.information)[own], np.nan)
        statistic = conditional.score[own] ** 2 / information
    log_p = np.full(count, np.nan)
    done = np.isfinite(statistic)
    log_p[done] = log_tail(statistic[done], rank[done], conditional.freedom)
    return HypothesisTest(hypothesis, first, statistic, rank, log_p)


@dataclass(frozen=True, eq=False)
class CandidateResult:
    """Test of one candidate."""

    parameter: Annotated[
        str, described("", "parameter of the column, or base or platform; or empty")
    ]
    actuator: Annotated[Strut, described("1", "number of the actuator; null: all of them")]
    constant: Annotated[OpenNumber, described("SI", "constant of the columns; null: none")]
    statistic: Annotated[OpenNumber, described("1", "χ²; null: it cannot be tested")]
    freedom: Annotated[
        float, Field(alias="degrees_of_freedom"), described("1", "identifiable combinations")
    ]
    log_p: Annotated[OpenNumber, described("1", "logarithm of p, uncorrected")]
    values: Annotated[OpenNumbers, described("SI", "estimated size")]
    std: Annotated[OpenNumbers, described("SI", "standard deviations of the values")]
    detectable: Annotated[
        OpenNumbers, described("SI", "smallest values, each alone, that are detected with `power`")
    ]
    failed: Annotated[bool, described("", "the effect is significant")]


@dataclass(frozen=True, eq=False)
class HypothesisResult:
    """Tests of all candidates of a family, as stored."""

    kind: Annotated[str, described("", "kind of the family")]
    power: Annotated[float, described("1", "power of the test at `detectable`")]
    family_level: Annotated[float, described("1", "level of all candidates together")]
    tested: Annotated[int, described("1", "number of candidates that can be tested")]
    candidates: Annotated[tuple[CandidateResult, ...], described("", "candidates one by one")]

    @classmethod
    def of(cls, test: HypothesisTest, conditional: ConditionalScores) -> Self:
        """Convert a test, given the known effects."""
        hypothesis = test.hypothesis
        far = scipy.stats.norm.isf(np.exp(test.limit) / 2) + scipy.stats.norm.ppf(POWER)
        rows = []
        own = slice(test.first, test.first + hypothesis.columns.count)
        information = np.where(
            conditional.identifiable[own], np.diag(conditional.information)[own], np.nan
        )
        alone = conditional.score[own] / information, 1 / np.sqrt(information)
        for number, (name, strut) in enumerate(hypothesis.labels):
            values, std = (each[number : number + 1] for each in alone)
            if hypothesis.places:
                fit = conditional.fit(test.places(number))
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
        """Most significant candidate; None if none was tested."""
        found = [each for each in self.candidates if np.isfinite(each.log_p)]
        return min(found, key=lambda each: each.log_p, default=None)


@dataclass(frozen=True)
class DelayTest:
    """Lag of the forces behind the lengths, beyond the given delays."""

    refused: Annotated[str, described("", "reason for an omitted test; otherwise empty")]
    delay: Annotated[
        OpenNumber, Field(alias="seconds"), described("s", "positive when the forces lag")
    ] = np.nan
    std: Annotated[OpenNumber, described("s", "standard deviation of the delay")] = np.nan
    log_p: Annotated[
        OpenNumber, described("1", "logarithm of p of no delay, corrected for the trials")
    ] = np.nan
    failed: Annotated[bool, described("", "the delay is significant")] = False

    @classmethod
    def of(cls, result: HypothesisResult, hypothesis: Hypothesis) -> Self:
        """Build the result from the most significant secant."""
        best = result.best
        if best is None:
            return cls(hypothesis.reason_untested)
        log_p = min(0.0, best.log_p + float(np.log(result.tested)))
        return cls("", float(best.values[0]), float(best.std[0]), log_p, best.failed)

    @model_serializer(mode="wrap")
    def _in_a_file(self, fields: Any) -> dict[str, Any]:
        return {"refused": self.refused} if self.refused else fields(self)
