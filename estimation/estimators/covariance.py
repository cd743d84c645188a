"""Covariance of estimates: influence of noise and of machine deviations on an estimate.

To first order every estimator here is linear in the errors of the mean forces and lengths,
p̂ − p = Σ_n K_fᵀ ε_f + Σ_n K_lᵀ ε_l, whatever its weights are. The same K yields the covariance
under white or coloured noise (a sandwich estimator: the weights may be wrong), the covariance of
the difference between two estimators of the same data, and the response to errors that the model
leaves out (`Influence.response`).

The systematic part of the covariance follows in the same manner. Deviations θ of the machine from
its description move the estimate by D θ, D = Σ K_fᵀ Z_f + K_lᵀ Z_l over all experiments, with the
sensitivities Z of forces and lengths to θ. The tolerances give θ the covariance Θ, so that the
systematic part is D Θ Dᵀ (GUM, type B). θ is the same in all recordings of a machine: D is summed
before it is squared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.estimators.experiment import Experiment
from estimation.estimators.joint_equations import PerturbedMachine
from estimation.estimators.prior_estimate import PriorEstimate
from estimation.measurement_model import Motion
from estimation.measurement_model.prediction import chunks
from estimation.processing.noise import NoiseEstimate
from expdesign.noise import lines_of
from expdesign.robot import Robot
from expdesign.robot.deviation import LAGS_OF_FORCES, Deviation
from expdesign.runfolder import Numbers, OpenNumber, described

Part = tuple[slice, Array]
"""Samples, and K at these samples, (S, 6, k): units of the parameters per N or m."""


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariance of estimates and the uncertainty of its diagonal."""

    matrix: Array
    """(k, k)."""
    variance: Array
    """(k,), variance of the diagonal's elements: zero where the noise is taken as known."""
    white: Array
    """(k, k), covariance under white noise with the same covariance of one sample."""

    def __add__(self, other: Covariance) -> Covariance:
        """Add the covariance due to independent noise."""
        return Covariance(
            self.matrix + other.matrix, self.variance + other.variance, self.white + other.white
        )

    @classmethod
    def known(cls, matrix: Array) -> Covariance:
        """Build a covariance that is given, not estimated."""
        return cls(matrix, np.zeros(len(matrix)), matrix)


@dataclass(frozen=True, eq=False)
class Influence:
    """Linear effect of one experiment's errors on an estimate.

    Rows of the gains are the k free parameters, followed by the e entries of θ that were estimated
    with them: r = k + e.
    """

    robot: Robot
    experiment: Experiment
    motion: Motion | None
    """Motion at which the regressors were evaluated; None: the pointwise motion."""
    values: Array
    """(m,), estimated parameters, SI."""
    free: NDArray[np.bool_]
    weights: NoiseEstimate
    """Noise by which the forces are weighted, with its filter: their own, or an assumed one."""
    force_gain: Array
    """(r, k), gain on the parameters' columns; (r, k + x) with the motion's columns."""
    length_gain: Array | None
    """(r, x), gain on the motion's columns in the lengths; None after pointwise kinematics."""
    machine: PerturbedMachine
    """Machine with its estimated deviations θ: in both gains their columns precede those of the
    motion."""

    @property
    def inverse(self) -> Array:
        """(r, r), F⁻¹ of all experiments: the gain on the columns of the estimated unknowns."""
        return self.force_gain[:, : len(self.force_gain)]

    def forces(self) -> Iterator[Part]:
        """Yield K of the forces, part by part."""
        counts = self.experiment.row_counts(self.weights)
        yield from _weighted(self._force_response(), counts, self.weights)

    def lengths(self) -> Iterator[Part]:
        """Yield K of the lengths; nothing after pointwise kinematics, where K is unknown."""
        if self.length_gain is None or self.motion is None:
            return
        gain, noise = self.length_gain.T, self.experiment.noise.lengths
        channels, motion = self.experiment.recording.lengths, self.motion
        responses = (
            (part, self.machine.lengths(self.experiment, motion, part).columns.times(gain))
            for part in chunks(len(channels.times))
        )
        yield from _weighted(responses, channels.counts, noise)

    def response(
        self, forces: Callable[[slice], Array], lengths: Callable[[slice], Array]
    ) -> Array:
        """Return the change of (p̂, θ̂) per unit of t quantities that are not estimated, (r, t).

        `forces` and `lengths` return the change of the measured forces and lengths per unit,
        (S, 6, t), at a part of the samples.
        """
        total = np.zeros(())
        for parts, columns in ((self.forces(), forces), (self.lengths(), lengths)):
            for part, weights in parts:
                total = total + np.tensordot(weights, columns(part), axes=((0, 1), (0, 1)))
        return np.asarray(total)

    def of(self, rows: Array) -> Influence:
        """Return the influence on linear combinations, (c, ≤ r), of the first unknowns."""
        count, gain = rows.shape[1], self.length_gain
        return replace(
            self,
            force_gain=rows @ self.force_gain[:count],
            length_gain=None if gain is None else rows @ gain[:count],
        )

    def _force_response(self) -> Iterator[Part]:
        """Yield the forces' columns of the unknowns times the gain, (S, 6, r)."""
        experiment, motion, gain = self.experiment, self.motion, self.force_gain.T
        count = int(np.count_nonzero(self.free))
        if motion is None or self.force_gain.shape[1] == count:
            for part in chunks(len(experiment.counts)):
                yield part, experiment.fitted_regressors[part][:, :, self.free] @ gain
            return
        for part in chunks(len(experiment.recording.forces.times)):
            seen = self.machine.forces(experiment, motion, self.values, part)
            yield part, seen.columns(self.free).times(gain)

    def covariance_from_forces(self) -> Covariance:
        """Return the covariance due to the noise of the forces."""
        noise = self.experiment.noise.forces
        loss = self.weights.weighting_loss
        return _sandwich_covariance(self.forces(), noise, self.experiment.effective_counts, loss)

    def covariance_from_lengths(self) -> Covariance | None:
        """Return the covariance due to the noise of the lengths; None where K is unknown."""
        if self.length_gain is None:
            return None
        noise, counts = self.experiment.noise.lengths, self.experiment.recording.lengths.counts
        return _sandwich_covariance(self.lengths(), noise, counts, noise.weighting_loss)


def difference_covariance(first: Sequence[Influence], second: Sequence[Influence]) -> Array:
    """Return the covariance of the difference between two estimates from the same data, (k, k).

    Both use the same experiments in the same order and the same filter. The noise is the one that
    the weights assume: many parameters are tested jointly, and the contrasts at single lines have
    too few degrees of freedom for that.
    """
    total, own_rows = np.zeros(()), np.eye(int(np.count_nonzero(first[0].free)))
    for pair in zip(first, second, strict=True):
        one, other = (each.of(own_rows) for each in pair)
        recording, noise = one.experiment.recording, one.experiment.noise
        for mine, others, own, counts in (
            (one.forces(), other.forces(), noise.forces, one.experiment.effective_counts),
            (one.lengths(), other.lengths(), noise.lengths, recording.lengths.counts),
        ):
            parts = zip(mine, others, strict=True)
            apart = ((part, gain - less) for (part, gain), (_, less) in parts)
            total = total + _sandwich_covariance(apart, own.as_weighted_with(), counts, 1.0).matrix
    return total


def _weighted(columns: Iterator[Part], counts: Array, weights: NoiseEstimate) -> Iterator[Part]:
    """Yield c W U in parts that do not depend on whether a filter is on both sides of W."""
    inverse, noise_filter = np.linalg.inv(weights.covariance), weights.filter
    if noise_filter is None:
        for part, values in columns:
            yield part, np.matmul(inverse, values) * counts[part][:, None, None]
        return
    whole = np.concatenate([values for _, values in columns])
    weighted = noise_filter.adjoint(np.matmul(inverse, noise_filter(whole)))
    for part in chunks(len(whole)):
        yield part, weighted[part] * counts[part][:, None, None]


def _sandwich_covariance(
    parts: Iterator[Part], noise: NoiseEstimate, counts: Array, loss: float
) -> Covariance:
    """Return the covariance of Σ Kᵀ ε̄ under the actual noise and under white noise."""
    lines = noise.lines
    if lines is not None and lines.samples != len(counts):
        lines = None
    if lines is not None and noise.filter is not None and np.isfinite(noise.filter.freedom):
        loss = 1.0  # The weights at a line are estimated without that line.
    size = None if noise.filter is None else noise.filter.size
    white, whole = np.zeros(()), []
    for part, gain in parts:
        weights = gain if size is None else gain * size[part][:, :, None]
        mixed = np.matmul(noise.covariance, weights) / counts[part][:, None, None]
        rows = weights.reshape(-1, weights.shape[2])
        white = white + loss * (rows.T @ mixed.reshape(rows.shape))
        whole.append(weights)
    if lines is None:
        return Covariance(white, 2 * np.diag(white) ** 2 / noise.freedom, white)
    spectral = lines_of(np.concatenate(whole) / np.sqrt(counts)[:, None, None])
    spread, variance = lines.spread(spectral)
    return Covariance(loss * spread, loss**2 * variance, white)


Effects = Mapping[tuple[str, float], Array]
"""Effect of one standard deviation of every entry, by its key."""


def effect_difference(first: Effects, second: Effects, count: int) -> Array:
    """Return the difference between effects of one machine on two estimates, (count, t).

    An entry of both estimates is one number: equal effects cancel.

    Examples
    --------
    >>> one, two = {("gravity_1", 0.1): np.ones(1)}, {("delay", 1e-3): np.full(1, 2.0)}
    >>> effect_difference(one, two, 1).tolist(), effect_difference(one, one, 1).tolist()
    ([[1.0, -2.0]], [[0.0]])
    """
    found = dict(first)
    for key, effect in second.items():
        found[key] = found.get(key, 0.0) - effect
    return np.array(list(found.values())).reshape(-1, count).T


@dataclass(frozen=True, kw_only=True)
class EstimatedDeviation(Deviation):
    """One deviation of the machine from its description."""

    value: Annotated[float, described("see unit", "estimate; zero where it is not estimated")] = 0.0
    std: Annotated[
        float, described("see unit", "its standard deviation; the tolerance where not estimated")
    ]
    scatter: Annotated[
        OpenNumber,
        described(
            "see unit",
            "standard deviation of the estimates of machines within their tolerances; null: not "
            "estimated, or without a tolerance",
        ),
    ] = np.nan

    @classmethod
    def of(cls, deviation: Deviation, value: float = 0.0) -> EstimatedDeviation:
        """Return a deviation with its tolerance as the standard deviation."""
        own = {each.name: getattr(deviation, each.name) for each in fields(Deviation)}
        return cls(**own, value=value, std=deviation.tolerance)


@dataclass(frozen=True, eq=False, kw_only=True)
class SystematicUncertainty:
    """Deviations θ of the machine and their effect on an estimate."""

    estimated: Annotated[bool, described("", "they were estimated together with the parameters")]
    deviations: Annotated[tuple[EstimatedDeviation, ...], described("", "the inexact quantities")]
    response: Annotated[
        Numbers, described("SI", "change of each parameter per unit of each deviation, m × t")
    ]
    """D; zero for fixed parameters."""
    left: Annotated[
        Numbers | None,
        described("SI", "error of each estimated deviation per unit of each deviation, t × t"),
    ] = None
    """Change of θ̂ − θ per unit of every entry: −1 on the diagonal of an entry that was not
    estimated, the prior's remaining weight for an entry that was. An entry that repeats another's
    name (the error of a prior estimate) has a row of zeros. None: not computed."""

    @property
    def scaled_response(self) -> Array:
        """(m, t), D times the tolerances: effect of one standard deviation of every entry.

        Zero for an entry estimated without a prior: its error is noise alone.
        """
        return self.response * self.tolerances

    @property
    def joint_scaled_response(self) -> Array:
        """(m + t, t), effect of one standard deviation of every entry on (p̂ − p, θ̂ − θ)."""
        if self.left is None:
            raise ValueError("the errors of the deviations were not computed (`left`)")
        return np.concatenate([self.response, self.left]) * self.tolerances

    @property
    def effects(self) -> Effects:
        """Effects on p̂ − p."""
        return self.joint_effects(len(self.response))

    def joint_effects(self, count: int) -> Effects:
        """Return the effects on the first `count` of (p̂ − p, θ̂ − θ)."""
        scaled = self.scaled_response
        if count > len(scaled):
            scaled = self.joint_scaled_response[:count]
        return dict(zip((one.key for one in self.deviations), scaled.T, strict=True))

    @property
    def values(self) -> Array:
        """(t,), estimate of θ; zero where it is not estimated."""
        return np.array([each.value for each in self.deviations])

    @property
    def std(self) -> Array:
        """(t,), standard deviation of θ."""
        return np.array([each.std for each in self.deviations])

    @property
    def tolerances(self) -> Array:
        """(t,), standard deviations of the entries before the estimate; zero without a prior."""
        std = np.array([each.tolerance for each in self.deviations])
        return np.where(np.isfinite(std), std, 0.0)

    @property
    def estimates(self) -> dict[str, float]:
        """θ̂ by the names of the entries; empty if they were not estimated."""
        if not self.estimated:
            return {}
        # An entry that repeats a name is the error of a prior estimate.
        return {one.name: one.value for one in reversed(self.deviations)}

    @property
    def with_priors(self) -> bool:
        """Whether an entry with a tolerance was estimated."""
        return self.estimated and any(one.std != one.tolerance < np.inf for one in self.deviations)

    @property
    def groups(self) -> dict[str, Array]:
        """Standard deviations, (m,), SI, due to each group of tolerances; none if all is exact."""
        groups = np.array([each.group for each in self.deviations])
        known = [each.group for each in self.deviations if np.isfinite(each.tolerance)]
        return {
            group: np.linalg.norm(self.scaled_response[:, groups == group], axis=1)
            for group in dict.fromkeys(known)
        }

    @property
    def covariance(self) -> Array:
        """(m, m), D Θ Dᵀ."""
        return self.scaled_response @ self.scaled_response.T


def systematic_share(
    influences: Sequence[Influence],
    chosen: Sequence[EstimatedDeviation],
    *,
    estimated: bool,
) -> SystematicUncertainty | None:
    """Return the effect of the chosen deviations on an estimate.

    None after pointwise kinematics, where the influence of the lengths is unknown. Of the chosen
    deviations, at least one, those `estimated` together with the parameters come first.

    Notes
    -----
    If θ is estimated with its tolerances as priors, D = −(F⁻¹)_pθ Θ⁻¹, the remaining effect of the
    priors. The sum over the samples, 1 − F⁻¹ Θ⁻¹ with the columns of θ, would lose it by
    cancellation if the data determine θ much better than the tolerances.
    """
    free, inverse = influences[0].free, influences[0].inverse
    count = int(np.count_nonzero(free))
    own = len(inverse) - count
    change = np.zeros((len(inverse), len(chosen)))
    precision = np.array([one.tolerance for one in chosen[:own]]) ** -2
    change[:, :own] = np.eye(len(inverse))[:, count:] - inverse[:, count:] * precision
    for influence in influences if len(chosen) > own else ():
        change_of_data = _response(influence, chosen, own)
        if change_of_data is None:
            return None
        change[:, own:] += change_of_data
    response = np.zeros((len(free), len(chosen)))
    response[free], left = change[:count], -np.eye(len(chosen))
    left[:own] += change[count:]
    return SystematicUncertainty(
        estimated=estimated, deviations=tuple(chosen), response=response, left=left
    )


def _response(influence: Influence, chosen: Sequence[EstimatedDeviation], own: int) -> Array | None:
    """Return the change of one experiment's estimate by the deviations from number `own` on.

    None after pointwise kinematics.
    """
    motion, experiment, found = influence.motion, influence.experiment, influence.machine
    if motion is None or influence.length_gain is None:
        return None
    theta = dict(zip((one.name for one in found.chosen), found.theta.tolist(), strict=True))
    at = np.array([theta.get(one.name, 0.0) for one in chosen])
    machine = PerturbedMachine.of(influence.robot, chosen, at)
    experiment, motion, steps = machine.follow_lengths(experiment, motion)
    steps = steps[:, own:]
    jumps = not any(one.group in LAGS_OF_FORCES for one in found.chosen)
    no_parameters = np.zeros_like(influence.free)

    def forces(part: slice) -> Array:
        seen = machine.forces(experiment, motion, influence.values, part, jumps=jumps)
        return seen.columns(no_parameters).times(steps)

    def lengths(part: slice) -> Array:
        return machine.lengths(experiment, motion, part).columns.times(steps)

    return influence.response(forces, lengths)


def add_prior_response(
    systematic: SystematicUncertainty | None,
    influences: Sequence[Influence],
    prior: PriorEstimate,
) -> SystematicUncertainty | None:
    """Add the systematic error of a prior estimate of the same machine.

    The prior enters with the gain F⁻¹ P, (r, m + c): its errors of parameters that are held now
    shift its mean of the others. Entries with equal name and tolerance are the same quantity in
    both estimates.
    """
    if any(each.motion is None or each.length_gain is None for each in influences):
        return systematic
    free = influences[0].free
    count = int(np.count_nonzero(free))
    known = np.concatenate([free, np.ones(len(prior.precision) - len(free), dtype=bool)])
    # In every experiment the forces' gain on the columns of the estimated unknowns is F⁻¹.
    gain = influences[0].force_gain[:, : np.count_nonzero(known)] @ prior.precision[known]
    change = gain @ prior.response
    if systematic is None:
        if not any(one.tolerance > 0 for one in prior.deviations):
            return None
        systematic = SystematicUncertainty(
            estimated=False,
            deviations=(),
            response=np.zeros((len(free), 0)),
            left=np.zeros((0, 0)),
        )
    own, names = systematic.deviations, {one.name for one in systematic.deviations}
    places = {one.key: place for place, one in enumerate(own)}
    others = [one for one in prior.deviations if one.tolerance > 0 and one.key not in places]
    more = len(others)
    response = np.pad(systematic.response, ((0, 0), (0, more)))
    left = np.pad(np.asarray(systematic.left), (0, more))
    for place, one in enumerate(others, start=len(own)):
        places[one.key] = place
        left[place, place] = 0.0 if one.name in names else -1.0
        names.add(one.name)
    for one, column in zip(prior.deviations, change.T, strict=True):
        if one.key in places:
            place = places[one.key]
            response[free, place] += column[:count]
            left[: len(change) - count, place] += column[count:]
    return replace(
        systematic,
        deviations=(*own, *map(EstimatedDeviation.of, others)),
        response=response,
        left=left,
    )
