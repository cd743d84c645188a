"""How noise moves an estimate: p̂ − p = Σ_n K_fᵀ ε_f + Σ_n K_lᵀ ε_l, experiment by experiment.

Every estimator here is linear in small errors of the mean forces and lengths, whatever it weights
with. From the same K follow the covariance under any noise, white or not (a sandwich: the weights
may be wrong), that of the difference between two estimators of the same data, and the effect of
anything that the model does not know (`Influence.response`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.estimators.deviating import DeviatingMachine
from estimation.estimators.experiment import Experiment
from estimation.kinematics.friction_signs import signs_along
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.normal_equations import Filter
from estimation.measurement_model.prediction import chunks, force_columns, length_columns
from estimation.processing.noise import NoiseEstimate
from expdesign.noise.fourier_lines import lines_of
from expdesign.robot import Robot

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
    machine: DeviatingMachine | None = None
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
