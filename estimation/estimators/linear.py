"""Least squares and Gauss–Markov (7): linear in the parameters, the motion taken as measured.

Both minimise Σ c (q − A p)ᵀ W (q − A p) plus the prior's part; LS with W = I (in units of the mean
variance, so that priors have their weight), GM with W = Σ⁻¹. Their covariance counts the full Σ
either way, and the noise of the lengths through B = −∂p̂/∂ξ.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np

from constraints.arrays import Array
from estimation.estimators.experiment import Experiment
from estimation.estimators.knowledge import Knowledge
from estimation.estimators.result import ParameterEstimate
from estimation.kinematics.fourier_fit import CHUNK
from estimation.measurement_model import predict_forces
from expdesign.robot import Robot

Weighting = Callable[[Array], Array]
"""Σ (6, 6) → W (6, 6)."""


def equal_weights(covariance: Array) -> Array:
    """Return W of least squares: the same for all actuators, one over their mean variance."""
    return np.eye(len(covariance)) * len(covariance) / np.trace(covariance)


def full_weights(covariance: Array) -> Array:
    """Return W of Gauss–Markov: Σ⁻¹."""
    return np.asarray(np.linalg.inv(covariance), dtype=np.float64)


def least_squares(
    robot: Robot, experiments: Sequence[Experiment], knowledge: Knowledge
) -> ParameterEstimate:
    """Estimate the parameters with equal weights."""
    return linear_estimate(robot, experiments, knowledge, equal_weights, "ls")


def gauss_markov(
    robot: Robot, experiments: Sequence[Experiment], knowledge: Knowledge
) -> ParameterEstimate:
    """Estimate the parameters with the full Σ, equation (7)."""
    return linear_estimate(robot, experiments, knowledge, full_weights, "gm")


def linear_estimate(
    robot: Robot,
    experiments: Sequence[Experiment],
    knowledge: Knowledge,
    weighting: Weighting,
    name: str,
) -> ParameterEstimate:
    """Solve the weighted linear problem over all experiments.

    Raises
    ------
    UnidentifiableError
        The data (and priors) do not determine every free parameter.
    """
    began = time.perf_counter()
    free = knowledge.free
    start = knowledge.start
    information = knowledge.precision
    gradient = knowledge.precision @ (knowledge.prior_mean - start)[free]
    spread = knowledge.precision
    for experiment in experiments:
        weights = weighting(experiment.noise.force_covariance)
        regressors = experiment.regressors(robot)
        mixed = weights @ experiment.noise.force_covariance @ weights
        for first in range(0, len(regressors), CHUNK):
            part = slice(first, first + CHUNK)
            rest = experiment.forces[part] - regressors[part] @ start
            own = regressors[part][:, :, free]
            columns = own * experiment.counts[part][:, None, None]
            weighted = np.matmul(weights, columns).reshape(-1, columns.shape[2])
            flat = own.reshape(-1, columns.shape[2])
            information = information + flat.T @ weighted
            gradient = gradient + weighted.T @ rest.ravel()
            spread = spread + flat.T @ np.matmul(mixed, columns).reshape(-1, columns.shape[2])
    values = start.copy()
    values[free] += knowledge.best_step(information, gradient, start)
    inverse = knowledge.inverse(information)
    force_share = inverse @ spread @ inverse
    kinematic_share = _kinematic_share(robot, experiments, knowledge, weighting, values, inverse)
    total = force_share if kinematic_share is None else force_share + kinematic_share
    return ParameterEstimate(
        estimator=name,
        values=values,
        covariance=knowledge.full(total),
        force_share=knowledge.full(force_share),
        kinematic_share=None if kinematic_share is None else knowledge.full(kinematic_share),
        motions=tuple(e.fit.motion for e in experiments if e.fit is not None),
        cost=weighted_cost(robot, experiments, values, weighting),
        iterations=1,
        converged=True,
        status="solved (linear)",
        seconds=time.perf_counter() - began,
    )


def weighted_cost(
    robot: Robot, experiments: Sequence[Experiment], values: Array, weighting: Weighting
) -> float:
    """Return Σ c (q − A p)ᵀ W (q − A p) over all experiments."""
    cost = 0.0
    for experiment in experiments:
        rest = experiment.forces - experiment.regressors(robot) @ values
        weights = weighting(experiment.noise.force_covariance)
        cost += float(np.einsum("s,si,ij,sj->", experiment.counts, rest, weights, rest))
    return cost


def _kinematic_share(
    robot: Robot,
    experiments: Sequence[Experiment],
    knowledge: Knowledge,
    weighting: Weighting,
    values: Array,
    inverse: Array,
) -> Array | None:
    """Return B Cov(ξ̂) Bᵀ, B = −∂p̂/∂ξ = F⁻¹ Σ c Aᵀ W ∂(A p)/∂ξ; None after pointwise kinematics."""
    total = np.zeros_like(inverse)
    for experiment in experiments:
        if experiment.fit is None:
            return None
        weights = weighting(experiment.noise.force_covariance)
        cross = force_cross_information(robot, experiment, knowledge, weights, values)
        slope = inverse @ cross
        total += slope @ experiment.fit.covariance @ slope.T
    return total


def force_cross_information(
    robot: Robot, experiment: Experiment, knowledge: Knowledge, weights: Array, values: Array
) -> Array:
    """Return Σ c Aᵀ W ∂(A p)/∂ξ of the free parameters, (k, x), along the fitted motion."""
    fit, record = experiment.fit, experiment.record
    if fit is None:
        raise ValueError("pointwise kinematics have no ξ")
    signs = experiment.signs(robot, fit.motion)
    cross = np.zeros((int(np.count_nonzero(knowledge.free)), len(fit.covariance)))
    for first in range(0, record.samples, CHUNK):
        part = slice(first, first + CHUNK)
        prediction = predict_forces(
            robot,
            fit.motion,
            record.force_times[part],
            signs[part],
            values,
            free_frequency=fit.free_frequency,
        )
        counted = prediction.regressors[:, :, knowledge.free]
        counted = counted * record.force_counts[part][:, None, None]
        weighted = np.matmul(weights, counted).reshape(-1, counted.shape[2])
        cross += weighted.T @ prediction.slope.reshape(len(weighted), -1)
    return cross
