"""Least squares and Gauss–Markov (7): linear in the parameters, along the measured motion.

Both minimise Σ c (q − A p)ᵀ W (q − A p) plus the prior's part. LS takes W = I (in units of the mean
variance, so that priors have the right weight), GM W = Σ⁻¹ after the filter that whitens coloured
noise. Both covariances use the actual noise of the forces, and that of the lengths through
B = −∂p̂/∂ξ.

Estimated constants of terms enter by variable projection: p is optimal at every θ, and θ takes the
Gauss–Newton step of the joint problem (Golub and Pereyra, SIAM Journal on Numerical Analysis 10,
1973, in Kaufman's form), shortened until the sum of squares decreases. The covariance treats p and
θ alike.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from constraints.arrays import Array
from estimation.estimators.covariance import Influence
from estimation.estimators.experiment import Experiment
from estimation.estimators.joint_equations import PerturbedMachine
from estimation.estimators.priors import ParameterPriors
from estimation.estimators.result import ParameterEstimate
from estimation.measurement_model.banded import dense
from estimation.measurement_model.motion import NormalEquations
from estimation.processing import NoiseEstimate
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation

_STEPS = 30
_HALVINGS = 8
_CONVERGED = 1e-3
"""Length of the last step of the constants, in their standard deviations."""


def linear_estimate(
    robot: Robot, experiments: Sequence[Experiment], priors: ParameterPriors, estimator: str
) -> ParameterEstimate:
    """Estimate the parameters with equal weights, ``"ls"``, or with the full Σ, ``"gm"``.

    Constants of terms marked `estimate: true` in the robot file are estimated with them.

    Raises
    ------
    UnidentifiableError
        The data (and priors) do not determine every free parameter.
    ValueError
        Constants are to be estimated, but the kinematics are pointwise.
    """
    began = time.perf_counter()
    constants = priors.constants(robot)
    if constants and any(experiment.fit is None for experiment in experiments):
        raise ValueError("constants of terms are estimated along fitted motions only")
    along = tuple(experiment.for_estimator(estimator) for experiment in experiments)
    problem = _Problem(robot, along, priors, estimator, constants)
    fit, iterations, status = _iterate(problem)
    influences = [_influence(fit, number) for number in range(len(experiments))]
    return ParameterEstimate.of(
        influences,
        problem.joint_priors,
        fit.inverse,
        np.concatenate([fit.values, fit.theta]),
        constants,
        began=began,
        estimator=estimator,
        motions=tuple(each.fit.motion for each in along if each.fit is not None),
        cost=fit.cost,
        iterations=iterations,
        converged=status == "",
        status=status or ("solved" if constants else "solved (linear)"),
    )


@dataclass(frozen=True, eq=False)
class _Problem:
    robot: Robot
    experiments: tuple[Experiment, ...]
    priors: ParameterPriors
    estimator: str
    constants: tuple[Deviation, ...]
    """Entries of θ that are estimated."""

    @cached_property
    def weights(self) -> list[NoiseEstimate]:
        """The noise of every experiment by which its forces are weighted."""
        if self.estimator == "gm":
            return [each.linear_noise or each.noise.forces for each in self.experiments]

        def alike(experiment: Experiment) -> NoiseEstimate:
            mean = np.trace(experiment.noise.forces.covariance) / ACTUATORS
            noise = NoiseEstimate(np.eye(ACTUATORS) * mean, np.inf)
            return experiment.recording.forces.noise_before_sensors(noise)

        return [alike(experiment) for experiment in self.experiments]

    @cached_property
    def joint_priors(self) -> ParameterPriors:
        """Priors of the parameters, followed by those of θ."""
        return self.priors.with_deviations(self.constants) if self.constants else self.priors

    def at(self, theta: Array) -> _Fit:
        """Return the optimal parameters at θ."""
        machine = PerturbedMachine.of(self.robot, self.constants, theta)
        present = self.experiments
        if np.any(theta != 0):
            present = tuple(experiment.of_robot(machine.robot) for experiment in present)
        free, start = self.priors.free, self.priors.start
        joint = self.joint_priors.equations(np.concatenate([start, theta]))
        prior = replace(joint.select(slice(np.count_nonzero(free))), cost=0.0)
        total = prior
        for experiment, weights in zip(present, self.weights, strict=True):
            total = total + experiment.linear_equations(start, free, weights)
        values = start.copy()
        move = self.priors.best_step(total.matrix, total.gradient, start)
        values[free] += move
        # Σ c (q − A p)ᵀ W (q − A p), the prior's part left out.
        curvature, slope = total.matrix - prior.matrix, total.gradient - prior.gradient
        cost = total.cost + float(move @ curvature @ move - 2 * slope @ move)
        return _Fit(self, machine, present, theta, values, cost, total.matrix)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Optimal parameters at θ."""

    problem: _Problem
    machine: PerturbedMachine
    experiments: tuple[Experiment, ...]
    """Experiments with A at θ."""
    theta: Array
    values: Array
    cost: float
    linear: Array
    """(k, k), information on the parameters with θ fixed."""

    @property
    def total(self) -> float:
        """Cost including the priors."""
        at = np.concatenate([self.values, self.theta])
        return self.cost + self.problem.joint_priors.equations(at).cost

    @cached_property
    def equations(self) -> list[NormalEquations]:
        """Normal equations of the parameters, θ and ξ from the forces of every experiment."""
        problem = self.problem
        found = []
        for experiment, weights in zip(self.experiments, problem.weights, strict=True):
            own = experiment.fitted.motion, self.values, problem.priors.free, weights
            found.append(self.machine.force_equations(experiment, *own))
        return found

    @cached_property
    def information(self) -> Array:
        """(k + t, k + t), information on the parameters and θ, priors included."""
        count = len(self.problem.joint_priors.precision)
        if not self.problem.constants:
            return self.linear
        data = sum(dense(each.matrix[:count, :count]) for each in self.equations)
        return self.problem.joint_priors.precision + data

    @cached_property
    def inverse(self) -> Array:
        return self.problem.joint_priors.inverse(self.information)

    def step(self) -> tuple[Array, float]:
        """Return the step of θ and its length in standard deviations."""
        known, count = self.problem.joint_priors, len(self.linear)
        at = np.concatenate([self.values, self.theta])
        gradient = known.equations(at).gradient
        gradient = gradient + sum(each.gradient[: len(gradient)] for each in self.equations)
        move = known.best_step(self.information, gradient, at)[count:]
        within = self.inverse[count:, count:]
        return move, float(np.sqrt(move @ np.linalg.solve(within, move)))


def _iterate(problem: _Problem) -> tuple[_Fit, int, str]:
    """Return the best fit, the number of steps, and the reason if it did not converge."""
    fit = problem.at(np.zeros(len(problem.constants)))
    if not problem.constants:
        return fit, 1, ""
    for number in range(1, _STEPS + 1):
        move, length = fit.step()
        trial = problem.at(fit.theta + move)
        for _ in range(_HALVINGS):
            if trial.total <= fit.total:
                break
            move = move / 2
            trial = problem.at(fit.theta + move)
        if trial.total <= fit.total:
            fit = trial
        if length < _CONVERGED:
            return fit, number, ""
        if fit is not trial:
            return fit, number, "no step improves the fit any more"
    return fit, _STEPS, "stopped at the maximum number of iterations"


def _influence(fit: _Fit, number: int) -> Influence:
    """Return the influence of one experiment's errors on the parameters and θ.

    The gain of the lengths is −B Cov(ξ̂), B = −∂p̂/∂ξ = F⁻¹ Σ c Uᵀ W ∂(A p)/∂ξ; it is unknown after
    pointwise kinematics.
    """
    problem, experiment, gain = fit.problem, fit.experiments[number], fit.inverse
    motion, length_gain, force_gain = None, None, gain
    if experiment.fit is not None:
        motion, count = experiment.fit.motion, gain.shape[1]
        cross = dense(fit.equations[number].matrix[count:, :count]) @ gain.T
        length_gain = -(experiment.fit.covariance @ cross).T
        if problem.constants:
            force_gain = np.pad(gain, ((0, 0), (0, motion.unknowns)))
            length_gain = np.pad(length_gain, ((0, 0), (len(problem.constants), 0)))
    return Influence(
        robot=problem.robot,
        experiment=experiment,
        motion=motion,
        values=fit.values,
        free=problem.priors.free,
        weights=problem.weights[number],
        force_gain=force_gain,
        length_gain=length_gain,
        machine=fit.machine,
    )
