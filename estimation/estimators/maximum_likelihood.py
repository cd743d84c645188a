"""Maximum likelihood (15): joint estimate of the parameters and the motion.

Minimises ½(‖D δ‖² + ‖S η‖²) plus the prior's part over (p, ξ) by Levenberg–Marquardt with analytic
derivatives of the shared graph, starting from the Gauss–Markov estimate. The friction signs are the
expected ones along the current motion (`estimation.kinematics`): they are updated in
every step and constant in the derivatives.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from estimation.estimators.covariance import Influence
from estimation.estimators.experiment import Experiment
from estimation.estimators.joint_equations import PerturbedMachine
from estimation.estimators.priors import ParameterPriors
from estimation.estimators.result import ParameterEstimate
from estimation.measurement_model import Motion
from estimation.measurement_model.motion import Elimination, NormalEquations
from expdesign.progress import report_progress
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation

_STEPS = 40
_CONVERGED = 1e-2
"""Newton decrement of the last step, in standard deviations of the whole estimate; the next step
would be shorter by another factor of a thousand."""

_CORRECTIONS = 4
_CONTRACTION = 0.8
_FIRST_DAMPING = 1e-3
_SMALLEST_DAMPING = 1e-6
_LARGEST_DAMPING = 1e6


def maximum_likelihood(
    robot: Robot,
    experiments: Sequence[Experiment],
    priors: ParameterPriors,
    start: ParameterEstimate,
    deviations: Sequence[Deviation] = (),
) -> ParameterEstimate:
    """Estimate parameters and motions jointly.

    Parameters
    ----------
    experiments : sequence of Experiment
        With fitted motions.
    start : ParameterEstimate
        The Gauss–Markov estimate, or an earlier one.
    deviations : sequence of Deviation
        Further unknowns θ, common to all experiments, with their tolerances as priors. Constants
        of terms marked `estimate: true` in the robot file precede them.

    Raises
    ------
    UnidentifiableError
        The data (and priors) do not determine every free parameter.
    ValueError
        An experiment has pointwise kinematics.
    """
    began = time.perf_counter()
    deviations = priors.constants_and(deviations, robot)
    if any(experiment.fit is None for experiment in experiments):
        raise ValueError("maximum likelihood needs motions that were fitted by Fourier series")
    # θ follows the parameters and is treated alike, with its tolerances as priors.
    joint_priors = priors.with_deviations(deviations)
    experiments = [experiment.for_estimator("ml") for experiment in experiments]
    problem = _Problem(robot, experiments, joint_priors, deviations)
    known = {} if start.systematic is None else start.systematic.estimates
    theta = [known.get(one.name, 0.0) for one in deviations]
    values = np.concatenate([start.values, theta])
    motions = [experiment.fitted.motion for experiment in experiments]
    point = problem.at(values, motions)
    damping, iterations, status = 0.0, 0, "stopped at the maximum number of iterations"
    converged = False
    move = problem.step(point, damping)
    eliminated = move.eliminated
    for iterations in range(1, _STEPS + 1):
        report_progress(f"maximum likelihood, step {iterations}")
        trial = problem.try_move(move, point.cost)
        if trial is not None:
            point, move = trial
            eliminated = move.eliminated
            if move.decrement < _CONVERGED**2:
                converged, status = True, "converged"
                break
            damping = damping / 10 if damping > _SMALLEST_DAMPING else 0.0
            if damping:
                move = problem.step(point, damping)
        else:
            damping = max(10 * damping, _FIRST_DAMPING)
            if damping > _LARGEST_DAMPING:
                status = "no step improves the fit any more"
                break
            move = problem.step(point, damping)
    inverse = joint_priors.inverse(joint_priors.precision + sum(each.matrix for each in eliminated))
    influences = [
        _influence(problem, experiment, motion, point.values, each, inverse)
        for experiment, motion, each in zip(experiments, point.motions, eliminated, strict=True)
    ]
    # This step is known already; the remaining one is smaller by orders of magnitude.
    last = move if converged else point
    return ParameterEstimate.of(
        influences,
        joint_priors,
        inverse,
        last.values,
        deviations,
        began=began,
        estimator="ml",
        motions=tuple(last.motions),
        cost=point.cost,
        iterations=iterations,
        converged=converged,
        status=status,
    )


def _influence(
    problem: _Problem,
    experiment: Experiment,
    motion: Motion,
    values: Array,
    eliminated: Elimination,
    inverse: Array,
) -> Influence:
    """Return the influence of one experiment on parameters and θ, its motion eliminated."""
    free = problem.priors.free[: problem.parameters]
    count = int(np.count_nonzero(free))
    through_motion = -inverse @ eliminated.slope.T
    return Influence(
        robot=problem.robot,
        experiment=experiment,
        motion=motion,
        values=values[: problem.parameters],
        free=free,
        weights=experiment.noise.forces,
        force_gain=np.concatenate([inverse, through_motion], axis=1),
        length_gain=np.concatenate([inverse[:, count:], through_motion], axis=1),
        machine=problem.machine(values),
    )


@dataclass(frozen=True, eq=False)
class _Move:
    """Values after a step, and the square of its length in standard deviations."""

    values: Array
    motions: list[Motion]
    decrement: float
    eliminated: list[Elimination]
    """Equations at the start of the step, with the motions eliminated."""


@dataclass(frozen=True, eq=False)
class _Point:
    """Values of (p, θ) and motions, with their joint equations and cost."""

    values: Array
    motions: Sequence[Motion]
    equations: list[NormalEquations]
    cost: float


@dataclass(frozen=True, eq=False)
class _Problem:
    robot: Robot
    experiments: Sequence[Experiment]
    priors: ParameterPriors
    """Priors of the parameters, followed by those of θ."""
    deviations: tuple[Deviation, ...]

    @property
    def parameters(self) -> int:
        """Number m of parameters."""
        return len(self.priors.free) - len(self.deviations)

    def machine(self, values: Array) -> PerturbedMachine:
        """Return the machine at (p, θ), (m + t,)."""
        return PerturbedMachine.of(self.robot, self.deviations, values[self.parameters :])

    def at(self, values: Array, motions: Sequence[Motion]) -> _Point:
        """Evaluate the joint equations."""
        machine = self.machine(values)
        own, free = values[: self.parameters], self.priors.free[: self.parameters]
        equations = [
            machine.joint_equations(each, motion, own, free)
            for each, motion in zip(self.experiments, motions, strict=True)
        ]
        cost = sum(each.cost for each in equations) + self.priors.equations(values).cost
        return _Point(values, motions, equations, cost)

    def try_move(self, move: _Move, cost: float) -> tuple[_Point, _Move] | None:
        """Return the end of a step from a point of this cost, and the undamped step from there.

        None: it is no improvement.

        The measured lengths are nearly exact, and a step along the tangent of (θ, ξ) leaves the
        motions that have them: there the motions are corrected with the parameters fixed, as long
        as that helps.
        """
        motions, best = move.motions, np.inf
        for _ in range(_CORRECTIONS + 1):
            point = self.at(move.values, motions)
            if not point.cost < best:
                return None
            try:
                following = self.step(point, 0.0)
            except np.linalg.LinAlgError:  # so far off that nothing determines the motions
                return None
            # The derivatives hold the expected signs constant: this solves the score equation, and
            # its root is close to the minimum of the cost, but not at it. Near the root the cost is
            # no measure of progress; there, the next step must be much shorter than this one.
            close = move.decrement <= len(move.values)
            shorter = close and following.decrement <= _CONTRACTION**2 * move.decrement
            if point.cost <= cost or shorter:
                return point, following
            best = point.cost
            pairs = zip(motions, following.eliminated, strict=True)
            motions = [motion.add_step(each.offset) for motion, each in pairs]
        return None

    def step(self, point: _Point, damping: float) -> _Move:
        """Take a (damped) Gauss–Newton step."""
        known, values = self.priors, point.values
        count = int(np.count_nonzero(known.free))
        eliminated = [each.eliminate(count, damping) for each in point.equations]
        total = sum(eliminated, known.equations(values))
        information = total.matrix
        if damping:
            information = information + damping * np.diag(np.diag(information))
        move = known.best_step(information, total.gradient, values)
        new = values.copy()
        new[known.free] += move
        # Parameters at a bound keep their gradient: only the step taken counts.
        decrement = float(move @ information @ move)
        new_motions = []
        for each, whole, motion in zip(eliminated, point.equations, point.motions, strict=True):
            decrement += float(each.offset @ whole.gradient[count:])
            step = each.offset - each.slope @ move
            new_motions.append(motion.add_step(step))
        return _Move(new, new_motions, decrement, eliminated)
