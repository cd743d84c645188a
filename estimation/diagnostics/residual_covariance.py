"""Covariance of the residuals under a correct model, channel by channel.

With rows scaled to the noise of one sample, e = ε − U g, where g are the errors of parameters and
motion. Cov(g, ε) = X Vᵀ and Cov(g) = C give

    Cov(e_j) = σ_j² 1 − U_j X V_jᵀ − V_j Xᵀ U_jᵀ + U_j C U_jᵀ + variance of unknown friction signs.

LS: V = Σ W A, X = F⁻¹ (parameters only); Gauss–Markov: V = U; maximum likelihood: V = U,
X = C = J⁻¹; held-out data: X = 0.

`empirical_noise` and `with_empirical_colour` replace an assumed noise by that of the recording.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.joint_system import SolvedSystem
from estimation.diagnostics.linearisation import Linearisation, Signature
from estimation.estimators.experiment import Experiment
from estimation.estimators.linear import weighting_covariance
from estimation.estimators.priors import ParameterPriors
from estimation.estimators.result import ParameterEstimate
from estimation.measurement_model.motion import NormalEquations
from estimation.processing import NoiseEstimate, NoiseModel
from estimation.processing.noise import ENOUGH_FREEDOM
from estimation.processing.periodic_recording import Channels


@dataclass(frozen=True, eq=False)
class ResidualCovariance:
    """First-order covariance of the residuals of all channels."""

    noise: NoiseEstimate
    columns: Array
    partner: Array
    """(R, 6, u), U and V, times the square roots of the counts."""
    cross: Array
    covariance: Array
    """(u, u), X and C."""
    extra: Array
    """(R, 6), further variances, times the counts."""

    def weights(self, channel: int) -> Array:
        """Return the eigenvalues of B = Cov(e_j) / σ_j², (R,): variances of independent parts.

        Few rows have an unknown sign of friction; its variance counts as a separate part.
        """
        variance = float(self.noise.covariance[channel, channel])
        factor, kernel = self._low_rank(channel)
        values = np.linalg.eigvals(kernel @ (factor.T @ factor)).real / variance
        result = 1 + self.extra[:, channel] / variance
        result = np.sort(result)[::-1]
        values = values[np.argsort(-np.abs(values))][: len(result)]
        result[len(result) - len(values) :] += values
        return np.maximum(result, 0.0)

    def lagged_covariance(self, channel: int, lag: int) -> float:
        """Return Σ_t Cov(e_t, e_{t + lag}) / σ_j² within the rows of one channel."""
        factor, kernel = self._low_rank(channel)
        variance = float(self.noise.covariance[channel, channel])
        ahead = factor[:-lag] @ kernel
        return float(np.sum(ahead * factor[lag:]) / variance)

    def _low_rank(self, channel: int) -> tuple[Array, Array]:
        """Return Y and K of Cov(e_j) = σ_j² 1 + Y K Yᵀ."""
        own = self.columns[:, channel]
        if not np.any(self.cross):
            return own, self.covariance
        if self.partner is self.columns:
            return own, self.covariance - self.cross - self.cross.T
        factor = np.concatenate([own, self.partner[:, channel]], axis=1)
        kernel = np.block(
            [[self.covariance, -self.cross], [-self.cross.T, np.zeros_like(self.cross)]]
        )
        return factor, kernel


def joint_residual_covariance(
    part: Linearisation, experiment: Experiment, solved: SolvedSystem
) -> ResidualCovariance:
    """Return the covariance of e*, the residuals after the joint fit of (p, ξ) and effects."""
    system = solved.system
    columns = system.force_rows.unscale(system.columns) * np.sqrt(part.counts)[:, None, None]
    return _force_residual_covariance(part, experiment, columns, solved.inverse, solved.inverse)


def held_out_residual_covariance(
    part: Linearisation, experiment: Experiment, estimate: ParameterEstimate
) -> ResidualCovariance:
    """Return the covariance of a prediction's residuals: no unknown was fitted to these forces."""
    covariance = _errors(part, experiment, estimate.covariance)
    columns = part.columns * np.sqrt(part.counts)[:, None, None]
    return _force_residual_covariance(
        part, experiment, columns, np.zeros_like(covariance), covariance
    )


def linear_residual_covariances(
    parts: Sequence[Linearisation],
    white: Sequence[Linearisation],
    experiments: Sequence[Experiment],
    estimate: ParameterEstimate,
    priors: ParameterPriors,
) -> list[ResidualCovariance]:
    """Return the covariances of the residuals of LS or Gauss–Markov, experiment by experiment.

    `white` are the parts after the whitening filters, which LS does not use.
    """
    used = parts if estimate.estimator == "ls" else white
    weightings = [
        weighting_covariance(estimate.estimator, e.noise.forces.covariance) for e in experiments
    ]
    equations = [
        NormalEquations.of([(part.forces, part.columns, part.counts)], weighting)
        for part, weighting in zip(used, weightings, strict=True)
    ]
    k = int(np.count_nonzero(priors.free))
    inverse = priors.inverse(priors.precision + sum(each.matrix[:k, :k] for each in equations))
    covariances = []
    for raw, part, experiment, weighting, own in zip(
        parts, white, experiments, weightings, equations, strict=True
    ):
        # The systematic part is common to all samples: it is no error of the fit to them.
        covariance = _errors(part, experiment, estimate.covariance_random)
        if experiment.fit is not None:
            covariance[:k, k:] = -inverse @ own.matrix[:k, k:] @ experiment.fit.covariance
            covariance[k:, :k] = covariance[:k, k:].T
        cross = np.zeros_like(covariance)
        cross[:k, :k] = inverse
        scale = np.sqrt(part.counts)[:, None, None]
        columns = part.columns * scale
        partner = columns
        if estimate.estimator == "ls":
            partner = np.zeros_like(columns)
            noise = experiment.noise.forces
            weighted = np.matmul(np.linalg.inv(weighting), raw.regressors[:, :, raw.free])
            if noise.filter is not None:
                weighted = noise.filter.invert(weighted)  # H C H = Σ: H C W A = Σ H⁻¹ W A
            partner[:, :, :k] = np.matmul(noise.covariance, weighted) * scale
        covariances.append(
            _force_residual_covariance(part, experiment, columns, cross, covariance, partner)
        )
    return covariances


def length_residual_covariance(
    part: Linearisation, experiment: Experiment, motion_covariance: Array
) -> ResidualCovariance:
    """Return the covariance of the length residuals; `motion_covariance` is Cov(ξ̂), (x, x)."""
    columns = part.length_columns * np.sqrt(part.length_counts)[:, None, None]
    extra = np.zeros(columns.shape[:2])
    return ResidualCovariance(
        experiment.noise.lengths, columns, columns, motion_covariance, motion_covariance, extra
    )


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

    The residuals are (R', 6), m. None if the effects do not change any length, unless `force`.

    Parameters
    ----------
    solved : SolvedSystem
        Includes all effects; first those with tolerances, of prior precisions `tolerated`, 1/std²,
        (t,).
    found : Signature
        The effects found, which follow them.
    """
    first = int(np.count_nonzero(part.free))
    motion = first + part.length_columns.shape[2]
    if not force and not np.any(solved.system.length_columns[:, :, motion:]):
        return None
    known = np.concatenate([np.zeros(motion - first), tolerated, np.zeros(found.count)])
    alone = solved.system.restrict_to_lengths(first, known).solution
    system, scale = alone.system, np.sqrt(part.length_counts)[:, None, None]
    columns = system.force_rows.unscale(system.columns) * scale
    noise, extra = experiment.noise.lengths, np.zeros(columns.shape[:2])
    covariance = ResidualCovariance(noise, columns, columns, alone.inverse, alone.inverse, extra)
    return alone.force_residuals(), covariance


def _force_residual_covariance(
    part: Linearisation,
    experiment: Experiment,
    columns: Array,
    cross: Array,
    covariance: Array,
    partner: Array | None = None,
) -> ResidualCovariance:
    partner = columns if partner is None else partner
    extra = part.sign_variance * part.counts[:, None]
    return ResidualCovariance(experiment.noise.forces, columns, partner, cross, covariance, extra)


def _errors(part: Linearisation, experiment: Experiment, own: Array) -> Array:
    """Return Cov(p̂, ξ̂) under independence, (k + x, k + x); `own` is Cov(p̂), (m, m)."""
    k = int(np.count_nonzero(part.free))
    size = k + part.motion_columns.shape[2]
    covariance = np.zeros((size, size))
    covariance[:k, :k] = own[np.ix_(part.free, part.free)]
    if experiment.fit is not None:
        covariance[k:, k:] = experiment.fit.covariance
    return covariance


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
        found = repeated if experiment.pointwise is not None else channels.empirical_noise
        return given if found is None else found

    return _choose_noise(experiment, empirical)


def _choose_noise(
    experiment: Experiment, choose: Callable[[NoiseEstimate, Channels], NoiseEstimate]
) -> NoiseModel:
    """Choose the noise of forces and lengths; the experiment's own object if both stay."""
    noise, recording = experiment.noise, experiment.recording
    forces, lengths = (
        choose(noise.forces, recording.forces),
        choose(noise.lengths, recording.lengths),
    )
    if forces is noise.forces and lengths is noise.lengths:
        return noise
    return NoiseModel(forces, lengths)
