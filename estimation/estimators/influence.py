"""How noise moves an estimate: p̂ − p = Σ_n K_fᵀ ε_f + Σ_n K_lᵀ ε_l, experiment by experiment.

Every estimator here is linear in small errors of the mean forces and lengths, whatever it weights
with. From the same K follow the covariance under any noise, white or not (a sandwich: the weights
may be wrong), that of the difference between two estimators of the same data, and the effect of
anything that the model does not know (`Influence.response`).

How what is not known exactly moves an estimate: the systematic share of its covariance.

A machine that deviates by θ from its description moves the estimate by D θ. Over all experiments
D = Σ K_fᵀ Z_f + K_lᵀ Z_l, with the estimator's own K (`estimation.estimators.influence`). By the
tolerances θ has the covariance Θ, and D Θ Dᵀ is what they make (GUM, type B). θ is one and the
same in all recordings of the machine: D is summed before it is squared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.estimators.experiment import Experiment
from estimation.estimators.joint_equations import MeasuredForces, MeasuredLengths, PerturbedMachine
from estimation.estimators.prior_estimate import PriorEstimate
from estimation.kinematics.pointwise import signs_along
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.normal_equations import Filter
from estimation.measurement_model.prediction import chunks, force_columns, length_columns
from estimation.processing.noise import NoiseEstimate
from expdesign.noise.fourier_lines import lines_of
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation

Part = tuple[slice, Array]
"""Samples, and K at these samples, (S, 6, k): units of the parameters per N or m."""


@dataclass(frozen=True, eq=False)
class Covariance:
    """A covariance of estimates, and how well it is known itself."""

    matrix: Array
    """(k, k)."""
    variance: Array
    """(k,), of its diagonal: zero where the noise is taken as known."""
    white: Array
    """(k, k), the same for white noise with the same covariance of one sample."""

    def __add__(self, other: Covariance) -> Covariance:
        """Add the covariance that independent noise makes."""
        return Covariance(
            self.matrix + other.matrix, self.variance + other.variance, self.white + other.white
        )

    @classmethod
    def known(cls, matrix: Array) -> Covariance:
        """Take one that is not estimated."""
        return cls(matrix, np.zeros(len(matrix)), matrix)


@dataclass(frozen=True, eq=False)
class Influence:
    """What the errors of one experiment do to an estimate.

    Rows of the gains are the k free parameters, and behind them the e entries of θ that were
    estimated with them: r = k + e.
    """

    robot: Robot
    experiment: Experiment
    motion: HarmonicMotion | None
    """Along which the estimator took its regressors; None: the pointwise one."""
    values: Array
    """(m,), the estimate."""
    free: NDArray[np.bool_]
    weighting: Array
    """(6, 6), whose inverse the estimator weighted the forces with."""
    weighted_by_noise: bool
    """That is the noise's covariance: its filter was used, too, and its errors count."""
    force_gain: Array
    """(r, k), on the columns of the parameters; (r, k + x) with those of the motion."""
    length_gain: Array | None
    """(r, x), on the motion's columns in the lengths; None after pointwise kinematics."""
    machine: PerturbedMachine | None = None
    """Whose deviations θ were estimated, too: their columns stand before those of the motion in
    both gains."""

    def forces(self) -> Iterator[Part]:
        """Yield K of the forces, part by part; all at once behind a filter."""
        noise = self.experiment.noise.forces
        noise_filter = noise.filter if self.weighted_by_noise else None
        yield from _weighted(
            self._moved_forces(), self.experiment.counts, self.weighting, noise_filter
        )

    def lengths(self) -> Iterator[Part]:
        """Yield K of the lengths; nothing after pointwise kinematics, where it is not known."""
        if self.length_gain is None or self.motion is None:
            return
        gain, noise = self.length_gain.T, self.experiment.noise.lengths
        channels, motion = self.experiment.record.lengths, self.motion
        moved = (
            (part, self._moved_lengths(motion, part, gain)) for part in chunks(len(channels.times))
        )
        yield from _weighted(moved, channels.counts, noise.covariance, noise.filter)

    def response(
        self, forces: Callable[[slice], Array], lengths: Callable[[slice], Array]
    ) -> Array:
        """Return what (p̂, θ̂) moves by per unit of t unknowns that it does not know, (r, t).

        Both give the change of the measured forces or lengths per unit, (S, 6, t), at a part of the
        samples.
        """
        total = np.zeros(())
        for parts, columns in ((self.forces(), forces), (self.lengths(), lengths)):
            for part, weights in parts:
                total = total + np.einsum("sik,sit->kt", weights, columns(part))
        return np.asarray(total)

    def of(self, rows: Array) -> Influence:
        """Return the influence on combinations of the first ones, (c, ≤ r), alone."""
        count, gain = rows.shape[1], self.length_gain
        return replace(
            self,
            force_gain=rows @ self.force_gain[:count],
            length_gain=None if gain is None else rows @ gain[:count],
        )

    def _moved_lengths(self, motion: HarmonicMotion, part: slice, gain: Array) -> Array:
        """Return the columns of the unknowns in the lengths times the gain, (x, r)."""
        if self.machine is not None:
            lengths = self.machine.lengths(self.experiment, motion, part)
            return np.concatenate([lengths.deviations, lengths.slope], axis=2) @ gain
        times = self.experiment.record.lengths.times[part]
        return length_columns(self.robot, motion.at(times))[1].times(gain)

    def _moved_forces(self) -> Iterator[Part]:
        """Yield the columns of the unknowns in the forces times the gain."""
        experiment, motion, gain = self.experiment, self.motion, self.force_gain.T
        count = int(np.count_nonzero(self.free))
        if motion is None or self.force_gain.shape[1] == count:
            for part in chunks(len(experiment.counts)):
                yield part, experiment.fitted_regressors[part][:, :, self.free] @ gain
            return
        times, spread = experiment.record.forces.times, experiment.spread_along(motion)
        for part in chunks(len(times)):
            if self.machine is not None:
                seen = self.machine.forces(experiment, motion, self.values, part)
                of_both = (seen.regressors[:, :, self.free], seen.deviations, seen.slope)
                yield part, np.concatenate(of_both, axis=2) @ gain
                continue
            sampled = motion.at(times[part])
            signs = signs_along(self.robot, sampled, spread[part])
            _, columns = force_columns(self.robot, sampled, signs, self.values, self.free)
            yield part, columns.times(gain)

    def force_share(self) -> Covariance:
        """Return the covariance that the noise of the forces makes."""
        noise = self.experiment.noise.forces
        loss = noise.weighting_loss if self.weighted_by_noise else 1.0
        return _covariance(self.forces(), noise, self.experiment.counts, loss)

    def length_share(self) -> Covariance | None:
        """Return the covariance that the noise of the lengths makes; None where not known."""
        if self.length_gain is None:
            return None
        noise, counts = self.experiment.noise.lengths, self.experiment.record.lengths.counts
        return _covariance(self.lengths(), noise, counts, noise.weighting_loss)


def difference_covariance(first: Sequence[Influence], second: Sequence[Influence]) -> Array:
    """Return the covariance of the difference between two estimates from the same data, (k, k).

    Of the same experiments in the same order, with the same weights' filter. The noise is what the
    weights take it for: many parameters are judged together, for which the contrasts of single
    lines have too little freedom.
    """
    total, own_rows = np.zeros(()), np.eye(int(np.count_nonzero(first[0].free)))
    for pair in zip(first, second, strict=True):
        one, other = (each.of(own_rows) for each in pair)
        record, noise = one.experiment.record, one.experiment.noise
        for parts, own, counts in (
            (zip(one.forces(), other.forces(), strict=True), noise.forces, record.forces.counts),
            (
                zip(one.lengths(), other.lengths(), strict=True),
                noise.lengths,
                record.lengths.counts,
            ),
        ):
            apart = ((part, mine - others) for (part, mine), (_, others) in parts)
            total = total + _covariance(apart, own.as_weighted_with(), counts, 1.0).matrix
    return total


def _weighted(
    columns: Iterator[Part], counts: Array, covariance: Array, noise_filter: Filter | None
) -> Iterator[Part]:
    """Yield c W U: with the filter on both sides of W, all samples at once."""
    inverse = np.linalg.inv(covariance)
    if noise_filter is None:
        for part, values in columns:
            yield part, np.matmul(inverse, values) * counts[part][:, None, None]
        return
    whole = np.concatenate([values for _, values in columns])
    weighted = noise_filter(np.matmul(inverse, noise_filter(whole)))
    yield slice(None), weighted * counts[:, None, None]


def _covariance(
    parts: Iterator[Part], noise: NoiseEstimate, counts: Array, loss: float
) -> Covariance:
    """Return the covariance of Σ Kᵀ ε̄ for the noise as it is, and for white noise."""
    lines = noise.lines
    if lines is not None and lines.samples != len(counts):
        lines = None
    if lines is not None and noise.filter is not None:
        loss = 1.0  # Its weights know nothing of the very line that they are for.
    white, whole = np.zeros(()), []
    for part, weights in parts:
        mixed = np.matmul(noise.covariance, weights) / counts[part][:, None, None]
        rows = weights.reshape(-1, weights.shape[2])
        white = white + loss * (rows.T @ mixed.reshape(rows.shape))
        whole.append(weights)
    if lines is None:
        return Covariance(white, 2 * np.diag(white) ** 2 / noise.freedom, white)
    spectral = lines_of(np.concatenate(whole) / np.sqrt(counts)[:, None, None])
    spread, shares = lines.spread(spectral)
    return Covariance(loss * spread, loss**2 * lines.variance_of(shares), white)


@dataclass(frozen=True, eq=False)
class SystematicUncertainty:
    """What the deviations θ of a machine do to an estimate, and what is known of them."""

    deviations: tuple[Deviation, ...]
    response: Array
    """(m, t), D: what p̂ moves by per unit of every entry; zero for fixed parameters."""
    values: Array
    """(t,), estimate of θ; zero where it is not estimated."""
    std: Array
    """(t,), its standard deviation: the tolerance where it is not estimated."""
    estimated: bool = False
    """θ was estimated together with the parameters."""
    left: Array | None = None
    """(t, t), what θ̂ − θ moves by per unit of every entry: −1 on the diagonal of one that was not
    estimated, and what the data leave to the prior of one that was. No row of its own has an entry
    that repeats another's name: the error of an earlier prior. None: it was not computed."""

    @property
    def scaled(self) -> Array:
        """(m, t), D times the tolerances: what one standard deviation of every entry does.

        Zero of an entry that was estimated without a prior: nothing of it is left but noise.
        """
        return self.response * self._tolerances

    @property
    def joint_scaled(self) -> Array:
        """(m + t, t), the same of (p̂ − p, θ̂ − θ)."""
        if self.left is None:
            raise ValueError("the errors of the deviations were not computed (`left`)")
        return np.concatenate([self.response, self.left]) * self._tolerances

    @property
    def _tolerances(self) -> Array:
        std = np.array([each.std for each in self.deviations])
        return np.where(np.isfinite(std), std, 0.0)

    @property
    def with_priors(self) -> bool:
        """Whether something that has a tolerance was estimated."""
        known = [
            std != one.std < np.inf for one, std in zip(self.deviations, self.std, strict=True)
        ]
        return self.estimated and any(known)

    @property
    def inexact(self) -> bool:
        """Whether anything has a tolerance."""
        return any(np.isfinite(one.std) for one in self.deviations)

    @property
    def covariance(self) -> Array:
        """(m, m), D Θ Dᵀ."""
        return self.scaled @ self.scaled.T


def systematic_share(
    influences: Sequence[Influence],
    chosen: Sequence[Deviation],
    free: NDArray[np.bool_],
    values: Array | None = None,
) -> SystematicUncertainty | None:
    """Return what the entries chosen do to an estimate.

    None after pointwise kinematics, where it is not known how lengths move the estimate.

    Parameters
    ----------
    influences : sequence of Influence
        Of every experiment of the estimate.
    chosen : sequence of Deviation
        At least one; all that were estimated together with the parameters are the first of them.
    free : (m,) of bool
        Parameters that were estimated.
    values : (t,), optional
        Estimate of θ, where it was estimated.

    Notes
    -----
    Where θ is estimated with its tolerances as priors, D = −(F⁻¹)_pθ Θ⁻¹: what the data leave to
    the prior. It follows from the same sum, as K then holds the columns of θ.
    """
    count = int(np.count_nonzero(free))
    moved = np.zeros((len(influences[0].force_gain), len(chosen)))
    for influence in influences:
        motion = influence.motion
        if motion is None or influence.length_gain is None:
            return None
        found = influence.machine or PerturbedMachine.exact(influence.robot)
        theta = dict(zip((one.name for one in found.chosen), found.theta.tolist(), strict=True))
        at = np.array([theta.get(one.name, 0.0) for one in chosen])
        machine = PerturbedMachine.of(influence.robot, chosen, at)
        known, jumps = (influence.experiment, motion), "delay" not in theta
        moved += influence.response(
            _moved(partial(machine.forces, *known, influence.values, jumps=jumps)),
            _moved(partial(machine.lengths, *known)),
        )
    response = np.zeros((len(free), len(chosen)))
    response[free], left = moved[:count], -np.eye(len(chosen))
    left[: len(moved) - count] += moved[count:]
    return SystematicUncertainty(
        tuple(chosen),
        response,
        np.zeros(len(chosen)) if values is None else values,
        np.array([each.std for each in chosen]),
        estimated=values is not None,
        left=left,
    )


def add_prior_response(
    systematic: SystematicUncertainty | None,
    influences: Sequence[Influence],
    earlier: PriorEstimate,
    free: NDArray[np.bool_],
) -> SystematicUncertainty | None:
    """Return what tolerances do to an estimate whose prior is an earlier one of the machine.

    The prior enters with the gain F⁻¹ P, (r, m + c): its errors of parameters that are held now
    move what it says of the others. An entry with the same tolerance is the same number in both.
    """
    if any(each.motion is None or each.length_gain is None for each in influences):
        return systematic
    count = int(np.count_nonzero(free))
    known = np.concatenate([free, np.ones(len(earlier.precision) - len(free), dtype=bool)])
    # The forces' gain on the columns of what is estimated is F⁻¹, in every experiment.
    gain = influences[0].force_gain[:, : np.count_nonzero(known)] @ earlier.precision[known]
    moved = gain @ earlier.response
    if systematic is None:
        if not any(one.std > 0 for one in earlier.deviations):
            return None
        nothing = np.zeros(0)
        systematic = SystematicUncertainty(
            (), np.zeros((len(free), 0)), nothing, nothing, left=np.zeros((0, 0))
        )
    own, names = systematic.deviations, {one.name for one in systematic.deviations}
    places = {(one.name, one.std): place for place, one in enumerate(own)}
    others = [
        one for one in earlier.deviations if one.std > 0 and (one.name, one.std) not in places
    ]
    more = len(others)
    response = np.pad(systematic.response, ((0, 0), (0, more)))
    left = np.pad(np.asarray(systematic.left), (0, more))
    for place, one in enumerate(others, start=len(own)):
        places[one.name, one.std] = place
        left[place, place] = 0.0 if one.name in names else -1.0
        names.add(one.name)
    for one, column in zip(earlier.deviations, moved.T, strict=True):
        if (one.name, one.std) in places:
            place = places[one.name, one.std]
            response[free, place] += column[:count]
            left[: len(moved) - count, place] += column[count:]
    return replace(
        systematic,
        deviations=(*own, *others),
        response=response,
        left=left,
        values=np.concatenate([systematic.values, np.zeros(more)]),
        std=np.concatenate([systematic.std, [one.std for one in others]]),
    )


def _moved(
    measured: Callable[[slice], MeasuredForces | MeasuredLengths],
) -> Callable[[slice], Array]:
    """Return what gives the columns of θ at some of the samples."""
    return lambda part: measured(part).deviations
