"""Least squares and Gauss–Markov (7): linear in the parameters, the motion taken as measured.

Both minimise Σ c (q − A p)ᵀ W (q − A p) plus the prior's part; LS with W = I (in units of the mean
variance, so that priors have their weight), GM with W = Σ⁻¹, behind the filter that makes the noise
white where it is not. Their covariance counts the noise as it is either way, and that of the
lengths through B = −∂p̂/∂ξ.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from constraints.arrays import Array
from estimation.estimators.experiment import Experiment
from estimation.estimators.influence import Influence
from estimation.estimators.joint import force_equations
from estimation.estimators.knowledge import Knowledge
from estimation.estimators.result import ParameterEstimate, precision
from estimation.measurement_model.normal_equations import Filter, NormalEquations
from expdesign.robot import Robot


def weighting_covariance(estimator: str, covariance: Array) -> Array:
    """Return W⁻¹, (6, 6), of ``"ls"`` or ``"gm"`` from Σ, (6, 6)."""
    if estimator == "gm":
        return covariance
    return np.eye(len(covariance)) * np.trace(covariance) / len(covariance)


def linear_estimate(
    robot: Robot, experiments: Sequence[Experiment], knowledge: Knowledge, estimator: str
) -> ParameterEstimate:
    """Estimate the parameters with equal weights, ``"ls"``, or with the full Σ, ``"gm"``.

    Raises
    ------
    UnidentifiableError
        The data (and priors) do not determine every free parameter.
    """
    began = time.perf_counter()
    free, start, prior = knowledge.free, knowledge.start, knowledge.precision
    information = prior
    gradient = prior @ (knowledge.prior_mean - start)[free]
    noises = [experiment.noise.forces for experiment in experiments]
    weightings = [weighting_covariance(estimator, noise.covariance) for noise in noises]
    filters = [noise.filter if estimator == "gm" else None for noise in noises]
    cost = 0.0
    for experiment, weighting, noise_filter in zip(experiments, weightings, filters, strict=True):
        rows = (
            experiment.forces - experiment.fitted_regressors @ start,
            experiment.fitted_regressors[:, :, free],
            experiment.counts,
        )
        fitted = NormalEquations.of([rows], weighting, noise_filter)
        information = information + fitted.matrix
        gradient = gradient + fitted.gradient
        cost += fitted.cost
    values = start.copy()
    move = knowledge.best_step(information, gradient, start)
    values[free] += move
    inverse = knowledge.inverse(information)
    # Σ c (q − A p)ᵀ W (q − A p), the prior's part left out.
    data_gradient = gradient - prior @ (knowledge.prior_mean - start)[free]
    cost += float(move @ (information - prior) @ move - 2 * data_gradient @ move)
    influences = [
        Influence(
            robot=robot,
            experiment=experiment,
            motion=None if experiment.fit is None else experiment.fit.motion,
            values=values,
            free=free,
            weighting=weighting,
            weighted_by_noise=estimator == "gm",
            force_gain=inverse,
            length_gain=_length_gain(
                robot, experiment, knowledge, weighting, noise_filter, values, inverse
            ),
        )
        for experiment, weighting, noise_filter in zip(
            experiments, weightings, filters, strict=True
        )
    ]
    return ParameterEstimate(
        estimator=estimator,
        values=values,
        **precision(influences, knowledge, inverse @ prior @ inverse),
        motions=tuple(e.fit.motion for e in experiments if e.fit is not None),
        cost=cost,
        iterations=1,
        converged=True,
        status="solved (linear)",
        seconds=time.perf_counter() - began,
    )


def _length_gain(
    robot: Robot,
    experiment: Experiment,
    knowledge: Knowledge,
    weighting: Array,
    noise_filter: Filter | None,
    values: Array,
    inverse: Array,
) -> Array | None:
    """Return −B Cov(ξ̂), B = −∂p̂/∂ξ = F⁻¹ Σ c Aᵀ W ∂(A p)/∂ξ; None after pointwise kinematics."""
    fit = experiment.fit
    if fit is None:
        return None
    equations = force_equations(
        robot, experiment, fit.motion, values, knowledge.free, weighting, noise_filter
    )
    count = len(inverse)
    return -inverse @ equations.matrix[:count, count:] @ fit.covariance
