"""How the errors of each estimator enter its residuals."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.joint_system import SolvedSystem
from estimation.diagnostics.linearisation import Linearisation
from estimation.diagnostics.residual_law import ResidualLaw
from estimation.estimators.experiment import Experiment
from estimation.estimators.knowledge import Knowledge
from estimation.estimators.linear import equal_weights, full_weights
from estimation.estimators.result import ParameterEstimate


def joint_law(part: Linearisation, experiment: Experiment, solved: SolvedSystem) -> ResidualLaw:
    """Return the law of e*, the residuals after the joint fit of (p, ξ) and effects."""
    system = solved.system
    unwhitened = np.asarray(np.linalg.solve(system.white, system.columns), dtype=np.float64)
    return ResidualLaw(
        noise=experiment.noise.force_covariance,
        columns=unwhitened,
        partner=unwhitened,
        cross=solved.inverse,
        covariance=solved.inverse,
        extra=part.sign_variance * part.counts[:, None],
    )


def held_out_law(
    part: Linearisation, experiment: Experiment, estimate: ParameterEstimate
) -> ResidualLaw:
    """Return the law of a prediction's residuals: nothing was fitted to these forces."""
    covariance = _errors(part, experiment, estimate)
    columns = part.columns * np.sqrt(part.counts)[:, None, None]
    return ResidualLaw(
        noise=experiment.noise.force_covariance,
        columns=columns,
        partner=columns,
        cross=np.zeros_like(covariance),
        covariance=covariance,
        extra=part.sign_variance * part.counts[:, None],
    )


def linear_laws(
    parts: Sequence[Linearisation],
    experiments: Sequence[Experiment],
    estimate: ParameterEstimate,
    knowledge: Knowledge,
) -> list[ResidualLaw]:
    """Return the laws of the residuals of LS or Gauss–Markov, experiment by experiment."""
    weighting = equal_weights if estimate.estimator == "ls" else full_weights
    weights = [weighting(e.noise.force_covariance) for e in experiments]
    information = knowledge.precision
    for part, weight in zip(parts, weights, strict=True):
        columns = part.regressors[:, :, knowledge.free]
        counted = columns * part.counts[:, None, None]
        flat = np.matmul(weight, counted).reshape(-1, columns.shape[2])
        information = information + flat.T @ columns.reshape(flat.shape)
    inverse = knowledge.inverse(information)
    laws = []
    for part, experiment, weight in zip(parts, experiments, weights, strict=True):
        noise = experiment.noise.force_covariance
        covariance = _errors(part, experiment, estimate)
        k = len(inverse)
        free = part.regressors[:, :, part.free]
        if part.motion_columns.shape[2] and experiment.fit is not None:
            counted = np.matmul(weight, free) * part.counts[:, None, None]
            mixed = counted.reshape(-1, k).T @ part.motion_columns.reshape(counted.shape[0] * 6, -1)
            covariance[:k, k:] = -inverse @ mixed @ experiment.fit.covariance
            covariance[k:, :k] = covariance[:k, k:].T
        cross = np.zeros_like(covariance)
        cross[:k, :k] = inverse
        scale = np.sqrt(part.counts)[:, None, None]
        columns = part.columns * scale
        partner = np.zeros_like(columns)
        partner[:, :, :k] = np.matmul(noise @ weight, free) * scale
        laws.append(
            ResidualLaw(
                noise=noise,
                columns=columns,
                partner=columns if estimate.estimator != "ls" else partner,
                cross=cross,
                covariance=covariance,
                extra=part.sign_variance * part.counts[:, None],
            )
        )
    return laws


def length_law(
    part: Linearisation, experiment: Experiment, motion_covariance: Array
) -> ResidualLaw:
    """Return the law of the length residuals; `motion_covariance` is Cov(ξ̂), (x, x)."""
    columns = part.length_columns * np.sqrt(part.length_counts)[:, None, None]
    return ResidualLaw(
        noise=experiment.noise.length_covariance,
        columns=columns,
        partner=columns,
        cross=motion_covariance,
        covariance=motion_covariance,
        extra=np.zeros((len(part.length_counts), columns.shape[1])),
    )


def _errors(part: Linearisation, experiment: Experiment, estimate: ParameterEstimate) -> Array:
    """Return Cov(p̂, ξ̂) as if they were independent, (k + x, k + x)."""
    k = int(np.count_nonzero(part.free))
    size = k + part.motion_columns.shape[2]
    covariance = np.zeros((size, size))
    covariance[:k, :k] = estimate.covariance[np.ix_(part.free, part.free)]
    if experiment.fit is not None:
        covariance[k:, k:] = experiment.fit.covariance
    return covariance
