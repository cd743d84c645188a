"""Covariance of the residuals under a correct model, channel by channel.

With rows scaled to the noise of one sample, e = ε − U g, where g are the errors of the unknowns:
parameters, motion, signs of friction, deviations within their tolerances. The joint fit of all of
them leaves residuals that do not depend on the estimator,

    Cov(e_j) = σ_j² 1 − U_j J⁻¹ U_jᵀ,

and a prediction of held-out data those with Cov(e_j) = σ_j² 1 + U_j Cov(g) U_jᵀ.

`empirical_noise` and `with_empirical_colour` replace an assumed noise by that of the recording.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg as sla
from scipy import sparse

from constraints.arrays import Array
from estimation.diagnostics.joint_system import SolvedSystem
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.diagnostics.whitened_rows import SignRoots, columns_of_signs, overlapping_signs
from estimation.estimators.experiment import Experiment
from estimation.estimators.result import ParameterEstimate
from estimation.processing import NoiseEstimate, NoiseModel
from estimation.processing.noise import ENOUGH_FREEDOM
from estimation.processing.periodic_recording import Channels
from expdesign.mechanism.hexapod import ACTUATORS


@dataclass(frozen=True, eq=False)
class ResidualCovariance:
    """First-order covariance of the residuals of all channels."""

    noise: NoiseEstimate
    spread: Array
    """(6, R, r), U times a root of Cov(g): what independent errors of variance 1 add to the rows of
    each channel."""
    fitted: bool
    """Whether the unknowns were fitted to these residuals: that reduces their variance."""
    signs: SignRoots = field(default_factory=SignRoots)
    """The same of unknown signs of friction."""

    @classmethod
    def of(
        cls,
        noise: NoiseEstimate,
        columns: Array,
        root: Array,
        *,
        fitted: bool,
        signs: SignRoots | None = None,
    ) -> ResidualCovariance:
        """Return the covariance with unknowns of covariance root rootᵀ, (u, r).

        `columns`, (R, 6, u), are U times the square roots of the counts.
        """
        spread = np.matmul(columns.transpose(1, 0, 2), root)
        return cls(noise, spread, fitted, signs or SignRoots())

    @property
    def _sign(self) -> float:
        return -1.0 if self.fitted else 1.0

    @property
    def _factors(self) -> list[Array]:
        """(6, T, r) each, over neighbouring samples."""
        return [self.spread, *(own for _, own in self.signs.blocks)]

    def weights(self, channel: int) -> Array:
        """Return the eigenvalues of B = Cov(e_j) / σ_j², (R,): variances of independent parts."""
        size = self.spread.shape[1]
        columns = sum(own.shape[2] for own in self._factors)
        if columns < size:
            whole, first = np.zeros((size, columns)), 0
            for times, own in ((slice(size), self.spread), *self.signs.blocks):
                whole[times, first : first + own.shape[2]] = own[channel]
                first += own.shape[2]
            gram = whole.T @ whole
        else:
            gram = self.spread[channel] @ self.spread[channel].T
            for times, own in self.signs.blocks:
                gram[times, times] += own[channel] @ own[channel].T
        variance = float(self.noise.covariance[channel, channel])
        added = self._sign * np.linalg.eigvalsh(gram) / variance
        return np.maximum(1.0 + np.pad(added, (0, size - len(added))), 0.0)

    def lagged_covariance(self, channel: int, lag: int) -> float:
        """Return Σ_t Cov(e_t, e_{t + lag}) / σ_j² of one channel, without the noise itself."""
        product = sum(
            np.vdot(own[channel, : max(own.shape[1] - lag, 0)], own[channel, lag:])
            for own in self._factors
        )
        return float(self._sign * product / self.noise.covariance[channel, channel])

    def expected_sum(self, inverse: Array) -> float:
        """Return E Σ eᵀ Σ⁻¹ e, given Σ⁻¹ of the noise, (6, 6): 6 R less the fitted freedom."""
        flat = self.spread.reshape(ACTUATORS, -1)
        added = float(np.sum(inverse * (flat @ flat.T + self.signs.total)))
        return ACTUATORS * self.spread.shape[1] + self._sign * added


def joint_residual_covariance(noise: NoiseEstimate, solved: SolvedSystem) -> ResidualCovariance:
    """Return the covariance of e*, the residuals after the joint fit of all unknowns.

    `noise` is that of one sample.
    """
    system, signs = solved.system, solved.system.signs
    spread = system.force_rows.of_one_sample(solved.force_roots).transpose(1, 0, 2)
    own = SignRoots() if signs is None else signs.of_one_sample
    return ResidualCovariance(noise, np.ascontiguousarray(spread), fitted=True, signs=own)


def held_out_residual_covariance(
    part: Linearisation, experiment: Experiment, estimate: ParameterEstimate
) -> ResidualCovariance:
    """Return the covariance of a prediction's residuals: no unknown was fitted to these forces."""
    own = estimate.covariance[np.ix_(part.free, part.free)]
    fit = experiment.fit
    motion = np.zeros((0, 0)) if fit is None else np.asarray(fit.covariance)
    root = sla.block_diag(root_of_covariance(own), root_of_covariance(motion))
    scale, noise = np.sqrt(part.counts), experiment.noise.forces
    errors = sparse.diags_array(np.repeat(scale, ACTUATORS)) @ part.filter_signs(noise.filter)
    blocks = overlapping_signs(errors)
    signs = SignRoots.of((times, columns_of_signs(errors, times, own)) for times, own in blocks)
    columns = part.columns * scale[:, None, None]
    return ResidualCovariance.of(noise, columns, root, fitted=False, signs=signs)


def root_of_covariance(covariance: Array) -> Array:
    """Return R, (u, r), with R Rᵀ a covariance, (u, u), that may be singular."""
    std = np.sqrt(np.diag(covariance))
    scale = np.where(std > 0, std, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.multiply.outer(scale, scale))
    return np.asarray(std[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


def refit_lengths(
    part: Linearisation,
    experiment: Experiment,
    solved: SolvedSystem,
    tolerated: Array,
    found: Signature,
    *,
    force: bool = False,
) -> tuple[Array, ResidualCovariance] | None:
    """Refit the motion to the lengths alone, given effects; return residuals and covariance.

    The residuals are (R', 6), m. None if the effects do not change any length, unless `force`. The
    solved system includes all effects: those with tolerances, of prior precisions `tolerated`,
    1/std², (t,), then those that were found.
    """
    first = int(np.count_nonzero(part.free))
    motion = first + part.length_columns.shape[2]
    if not force and not np.any(solved.system.split(solved.system.columns)[1][:, :, motion:]):
        return None
    known = np.concatenate([np.zeros(motion - first), tolerated, np.zeros(found.count)])
    alone = solved.system.restrict_to_lengths(first, known).solution
    own = joint_residual_covariance(experiment.noise.lengths, alone)
    return alone.force_residuals(), own


def with_empirical_colour(experiment: Experiment) -> Experiment:
    """Return an experiment with the colour of its noise, even if it was weighted as white.

    Coloured noise that was assumed white must not appear as an error of the model.
    """

    def coloured(weighted: NoiseEstimate, channels: Channels) -> NoiseEstimate:
        found = channels.empirical_noise
        known = weighted.source == "estimated" and weighted.lines is not None
        if not known or weighted.filter is not None or found is None or found.filter is None:
            return weighted
        return found

    noise = _choose_noise(experiment, coloured)
    return experiment if noise is experiment.noise else replace(experiment, noise=noise)


def empirical_noise(experiment: Experiment) -> NoiseModel:
    """Return the noise estimated from a recording if it has enough periods; else the given one."""

    def empirical(given: NoiseEstimate, channels: Channels) -> NoiseEstimate:
        repeated = channels.scatter
        if given.source != "given" or repeated is None or repeated.freedom < ENOUGH_FREEDOM:
            return given
        if repeated.is_singular:
            return given
        found = repeated if experiment.pointwise is not None else channels.empirical_noise
        return given if found is None else found

    return _choose_noise(experiment, empirical)


def _choose_noise(
    experiment: Experiment, choose: Callable[[NoiseEstimate, Channels], NoiseEstimate]
) -> NoiseModel:
    """Choose the noise of forces and lengths; the experiment's own object if both stay."""
    noise, recording = experiment.noise, experiment.recording
    forces = choose(noise.forces, recording.forces)
    lengths = choose(noise.lengths, recording.lengths)
    if forces is noise.forces and lengths is noise.lengths:
        return noise
    return NoiseModel(forces, lengths)
