"""The joint normal equations of (p, ξ): what maximum likelihood solves, and its information.

The rows are q − A(ξ) p and l − l(ξ), weighted with Σ⁻¹ and Δ⁻¹. The inverse of the information
that they leave on p when the motions are eliminated,

    F_p = F_pp − F_pξ F_ξξ⁻¹ F_ξp,

is the Cramér–Rao bound: no unbiased estimator's covariance falls below it.

What a machine measures that deviates from its description by θ, and how that changes with θ.

The joints, gravity's direction and the constants of the terms are really moved; lengths have their
zeros, forces their gains, stamps their delay and clock. At θ = 0 it is the machine described.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.estimators.experiment import Experiment
from estimation.estimators.priors import ParameterPriors
from estimation.kinematics.fourier_fit import length_equations
from estimation.kinematics.pointwise import expected_signs, signs_along
from estimation.measurement_model import HarmonicMotion, predict_lengths
from estimation.measurement_model.normal_equations import Filter, NormalEquations, Rows
from estimation.measurement_model.prediction import (
    chunks,
    deviation_lengths,
    force_columns,
    predict_deviating_forces,
)
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation, deviated
from expdesign.robot.deviation_slope import delay_of_jumps


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


def reduced_information(equations: Sequence[NormalEquations], priors: ParameterPriors) -> Array:
    """Return F_p over all experiments, (k, k), priors included."""
    count = int(np.count_nonzero(priors.free))
    return priors.precision + sum(each.eliminated(count).information for each in equations)


def cramer_rao_covariance(
    robot: Robot,
    experiments: Sequence[Experiment],
    motions: Sequence[HarmonicMotion],
    priors: ParameterPriors,
    values: Array,
) -> Array:
    """Return the bound at (p, ξ) as a covariance, (m, m); zero for fixed parameters.

    Priors count as data. Constants of terms that are estimated are unknowns, too, and stand where
    the robot has them. The friction signs are the plain ones at `motions` when the experiments
    have no spread of their rates (`Experiment.spread` zero), else the expected ones.
    """
    pairs = tuple(zip(experiments, motions, strict=True))
    constants = priors.constants(robot)
    if not constants:
        equations = [joint_equations(robot, *each, values, priors.free) for each in pairs]
        return priors.full(priors.inverse(reduced_information(equations, priors)))
    machine = PerturbedMachine.of(robot, constants, np.zeros(len(constants)))
    equations = [machine.joint_equations(*each, values, priors.free) for each in pairs]
    known = priors.with_deviations(constants)
    inverse = known.inverse(reduced_information(equations, known))
    count = int(np.count_nonzero(priors.free))
    return priors.full(inverse[:count, :count])


class MeasuredForces(NamedTuple):
    """Forces as they are measured, with their derivatives.

    Attributes
    ----------
    regressors : (S, 6, m)
        Times p: the forces, N.
    deviations : (S, 6, t)
        ∂(measured forces)/∂θ.
    slope : (S, 6, x)
        ∂(measured forces)/∂ξ.
    """

    regressors: Array
    deviations: Array
    slope: Array


class MeasuredLengths(NamedTuple):
    """Lengths as they are measured, (S, 6), m, and their derivatives as of `MeasuredForces`."""

    values: Array
    deviations: Array
    slope: Array


@dataclass(frozen=True, eq=False)
class PerturbedMachine:
    """A machine at θ."""

    robot: Robot
    """Whose joints, gravity and constants have moved."""
    chosen: tuple[Deviation, ...]
    theta: Array
    """(t,), SI, of the entries chosen."""

    @classmethod
    def exact(cls, robot: Robot) -> PerturbedMachine:
        """Take the machine described."""
        return cls(robot, (), np.zeros(0))

    @classmethod
    def of(cls, robot: Robot, chosen: Sequence[Deviation], theta: Array) -> PerturbedMachine:
        """Move the robot described by θ, (t,)."""
        moves = any(
            value != 0 for one, value in zip(chosen, theta, strict=True) if one.of_the_machine
        )
        return cls(deviated(robot, chosen, theta) if moves else robot, tuple(chosen), theta)

    def forces(
        self,
        experiment: Experiment,
        motion: HarmonicMotion,
        values: Array,
        part: slice,
        *,
        jumps: bool = False,
    ) -> MeasuredForces:
        """Return what some of an experiment's force samples should be at ξ and p, (m,).

        The derivative to a delay may count the `jumps` of dry friction, on the average over where
        the samples are; one sample does not tell when a sign changed.
        """
        times = experiment.record.forces.times[part]
        own = experiment.record.own_clock
        motion, true_times = self._seen(motion, times - self.delay, own_clock=own)
        spread = experiment.spread_along(motion)
        signs = expected_signs(self.robot, motion, true_times, spread[part])
        regressors, slope, columns = predict_deviating_forces(
            self.robot, motion, true_times, signs, values, self.chosen, own_clock=own
        )
        if jumps:
            late = [one.group == "delay" for one in self.chosen]
            columns[:, :, late] += self._jumps(experiment, motion, true_times, signs, values)
        gains = self.gains[:, None]
        read = np.array([one.group.startswith("force_constant.") for one in self.chosen], bool)
        return MeasuredForces(
            regressors * gains,
            np.where(read, columns, columns * gains),
            slope * gains,
        )

    def _jumps(
        self,
        experiment: Experiment,
        motion: HarmonicMotion,
        times: Array,
        signs: Array,
        values: Array,
    ) -> Array:
        """Return what jumps of dry friction add to the column of a delay, (S, 6, 1)."""
        state = motion.at(times).state()
        step = experiment.record.step
        return delay_of_jumps(self.robot, state, signs, values, step)[:, :, None]

    def lengths(
        self, experiment: Experiment, motion: HarmonicMotion, part: slice
    ) -> MeasuredLengths:
        """Return what some of an experiment's length samples should be at ξ."""
        times = experiment.record.lengths.times[part]
        own = experiment.record.own_clock
        motion, true_times = self._seen(motion, times, own_clock=own)
        lengths, slope = predict_lengths(self.robot, motion, true_times)
        columns = deviation_lengths(self.robot, motion, true_times, self.chosen, own_clock=own)
        return MeasuredLengths(lengths + self.zeros, columns, slope)

    def joint_equations(
        self,
        experiment: Experiment,
        motion: HarmonicMotion,
        values: Array,
        free: NDArray[np.bool_],
    ) -> NormalEquations:
        """Return what an experiment says of the free parameters, of θ and of ξ, in this order."""
        lengths, noise = experiment.record.lengths, experiment.noise

        def length_rows(part: slice) -> Rows:
            found = self.lengths(experiment, motion, part)
            columns = np.concatenate([found.deviations, found.slope], axis=2)
            return lengths.values[part] - found.values, columns, lengths.counts[part]

        parts = chunks(experiment.record.samples)
        of_motion = NormalEquations.of(
            map(length_rows, parts), noise.lengths.covariance, noise.lengths.filter
        )
        own = noise.forces.covariance, noise.forces.filter
        return self.force_equations(experiment, motion, values, free, *own).with_motion(of_motion)

    def force_equations(
        self,
        experiment: Experiment,
        motion: HarmonicMotion,
        values: Array,
        free: NDArray[np.bool_],
        covariance: Array,
        noise_filter: Filter | None,
    ) -> NormalEquations:
        """Return what the forces of an experiment say of them.

        The rows are weighted with the inverse of the covariance, (6, 6), behind the filter.
        """
        forces = experiment.record.forces

        def rows(part: slice) -> Rows:
            found = self.forces(experiment, motion, values, part)
            columns = (found.regressors[:, :, free], found.deviations, found.slope)
            residuals = forces.values[part] - found.regressors @ values
            return residuals, np.concatenate(columns, axis=2), forces.counts[part]

        parts = chunks(experiment.record.samples)
        return NormalEquations.of(map(rows, parts), covariance, noise_filter)

    @property
    def delay(self) -> float:
        """By how much forces lag behind the lengths, s."""
        return self._one("delay")

    @property
    def zeros(self) -> Array:
        """(6,), by how much lengths are measured too long, m."""
        return self._per_actuator("strut_length")

    @property
    def gains(self) -> Array:
        """(6,), measured over true forces."""
        return 1.0 + self._one("force_constant.common") + self._per_actuator("force_constant.each")

    def _one(self, group: str) -> float:
        found = zip(self.chosen, self.theta, strict=True)
        return float(sum(value for one, value in found if one.group == group))

    def _per_actuator(self, group: str) -> Array:
        """Return the entries of a group whose names end with the actuator's number, (6,)."""
        result = np.zeros(ACTUATORS)
        for one, value in zip(self.chosen, self.theta, strict=True):
            if one.group == group:
                result[int(one.name.rpartition("_")[2]) - 1] += value
        return result

    def _seen(
        self, motion: HarmonicMotion, times: Array, *, own_clock: bool
    ) -> tuple[HarmonicMotion, Array]:
        """Return the motion and the times, s, at which it is measured at these stamps."""
        fast = self._one("clock")
        if own_clock:
            return replace(motion, omega=motion.omega * (1 + fast)), times / (1 + fast)
        return motion, times * (1 - fast)
