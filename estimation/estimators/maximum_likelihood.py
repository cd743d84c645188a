"""Maximum likelihood (15): the parameters and the motion together.

Minimises ½(‖D δ‖² + ‖S η‖²) plus the prior's part over (p, ξ) by Levenberg–Marquardt with analytic
derivatives of the shared graph, from the Gauss–Markov estimate. The friction signs are the expected
ones along the present motion (`estimation.kinematics.friction_signs`): they follow ξ from step to
step and are held in the derivatives.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.estimators.experiment import Experiment
from estimation.estimators.influence import Influence
from estimation.estimators.joint import joint_equations, reduced_information
from estimation.estimators.knowledge import Knowledge
from estimation.estimators.result import ParameterEstimate, precision
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.normal_equations import Elimination, NormalEquations
from expdesign.robot import Robot

_STEPS = 40
_CONVERGED = 1e-3
"""Newton decrement, in standard deviations of the whole estimate, of a step that is the last."""

_CONTRACTION = 0.5
_FIRST_DAMPING = 1e-3
_SMALLEST_DAMPING = 1e-6
_LARGEST_DAMPING = 1e6


def maximum_likelihood(
    robot: Robot,
    experiments: Sequence[Experiment],
    knowledge: Knowledge,
    start: ParameterEstimate,
) -> ParameterEstimate:
    """Estimate parameters and motions jointly.

    The motions of the experiments are fitted ones, and `start` is the Gauss–Markov estimate.

    Raises
    ------
    UnidentifiableError
        The data (and priors) do not determine every free parameter.
    ValueError
        An experiment has pointwise kinematics.
    """
    began = time.perf_counter()
    if any(experiment.fit is None for experiment in experiments):
        raise ValueError("maximum likelihood needs motions that were fitted by Fourier series")
    problem = _Problem(robot, experiments, knowledge)
    values, motions = start.values.copy(), [experiment.motion for experiment in experiments]
    equations = problem.equations(values, motions)
    cost = problem.cost(equations, values)
    damping, iterations, status = 0.0, 0, "stopped at the most iterations allowed"
    converged = False
    move = problem.step(equations, values, motions, damping)
    for _ in range(_STEPS):
        iterations += 1
        trial = problem.equations(move.values, move.motions)
        trial_cost = problem.cost(trial, move.values)
        following = problem.step(trial, move.values, move.motions, 0.0)
        # The expected signs follow ξ and the derivatives hold them: what is solved is the score
        # equation, whose root is next to the least cost but not at it. Close to it the cost says
        # nothing, and the next step must be much shorter than this one instead.
        close = move.decrement <= len(values)
        shorter = close and following.decrement <= _CONTRACTION**2 * move.decrement
        if trial_cost <= cost or shorter:
            values, motions, equations, cost = move.values, move.motions, trial, trial_cost
            damping = damping / 10 if damping > _SMALLEST_DAMPING else 0.0
            move = following
            if damping:
                move = problem.step(equations, values, motions, damping)
            if following.decrement < _CONVERGED**2:
                # This step is known already; what it leaves is smaller by orders.
                values, motions = following.values, following.motions
                converged, status = True, "converged"
                break
        else:
            damping = max(10 * damping, _FIRST_DAMPING)
            if damping > _LARGEST_DAMPING:
                status = "no step improves the fit any more"
                break
            move = problem.step(equations, values, motions, damping)
    inverse = knowledge.inverse(reduced_information(equations, knowledge))
    influences = [
        _influence(problem, experiment, motion, values, each.eliminated(len(inverse)), inverse)
        for experiment, motion, each in zip(experiments, motions, equations, strict=True)
    ]
    return ParameterEstimate(
        estimator="ml",
        values=values,
        **precision(influences, knowledge, inverse @ knowledge.precision @ inverse),
        motions=tuple(motions),
        cost=cost,
        iterations=iterations,
        converged=converged,
        status=status,
        seconds=time.perf_counter() - began,
    )


def _influence(
    problem: _Problem,
    experiment: Experiment,
    motion: HarmonicMotion,
    values: Array,
    eliminated: Elimination,
    inverse: Array,
) -> Influence:
    """Return how the errors of one experiment move the parameters, its motion eliminated."""
    through_motion = -inverse @ eliminated.slope.T
    return Influence(
        robot=problem.robot,
        experiment=experiment,
        motion=motion,
        values=values,
        free=problem.knowledge.free,
        weighting=experiment.noise.forces.covariance,
        weighted_by_noise=True,
        force_gain=np.concatenate([inverse, through_motion], axis=1),
        length_gain=through_motion,
    )


@dataclass(frozen=True, eq=False)
class _Move:
    """Where a step leads, and the square of its length in standard deviations."""

    values: Array
    motions: list[HarmonicMotion]
    decrement: float


@dataclass(frozen=True, eq=False)
class _Problem:
    robot: Robot
    experiments: Sequence[Experiment]
    knowledge: Knowledge

    def equations(self, values: Array, motions: Sequence[HarmonicMotion]) -> list[NormalEquations]:
        return [
            joint_equations(self.robot, experiment, motion, values, self.knowledge.free)
            for experiment, motion in zip(self.experiments, motions, strict=True)
        ]

    def cost(self, equations: Sequence[NormalEquations], values: Array) -> float:
        off = (values - self.knowledge.prior_mean)[self.knowledge.free]
        return sum(each.cost for each in equations) + float(off @ self.knowledge.precision @ off)

    def step(
        self,
        equations: Sequence[NormalEquations],
        values: Array,
        motions: Sequence[HarmonicMotion],
        damping: float,
    ) -> _Move:
        """Return where a (damped) Gauss–Newton step leads."""
        known = self.knowledge
        count = int(np.count_nonzero(known.free))
        information = known.precision
        gradient = information @ (known.prior_mean - values)[known.free]
        eliminated = [each.eliminated(count, damping) for each in equations]
        for each in eliminated:
            information = information + each.information
            gradient = gradient + each.gradient
        if damping:
            information = information + damping * np.diag(np.diag(information))
        move = known.best_step(information, gradient, values)
        new = values.copy()
        new[known.free] += move
        # Parameters that stand at a bound would pull without end: what counts is the step taken.
        decrement = float(move @ information @ move)
        moved = []
        for each, whole, motion in zip(eliminated, equations, motions, strict=True):
            decrement += float(each.offset @ whole.gradient[count:])
            step = each.offset - each.slope @ move
            moved.append(motion.moved(step))
        return _Move(new, moved, decrement)
