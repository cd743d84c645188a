"""Least squares and Gauss–Markov (7): linear in the parameters, the motion taken as measured.

Both minimise Σ c (q − A p)ᵀ W (q − A p) plus the prior's part; LS with W = I (in units of the mean
variance, so that priors have their weight), GM with W = Σ⁻¹. Their covariance counts the full Σ
either way, and the noise of the lengths through B = −∂p̂/∂ξ.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from constraints.arrays import Array
from estimation.estimators.experiment import Experiment
from estimation.estimators.joint import force_equations
from estimation.estimators.knowledge import Knowledge
from estimation.estimators.result import ParameterEstimate
from estimation.measurement_model.normal_equations import NormalEquations
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
    information, spread = prior, prior
    gradient = prior @ (knowledge.prior_mean - start)[free]
    noises = [experiment.noise.forces.covariance for experiment in experiments]
    weightings = [weighting_covariance(estimator, noise) for noise in noises]
    for experiment, noise, weighting in zip(experiments, noises, weightings, strict=True):
        rows = (
            experiment.forces - experiment.fitted_regressors @ start,
            experiment.fitted_regressors[:, :, free],
            experiment.counts,
        )
        fitted = NormalEquations.of([rows], weighting)
        information = information + fitted.matrix
        gradient = gradient + fitted.gradient
        # What noise of the covariance Σ makes of the gradient: Σ c Aᵀ W Σ W A.
        mixed = weighting @ np.linalg.solve(noise, weighting)
        spread = spread + (
            fitted.matrix if weighting is noise else NormalEquations.of([rows], mixed).matrix
        )
    values = start.copy()
    values[free] += knowledge.best_step(information, gradient, start)
    inverse = knowledge.inverse(information)
    force_share = inverse @ spread @ inverse
    kinematic_share = _kinematic_share(robot, experiments, knowledge, weightings, values, inverse)
    # Σ c (q − A p)ᵀ W (q − A p)
    cost = 0.0
    for experiment, weighting in zip(experiments, weightings, strict=True):
        rest = experiment.forces - experiment.fitted_regressors @ values
        inner = np.linalg.inv(weighting)
        cost += float(np.einsum("s,si,ij,sj->", experiment.counts, rest, inner, rest))
    total = force_share if kinematic_share is None else force_share + kinematic_share
    return ParameterEstimate(
        estimator=estimator,
        values=values,
        covariance=knowledge.full(total),
        covariance_forces=knowledge.full(force_share),
        covariance_kinematics=None if kinematic_share is None else knowledge.full(kinematic_share),
        motions=tuple(e.fit.motion for e in experiments if e.fit is not None),
        cost=cost,
        iterations=1,
        converged=True,
        status="solved (linear)",
        seconds=time.perf_counter() - began,
    )


def _kinematic_share(
    robot: Robot,
    experiments: Sequence[Experiment],
    knowledge: Knowledge,
    weightings: Sequence[Array],
    values: Array,
    inverse: Array,
) -> Array | None:
    """Return B Cov(ξ̂) Bᵀ, B = −∂p̂/∂ξ = F⁻¹ Σ c Aᵀ W ∂(A p)/∂ξ; None after pointwise kinematics."""
    total, count = np.zeros_like(inverse), len(inverse)
    for experiment, weighting in zip(experiments, weightings, strict=True):
        fit = experiment.fit
        if fit is None:
            return None
        equations = force_equations(
            robot, experiment, fit.motion, values, knowledge.free, weighting
        )
        slope = inverse @ equations.matrix[:count, count:]
        total += slope @ fit.covariance @ slope.T
    return total
