"""Effects that the tests would not detect, and the errors that they would cause.

Baarda's reliability (Publications on Geodesy 2-5, 1968). Internal: the smallest size of each
candidate effect that its test finds with a probability of `POWER`. For one column z with the
information I (`estimation.diagnostics.joint_system`) and the noncentrality λ of its test it is
√(λ/I). External: an effect of size c moves the parameters by D c, where D is the response of the
estimator (`Influence.response`). For several columns, the effects with cᵀ I c ≤ λ move parameter p
by at most √(λ d I⁻¹ dᵀ), d the row of D.

The effects of all recordings are the same: their shifts add, and each recording tests them alone,
with the information of the others on parameters and deviations. An effect disturbs that, too. The
score of the test then has the expectation H c with H = I − A J Aₒᵀ, where A and Aₒ, (q, u), are the
changes of the jointly fitted parameters and deviations by the effect in this recording and in all
others, and J is their information: the test sees Hᵀ I⁻¹ H, not I.

Effects that a tolerance describes are part of the standard deviations already, and effects without
any information, such as a common factor of all forces, have no limit: both are left out.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Annotated

import numpy as np
import scipy
from scipy.optimize import brentq

from constraints.arrays import Array
from estimation.diagnostics.attribution import Attribution, describe_candidate
from estimation.diagnostics.hypothesis import POWER, Hypothesis
from estimation.diagnostics.joint_system import (
    DETERMINED,
    SEEN,
    ConditionalScores,
    JointSystem,
)
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.diagnostics.significance import Strut
from estimation.estimators.influence import Influence
from estimation.measurement_model.motion import root_of_pseudo_inverse
from expdesign.runfolder import described

_Key = tuple[str, str, int | None, float | None]


@dataclass(frozen=True, eq=False)
class UndetectedEffect:
    """Effect of the size that the tests detect with a probability of 80 %."""

    kind: Annotated[str, described("", "family of the effect, as in `causes`")]
    strut: Annotated[Strut, described("1", "number of the strut; null: all of them")]
    parameter: Annotated[str, described("", "as for a cause")]
    constant: Annotated[float | None, described("SI", "constant of its columns; null: none")]
    freedom: Annotated[int, described("1", "number of its values that the data determine")]
    size: Annotated[
        float, described("SI", "smallest size that is detected; of several values, their norm")
    ]
    text: Annotated[str, described("", "the effect and its size in words")]
    shifts: Annotated[
        dict[str, float], described("SI", "largest change of every estimated parameter")
    ]
    sigmas: Annotated[
        float, described("1", "largest change in standard deviations of the parameter")
    ]
    worst: Annotated[str, described("", "parameter with that change")]
    forces: Annotated[
        float, described("N", "rms change of the predicted forces by these shifts along the motion")
    ]


@dataclass(frozen=True, eq=False)
class CandidateReliability:
    """Candidate effect in one recording."""

    hypothesis: Hypothesis
    number: int
    """Family, and number of the candidate in it."""
    freedom: int
    """Degrees of freedom of its test; 0: it cannot be tested."""
    noncentrality: float
    scores: ConditionalScores
    """Of its q columns, with I."""
    response: Array
    """(q, u), A."""
    unknowns: Array
    """(u, u), J⁻¹."""
    shift: Array
    """(k, q), D."""
    gram: Array
    """(k, k), mean square of the forces per product of two parameters."""

    @property
    def key(self) -> _Key:
        """Kind, parameter, strut and constant: the same in all recordings."""
        (name, strut), constant = (
            self.hypothesis.labels[self.number],
            self.hypothesis.constant_of(self.number),
        )
        return self.hypothesis.kind, name, strut, constant if np.isfinite(constant) else None

    @property
    def covariance(self) -> Array:
        """(q, q), I⁻¹."""
        return self.scores.fit(range(len(self.response))).covariance

    def covariance_given(self, others: Sequence[CandidateReliability]) -> Array:
        """Return (Hᵀ I⁻¹ H)⁻¹, (q, q), with the same effect in other recordings."""
        if not others:
            return self.covariance
        elsewhere = np.sum([each.response for each in others], axis=0)
        root = root_of_pseudo_inverse(self.unknowns, DETERMINED)
        seen = self.scores.information - self.response @ root @ (elsewhere @ root).T
        scores = replace(self.scores, information=seen.T @ self.covariance @ seen)
        return scores.fit(range(len(seen)), SEEN**2).covariance


def candidate_reliability(
    attribution: Attribution,
    system: JointSystem,
    part: Linearisation,
    tolerated: Signature,
    influence: Influence,
    *,
    stated: Collection[str] = (),
) -> tuple[CandidateReliability, ...]:
    """Return the reliability of all candidates in one recording.

    Parameters
    ----------
    attribution : Attribution
        Its candidates and their first tests.
    system : JointSystem
        The recording without the deviations `tolerated`, which the tests regard as unknown.
    influence : Influence
        Of the recording's errors on the estimate.
    stated : collection of str
        Terms whose size is stated as a tolerance, of zero if the machine has none: left out.
    """
    tests = attribution.first
    families = list(tests.families.values())
    signature = Signature.concatenate([each.hypothesis.columns for each in families])
    count = int(np.count_nonzero(part.free))
    forces, lengths = (
        part.cells.expand(signature.forces),
        part.length_cells.expand(signature.lengths),
    )
    shift = influence.response(forces.__getitem__, lengths.__getitem__)[:count]
    counted = np.zeros(signature.count, dtype=bool)
    if tolerated.count:
        free = system.with_effects(tolerated).solution.project(signature)
        counted = ~free.conditional_on(()).identifiable
    columns = part.regressors[:, :, part.free].reshape(-1, count)
    gram = columns.T @ columns / len(columns)
    size = attribution.response.shape[1]
    unknown = np.r_[0:count, size - tolerated.count : size]
    response, inverse = attribution.response[:, unknown], tests.solution.inverse
    found = []
    for family in families:
        hypothesis = family.hypothesis
        if hypothesis.kind in stated:
            continue
        for number in range(hypothesis.candidates):
            places = family.places(number)
            if np.all(counted[places]):
                continue
            scores = tests.conditional.select(places)
            rank = int(family.rank[number]) if np.isfinite(family.log_p[number]) else 0
            found.append(
                CandidateReliability(
                    hypothesis,
                    number,
                    rank,
                    _noncentrality(family.limit, rank, scores.freedom) if rank else np.inf,
                    scores,
                    response[places],
                    inverse[np.ix_(unknown, unknown)],
                    shift[:, places],
                    gram,
                )
            )
    return tuple(found)


@cache
def _noncentrality(log_level: float, count: int, freedom: float) -> float:
    """Return λ of a noncentral χ² that is significant at this level with `POWER`.

    With an estimated Σ of ν degrees of freedom, `freedom`, it is `count` times a noncentral F.
    """
    known = not np.isfinite(freedom)
    shape = (count,) if known else (count, freedom)
    central, noncentral = (
        (scipy.stats.chi2, scipy.stats.ncx2) if known else (scipy.stats.f, scipy.stats.ncf)
    )
    critical = central.isf(np.exp(log_level), *shape)

    def lacking(value: float) -> float:
        return float(noncentral.sf(critical, *shape, value)) - POWER

    return float(brentq(lacking, 1e-6, 10 * count * critical + 100))


def undetected_effects(
    recordings: Sequence[Sequence[CandidateReliability]], names: Sequence[str], std: Array
) -> tuple[UndetectedEffect, ...]:
    """Return what every candidate may do undetected, the largest change first.

    Parameters
    ----------
    names : sequence of str
        The k estimated parameters.
    std : (k,)
        Their standard deviations, SI.
    """
    groups: dict[_Key, list[CandidateReliability]] = {}
    for candidate in (candidate for recording in recordings for candidate in recording):
        groups.setdefault(candidate.key, []).append(candidate)
    tested = [own for own in groups.values() if any(each.freedom for each in own)]
    effects = [_combine(own, names, std) for own in tested]
    return tuple(sorted(effects, key=lambda effect: -effect.sigmas))


def _combine(
    own: Sequence[CandidateReliability], names: Sequence[str], std: Array
) -> UndetectedEffect:
    """Combine the recordings of one effect: the most sensitive one detects it."""
    total = np.sum([each.shift for each in own], axis=0)
    tested = [each for each in own if each.freedom]
    covariances = [
        each.covariance_given([one for one in own if one is not each]) for each in tested
    ]
    spreads = np.array(
        [
            each.noncentrality * np.einsum("kq,qr,kr->k", total, covariance, total)
            for each, covariance in zip(tested, covariances, strict=True)
        ]
    )
    shifts = np.sqrt(np.min(spreads, axis=0))
    k = int(np.argmax(shifts / std))
    number = int(np.argmin(spreads[:, k]))
    best, direction = tested[number], covariances[number] @ total[k]
    spread = float(total[k] @ direction)
    change = direction * np.sqrt(best.noncentrality / spread) if spread > 0 else direction
    moved = total @ change
    kind, name, strut, constant = best.key
    # Further values are of auxiliary columns.
    shown = change[: best.hypothesis.values_shown]
    return UndetectedEffect(
        kind=kind,
        strut=strut,
        parameter=name,
        constant=constant,
        freedom=best.freedom,
        size=float(np.linalg.norm(shown)),
        text=describe_candidate(best.hypothesis, name, strut, shown),
        shifts=dict(zip(names, shifts.tolist(), strict=True)),
        sigmas=float(shifts[k] / std[k]),
        worst=names[k],
        forces=float(np.sqrt(moved @ best.gram @ moved)),
    )


def undetected_std(effects: Sequence[UndetectedEffect]) -> dict[str, float]:
    """Return the standard deviation that one undetected effect may add to every parameter.

    An effect of q values that was not found may have any size below the detectable one: uniformly
    distributed within cᵀ I c ≤ λ it has the covariance λ I⁻¹/(q + 2); a single value that of a
    rectangular distribution (GUM 4.3.7).

    Examples
    --------
    >>> undetected_std(())
    {}
    """
    names = effects[0].shifts if effects else {}
    return {
        name: max(effect.shifts[name] / math.sqrt(effect.freedom + 2) for effect in effects)
        for name in names
    }
