"""The joint normal equations of (p, ξ): what maximum likelihood solves, and its information.

The rows are q − A(ξ) p and l − l(ξ), weighted with Σ⁻¹ and Δ⁻¹. The inverse of the information
that they leave on p when the motions are eliminated,

    F_p = F_pp − F_pξ F_ξξ⁻¹ F_ξp,

is the Cramér–Rao bound: no unbiased estimator's covariance falls below it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.estimators.deviating import DeviatingMachine
from estimation.estimators.experiment import Experiment
from estimation.estimators.knowledge import Knowledge
from estimation.kinematics.fourier_fit import length_equations
from estimation.kinematics.friction_signs import signs_along
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.normal_equations import Filter, NormalEquations, Rows
from estimation.measurement_model.prediction import chunks, force_columns
from expdesign.robot import Robot


def force_equations(
    robot: Robot,
    experiment: Experiment,
    motion: HarmonicMotion,
    values: Array,
    free: NDArray[np.bool_],
    covariance: Array,
    noise_filter: Filter | None,
) -> NormalEquations:
    """Return what the forces of one experiment say of the free parameters and ξ.

    Parameters
    ----------
    motion, values
        ξ and p, (m,), where the equations are taken.
    free : (m,) of bool
        Parameters that are estimated.
    covariance : (6, 6)
        Whose inverse the rows are weighted with, behind the filter.
    """
    record = experiment.record
    spread = experiment.spread_along(motion)

    def rows(part: slice) -> Rows:
        sampled = motion.at(record.forces.times[part])
        signs = signs_along(robot, sampled, spread[part])
        regressors, columns = force_columns(robot, sampled, signs, values, free)
        residuals = record.forces.values[part] - regressors @ values
        return residuals, columns, record.forces.counts[part]

    return NormalEquations.of(map(rows, chunks(record.samples)), covariance, noise_filter)


def joint_equations(
    robot: Robot,
    experiment: Experiment,
    motion: HarmonicMotion,
    values: Array,
    free: NDArray[np.bool_],
    forces: NormalEquations | None = None,
) -> NormalEquations:
    """Return what forces and lengths of one experiment say of the free parameters and ξ.

    Where it is known already what the forces say, there, it is taken.
    """
    noise = experiment.noise
    lengths = length_equations(
        robot, experiment.record, noise.lengths.covariance, motion, noise.lengths.filter
    )
    if forces is None:
        own = noise.forces.covariance, noise.forces.filter
        forces = force_equations(robot, experiment, motion, values, free, *own)
    return forces.with_motion(lengths)


def reduced_information(equations: Sequence[NormalEquations], knowledge: Knowledge) -> Array:
    """Return F_p over all experiments, (k, k), priors included."""
    count = int(np.count_nonzero(knowledge.free))
    return knowledge.precision + sum(each.eliminated(count).information for each in equations)


def cramer_rao_covariance(
    robot: Robot,
    experiments: Sequence[Experiment],
    motions: Sequence[HarmonicMotion],
    knowledge: Knowledge,
    values: Array,
) -> Array:
    """Return the bound at (p, ξ) as a covariance, (m, m); zero for fixed parameters.

    Priors count as data. Constants of terms that are estimated are unknowns, too, and stand where
    the robot has them. The friction signs are the plain ones at `motions` when the experiments
    have no spread of their rates (`Experiment.spread` zero), else the expected ones.
    """
    pairs = tuple(zip(experiments, motions, strict=True))
    constants = knowledge.constants(robot)
    if not constants:
        equations = [joint_equations(robot, *each, values, knowledge.free) for each in pairs]
        return knowledge.full(knowledge.inverse(reduced_information(equations, knowledge)))
    machine = DeviatingMachine.of(robot, constants, np.zeros(len(constants)))
    equations = [machine.joint_equations(*each, values, knowledge.free) for each in pairs]
    known = knowledge.with_deviations(constants)
    inverse = known.inverse(reduced_information(equations, known))
    count = int(np.count_nonzero(knowledge.free))
    return knowledge.full(inverse[:count, :count])
