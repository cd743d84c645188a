"""Effects that the tests would not detect, and the errors that they would cause.

Baarda's reliability (Publications on Geodesy 2-5, 1968). Internal: the smallest size of each
candidate effect that its test finds with a probability of `POWER`. For one column z with the
information I (`estimation.diagnostics.joint_system`) and the noncentrality λ of its test it is
√(λ/I). External: an effect of size c moves the parameters by D c, where D is the response of the
estimator (`Influence.response`). For several columns, the effects with cᵀ I c ≤ λ move parameter p
by at most √(λ d I⁻¹ dᵀ), d the row of D.

An effect is the same in all recordings: its shifts add, and it is tested in all of them together.
In one of them alone, what the others say of the parameters contains the effect as well. The scores
of all recordings, at their joint fit, add to s with the information

    I = Σ (I_r + A_r J A_rᵀ) − (Σ A_r) J (Σ A_r)ᵀ,

A_r, (q, u), being the changes of the jointly fitted parameters and deviations by the effect in
recording r alone, and J their information.

Effects that a tolerance describes are part of the standard deviations already, and effects without
any information, such as a common factor of all forces, have no limit: both are left out.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter
from typing import Annotated

import numpy as np
import scipy

from constraints.arrays import Array
from estimation.diagnostics import joint_system
from estimation.diagnostics.attribution import (
    Attribution,
    build_effect,
    describe_candidate,
    hypothesis_finding,
)
from estimation.diagnostics.finding import Finding, join_words
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.diagnostics.search import RIVAL_LEVEL, EffectCandidate, list_candidates
from estimation.diagnostics.significance import Strut, noncentrality
from estimation.estimators.covariance import Influence
from estimation.kinematics import PointwiseMotion
from estimation.measurement_model.motion import root_of_pseudo_inverse
from expdesign.configuration import quantity_text
from expdesign.robot.derived import belongs_to
from expdesign.runfolder import described

_MOST_RIVALS = 5
"""Largest number of named effects that explain the residuals as well."""
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
    derived: Annotated[
        dict[str, float], described("SI", "largest change of every derived quantity")
    ] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class CandidateReliability:
    """Candidate effect in one recording, or in all of them together."""

    item: EffectCandidate
    scores: joint_system.ConditionalScores
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
        item, constant = self.item, self.item.constant
        return item.kind, item.parameter, item.strut, constant if np.isfinite(constant) else None

    @cached_property
    def fit(self) -> joint_system.EffectFit:
        """Joint fit of its columns."""
        return self.scores.fit(range(len(self.response)))

    @cached_property
    def tested(self) -> EffectCandidate:
        """The candidate with p of its joint fit."""
        return replace(self.item, log_p=self.item.log_p_of(self.fit, self.scores.freedom))

    @property
    def is_possible(self) -> bool:
        """Whether its values are within their bounds, or beyond them by noise alone."""
        return self.item.is_possible(self.fit.values, self.fit.covariance)

    @property
    def noncentrality(self) -> float:
        """λ."""
        return noncentrality(self.item.limit, self.fit.rank, self.scores.freedom)


def candidate_reliability(
    attribution: Attribution,
    system: joint_system.JointSystem,
    part: Linearisation,
    tolerated: Signature,
    influence: Influence,
    *,
    known: PointwiseMotion | None = None,
    stated: Collection[str] = (),
) -> tuple[CandidateReliability, ...]:
    """Return the reliability of all candidates in one recording.

    `system` is that of the recording without the deviations `tolerated`, which the tests regard as
    unknown; `known` the motion, taken as known, if there is no model of it. Terms whose size is
    `stated` as a tolerance, of zero if the machine has none, are left out.
    """
    tests = attribution.first
    signature = Signature.concatenate([each.hypothesis.columns for each in tests.families.values()])
    count = int(np.count_nonzero(part.free))
    forces = part.cells.expand(signature.forces)
    lengths = part.length_cells.expand(signature.lengths)
    if known is not None:  # a known motion
        samples = (len(influence.experiment.recording.forces.times), *forces.shape[1:])
        lengths, some = np.broadcast_to(0.0, samples), forces
        forces = np.zeros(samples)
        forces[known.rows] = some
    shift = influence.response(forces.__getitem__, lengths.__getitem__)[:count]
    counted = np.zeros(signature.count, dtype=bool)
    if tolerated.count:
        # Unknown deviations explain more of the columns than those within their tolerances.
        free = system.with_effects(tolerated).solution.root
        known_share, share = (
            np.sum((attribution.products @ root) ** 2, axis=1)
            for root in (tests.solution.root, free)
        )
        left = np.diag(tests.conditional.information) + known_share - share
        counted = ~replace(tests.conditional, information=np.diag(left)).identifiable
    columns = part.regressors[:, :, part.free].reshape(-1, count)
    gram = columns.T @ columns / len(columns)
    size = attribution.products.shape[1]
    unknown = np.r_[0:count, size - tolerated.count : size]
    response = attribution.products @ tests.solution.inverse[:, unknown]
    unknowns = tests.solution.inverse[np.ix_(unknown, unknown)]
    return tuple(
        CandidateReliability(
            item,
            tests.conditional.select(item.places),
            response[item.places],
            unknowns,
            shift[:, item.places],
            gram,
        )
        for item in list_candidates(tests.families)
        if item.kind not in stated and not np.all(counted[item.places])
    )


def join_recordings(
    recordings: Sequence[Sequence[CandidateReliability]],
) -> tuple[CandidateReliability, ...]:
    """Return the candidates that can be tested in all recordings together."""
    groups: dict[_Key, list[CandidateReliability]] = {}
    root = np.zeros((0, 0))
    for candidate in (candidate for recording in recordings for candidate in recording):
        if len(recordings) > 1 and not root.size:
            # The same in all of them.
            root = root_of_pseudo_inverse(candidate.unknowns, joint_system.DETERMINED)
        groups.setdefault(candidate.key, []).append(candidate)
    joint = (_join(own, root) if len(own) > 1 else own[0] for own in groups.values())
    return tuple(each for each in joint if each.fit.rank)


def _join(own: Sequence[CandidateReliability], root: Array) -> CandidateReliability:
    """Return one effect in all recordings; R Rᵀ = J, (u, u), with R = `root`."""
    parts = [each.response @ root for each in own]
    total, scores = np.sum(parts, axis=0), [each.scores for each in own]
    information = sum(
        each.information + part @ part.T for each, part in zip(scores, parts, strict=True)
    )
    joint = joint_system.ConditionalScores(
        np.sum([each.score for each in scores], axis=0),
        information - total @ total.T,
        np.sum([each.whole for each in scores], axis=0),
        min(each.freedom for each in scores),
    )
    return replace(
        own[0],
        item=replace(own[0].item, limit=min(each.item.limit for each in own)),
        scores=joint,
        response=np.sum([each.response for each in own], axis=0),
        shift=np.sum([each.shift for each in own], axis=0),
        gram=np.mean([each.gram for each in own], axis=0),
    )


def common_effect_findings(
    candidates: Sequence[CandidateReliability], attributions: Sequence[Attribution]
) -> tuple[Finding, ...]:
    """Return the finding of an effect that only all recordings together show."""
    if len(attributions) == 1 or any(each.effects for each in attributions):
        return ()
    significant = [each for each in candidates if each.tested.excess < 0]
    possible = [each for each in significant if each.is_possible]
    if not significant:
        return ()
    best = min(possible or significant, key=lambda each: each.tested.excess)
    alike = sorted(
        (each.tested for each in possible if _is_rival(each, best)), key=attrgetter("log_p")
    )
    rivals = {one.name: one for one in alike[:_MOST_RIVALS]}
    fit = best.fit.values, best.fit.covariance
    effect = build_effect(best.item, best.tested.excess, fit, tuple(rivals.values()))
    attribution = replace(attributions[0], effects=(effect,))
    finding = hypothesis_finding(attribution, best.item.hypothesis)
    return (finding.name_part("all recordings together"),)


def _is_rival(one: CandidateReliability, best: CandidateReliability) -> bool:
    """Return whether a candidate explains nearly as much as the best one, another effect."""
    least = best.fit.statistic - scipy.stats.chi2.isf(RIVAL_LEVEL, best.fit.rank)
    return one.item.name != best.item.name and one.fit.statistic > least


def undetected_effect(
    own: CandidateReliability, names: Sequence[str], std: Array, derived: Mapping[str, Array]
) -> UndetectedEffect:
    """Return what a candidate may do undetected.

    `names` and `std`, (k,), SI, are those of the estimated parameters, `derived` the derivatives of
    further quantities with respect to them, (k,).
    """
    covariance, count = own.fit.covariance, len(names)
    moves = np.concatenate([own.shift, *(row[None] @ own.shift for row in derived.values())])
    every = np.einsum("kq,qr,kr->k", moves, covariance, moves)
    changes = np.sqrt(own.noncentrality * np.maximum(every, 0.0))
    spreads, shifts = every[:count], changes[:count]
    k = int(np.argmax(shifts / std))
    direction, spread = covariance @ own.shift[k], float(spreads[k])
    change = direction * np.sqrt(own.noncentrality / spread) if spread > 0 else direction
    moved = own.shift @ change
    kind, name, strut, constant = own.key
    # Further values are of auxiliary columns.
    shown = change[: own.item.hypothesis.values_shown]
    return UndetectedEffect(
        kind=kind,
        strut=strut,
        parameter=name,
        constant=constant,
        freedom=own.fit.rank,
        size=float(np.linalg.norm(shown)),
        text=describe_candidate(own.item.hypothesis, name, strut, shown),
        shifts=dict(zip(names, shifts.tolist(), strict=True)),
        derived=dict(zip(derived, changes[count:].tolist(), strict=True)),
        sigmas=float(shifts[k] / std[k]),
        worst=names[k],
        forces=float(np.sqrt(moved @ own.gram @ moved)),
    )


def changes_in_words(
    effects: Sequence[UndetectedEffect],
    stds: Mapping[str, float],
    units: Mapping[str, str],
    wanted: Sequence[str],
) -> str:
    """Compare the changes of wanted quantities by any effect with their standard deviations.

    The words continue the sentence of an accepted estimate and name the worst effect. `stds` and
    `units` are those of parameters and derived quantities, SI; `wanted` may name groups of them.

    Examples
    --------
    >>> changes_in_words((), {}, {}, ("mass",))
    ''
    """
    within, beyond = dict[str, str](), list[tuple[float, str, str]]()
    for name in dict.fromkeys(wanted):
        changes = [
            (change / stds[one], change, one, effect.text)
            for effect in effects
            for one, change in {**effect.shifts, **effect.derived}.items()
            if belongs_to(one, name) and stds.get(one, 0.0) > 0
        ]
        if not changes:
            continue
        ratio, change, one, by = max(changes)
        within_std = ratio <= 1
        if within_std:
            change = max(size for _, size, _, _ in changes)
        size = f"{1e3 * change:.2g} mm" if units[one] == "m" else ""
        size = size or quantity_text(change, units[one], 2)
        if within_std:
            within[name] = size
        else:
            beyond.append((ratio, by, f"{name} by {size} ({ratio:.2g} σ)"))
    words = ""
    if beyond:
        _, worst, _ = max(beyond)
        own, others = (
            join_words(change for _, by, change in beyond if (by == worst) == is_own)
            for is_own in (True, False)
        )
        words = f", but {worst} would not be seen and could change {own}"
        words += f", other effects {others}" if others else ""
    if within:
        names, each = (join_words(part) for part in (within, within.values()))
        whose = "its" if len(within) == 1 else "their"
        words += f"; undetected effects change {names} by less than {whose} σ (at most {each})"
    return words


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
