"""Joint normal equations of parameters p, motion ξ and machine deviations θ.

The rows are q − A(ξ) p and l − l(ξ), weighted with Σ⁻¹ and Δ⁻¹; maximum likelihood solves their
normal equations. Eliminating the motions leaves the information on p,

    F_p = F_pp − F_pξ F_ξξ⁻¹ F_ξp,

and its inverse is the Cramér–Rao bound: no unbiased estimator has a smaller covariance.

`PerturbedMachine` predicts the measurements of a machine that deviates by θ from its description:
joints, gravity's direction and constants of terms are changed in the model; zeros of lengths, gains
of forces, delays, low passes and clock in the measurement. θ = 0 is the machine as described.

A first-order low pass of the time constant τ is a mixture of delays,

    ∫ f(t − τ x) e^(−x) dx = Σ_k w_k f(t − τ x_k),

with the nodes and weights of Gauss and Laguerre. Harmonics behind it have errors of 5e-5 at
ωτ = 0.5, 0.8 % at 1, and 10 % at 1.5. A jump of dry friction is spread over the part of e^(−x) that
each node represents.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.estimators.experiment import Experiment
from estimation.estimators.priors import ParameterPriors
from estimation.kinematics import add_time_spread, signs_along
from estimation.measurement_model import HarmonicMotion, Motion, prediction
from estimation.measurement_model.motion import MotionColumns, NormalEquations, Rows, Samples
from estimation.processing import NoiseEstimate
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.terms.actuator_forces import BACK_EMF
from expdesign.robot import Robot, deviation

DELAY = np.array([[1.0, 1.0, 0.0]])
LOW_PASS = np.column_stack([*np.polynomial.laguerre.laggauss(4), [0.261, 0.589, 0.861, 1.0]])
"""(n, 3), x_k, w_k, and the standard deviation of x in the part of e^(−x) with this weight."""


def reduced_information(equations: Sequence[NormalEquations], priors: ParameterPriors) -> Array:
    """Return the information F_p of all experiments and the priors, (k, k)."""
    count = int(np.count_nonzero(priors.free))
    return priors.precision + sum(each.eliminate(count).matrix for each in equations)


def cramer_rao_covariance(
    robot: Robot,
    experiments: Sequence[Experiment],
    priors: ParameterPriors,
    values: Array,
    deviations: Sequence[deviation.Deviation] = (),
) -> Array:
    """Return the Cramér–Rao bound at (p, ξ) as a covariance, (m, m); zero for fixed parameters.

    Priors count as data. Estimated constants of terms are unknowns, too, and the given deviations
    with their tolerances as priors, both evaluated at the robot's values. The motions are those at
    which ML begins, with the exact friction signs if their rates have no spread, otherwise the
    expected ones.
    """
    unknown = priors.constants_and(deviations, robot)
    machine = PerturbedMachine.of(robot, unknown, np.zeros(len(unknown)))
    equations = [
        machine.joint_equations(each, each.fitted.motion, values, priors.free)
        for each in (experiment.for_estimator("ml") for experiment in experiments)
    ]
    known = priors.with_deviations(unknown)
    inverse = known.inverse(reduced_information(equations, known))
    count = int(np.count_nonzero(priors.free))
    return priors.expand(inverse[:count, :count])


class MeasuredForces(NamedTuple):
    """Predicted force measurements and their derivatives."""

    values: Array
    """(S, 6), N."""
    regressors: Array
    """(S, 6, m), ∂(measured forces)/∂p."""
    deviations: Array
    """(S, 6, t), ∂(measured forces)/∂θ."""
    slope: Array
    """(S, 6, 18), ∂(measured forces)/∂(λ, λ̇, λ̈)."""
    sampled: Samples

    def columns(self, free: NDArray[np.bool_]) -> MotionColumns:
        """Return the columns of the free parameters, θ and ξ."""
        others = self.regressors[:, :, free]
        if self.deviations.shape[2]:
            others = np.concatenate([others, self.deviations], axis=2)
        return MotionColumns(others, self.slope, self.sampled)


class _Lag(NamedTuple):
    """One delay in the mixture of a group of channels."""

    delay: float
    """s."""
    weights: Array
    """(6,), share of each channel with this delay."""
    columns: Array
    """(6, t), the same for the derivatives to θ: to a time constant they grow with the node."""
    spread: float
    """Standard deviation of the delays that this one represents, s."""


class MeasuredLengths(NamedTuple):
    """Predicted length measurements, (S, 6), m, with the columns of θ, (S, 6, t), and with ξ."""

    values: Array
    deviations: Array
    columns: MotionColumns


@dataclass(frozen=True, eq=False)
class PerturbedMachine:
    """Machine that deviates by θ from its description."""

    robot: Robot
    """Robot with changed joints, gravity and constants."""
    chosen: tuple[deviation.Deviation, ...]
    theta: Array
    """(t,), deviations of the chosen entries, SI."""

    @classmethod
    def exact(cls, robot: Robot) -> PerturbedMachine:
        """Build the machine as described."""
        return cls(robot, (), np.zeros(0))

    @classmethod
    def of(
        cls, robot: Robot, chosen: Sequence[deviation.Deviation], theta: Array
    ) -> PerturbedMachine:
        """Apply the deviations θ, (t,), to the robot."""
        changes_robot = any(
            value != 0 for one, value in zip(chosen, theta, strict=True) if one.of_the_machine
        )
        changed = deviation.apply_deviations(robot, chosen, theta) if changes_robot else robot
        return cls(changed, tuple(chosen), theta)

    def forces(
        self,
        experiment: Experiment,
        motion: Motion,
        values: Array,
        part: slice,
        *,
        jumps: bool = False,
    ) -> MeasuredForces:
        """Predict a part of an experiment's force samples at ξ and p, (m,).

        With `jumps`, the derivative to a delay includes the jumps of dry friction, averaged over
        the position of the samples: a single sample does not show when a sign changed. A channel
        with a separate lag keeps the columns of ξ at the common time.
        """
        predict = partial(self._forces_at, experiment, motion, values, part, jumps)
        common, lags = predict(self.delay, 0.0), list(self._lags("Q"))
        if [lag.delay for lag in lags] == [0.0]:
            return common
        values, regressors, deviations, slope = (0.0 * each for each in common[:4])
        for lag in lags:
            own = predict(self.delay + lag.delay, lag.spread) if lag.delay else common
            values = values + lag.weights * own.values
            regressors = regressors + lag.weights[:, None] * own.regressors
            deviations = deviations + lag.columns * own.deviations
            slope = slope + lag.weights[:, None] * own.slope
        return MeasuredForces(values, regressors, deviations, slope, common.sampled)

    def _lags(self, group: str) -> Iterator[_Lag]:
        """Yield the delays of which delays and low passes of forces or lengths are a mixture."""
        constants = self.low_passes(group)
        nodes, weights, spreads = (LOW_PASS if np.any(constants) else DELAY).T
        filtering = np.array(
            [one.group == deviation.LOW_PASSES[group] for one in self.chosen], dtype=bool
        )
        delays = self.channel_delays(group) + np.multiply.outer(nodes, constants)
        for delay in np.unique(delays).tolist():
            own = delays == delay
            share = weights[:, None] * own
            total = np.sum(share, axis=0)
            columns = np.where(filtering, (nodes @ share)[:, None], total[:, None])
            spread = float(np.max(own * np.multiply.outer(spreads, constants)))
            yield _Lag(delay, total, columns, spread)

    def _forces_at(
        self,
        experiment: Experiment,
        motion: Motion,
        values: Array,
        part: slice,
        jumps: bool,
        delay: float,
        spread_of_delay: float,
    ) -> MeasuredForces:
        """Predict force samples that all lag behind by a delay, s, with a standard deviation, s."""
        times = experiment.recording.forces.times[part]
        own, values = experiment.recording.own_clock, self.parameters(values)
        sampled = self._sample(motion, times - delay, own_clock=own)
        spread = experiment.fitted.spread[part]
        if spread_of_delay:
            spread = add_time_spread(self.robot, sampled, spread, spread_of_delay)
        signs = signs_along(self.robot, sampled, spread)
        if not self.chosen:
            kernel = prediction.force_kernel(self.robot.terms)
            regressors, slope = kernel(sampled.state(), signs, self.robot.machine, values)
            nothing = regressors[:, :, :0]
            return MeasuredForces(regressors @ values, regressors, nothing, slope, sampled)
        state = prediction.state_with_jerk(sampled)
        found = deviation.deviating_forces(
            self.robot, state, sampled.times, signs, values, self.chosen, own_clock=own
        )
        columns = found.columns
        if jumps:
            step = experiment.recording.step
            change = deviation.delay_of_jumps(self.robot, state, signs, values, step)
            deviation.add_jumps(columns, self.chosen, change)
        gains = self.gains[:, None]
        read = np.array([one.group.startswith("force_constant.") for one in self.chosen], bool)
        return MeasuredForces(
            found.forces * self.gains,
            found.regressors * gains,
            columns * np.where(read, self._motor_factors[0][:, None], gains),
            found.state_slope * gains,
            sampled,
        )

    def lengths(self, experiment: Experiment, motion: Motion, part: slice) -> MeasuredLengths:
        """Predict a part of an experiment's length samples at ξ."""
        times = experiment.recording.lengths.times[part]
        own = experiment.recording.own_clock
        sampled = self._sample(motion, times, own_clock=own)
        lengths, columns = prediction.length_columns(self.robot, sampled)
        if self.chosen:
            mixture, deviations = np.zeros_like(lengths), np.zeros((*lengths.shape, 1))
            for lag in self._lags("q"):
                late = sampled
                if lag.delay:
                    late = self._sample(motion, times - lag.delay, own_clock=own)
                mixture += lag.weights * self.robot.inverse_kinematics(late.pose())
                deviations = deviations + lag.columns * deviation.length_deviation_columns(
                    self.robot, late.state(), late.times, self.chosen, own_clock=own
                )
            lengths, columns = mixture, replace(columns, others=deviations)
        return MeasuredLengths(lengths + self.zeros, columns.others, columns)

    def joint_equations(
        self,
        experiment: Experiment,
        motion: Motion,
        values: Array,
        free: NDArray[np.bool_],
    ) -> NormalEquations:
        """Return the normal equations of the free parameters, θ and ξ, in this order."""
        noise = experiment.noise.forces
        forces = self.force_equations(experiment, motion, values, free, noise)
        return forces.with_motion(self.length_equations(experiment, motion))

    def length_equations(self, experiment: Experiment, motion: Motion) -> NormalEquations:
        """Return the normal equations of θ and ξ from the lengths alone."""
        lengths, noise = experiment.recording.lengths, experiment.noise.lengths

        def rows(part: slice) -> Rows:
            found = self.lengths(experiment, motion, part)
            return lengths.values[part] - found.values, found.columns, lengths.counts[part]

        parts = prediction.chunks(experiment.recording.samples)
        return NormalEquations.of(map(rows, parts), noise.covariance, noise.filter)

    def follow_lengths(
        self, experiment: Experiment, motion: Motion
    ) -> tuple[Experiment, Motion, Array]:
        """Return a motion with all harmonics, and the change of (θ, ξ) per unit of θ, (t + x, t).

        The experiment is that along this motion.
        A controller follows lengths. Harmonics that θ raises, and that the motion leaves out,
        therefore change the forces and not the lengths; those that it has are unknowns of the fit.
        """
        count, harmonics = len(self.chosen), experiment.harmonics
        moved: Array = np.zeros((motion.unknowns, count))
        if isinstance(motion, HarmonicMotion) and harmonics and harmonics > motion.harmonics:
            experiment, motion = experiment.for_estimator("ml"), motion.with_harmonics(harmonics)
            matrix = self.length_equations(experiment, motion).matrix
            moving = np.array([one.group in deviation.MOVING_GROUPS for one in self.chosen])
            change = -np.linalg.solve(matrix[count:, count:], matrix[count:, :count])
            moved = np.where(moving, change, np.zeros_like(change))
        return experiment, motion, np.concatenate([np.eye(count), moved])

    def force_equations(
        self,
        experiment: Experiment,
        motion: Motion,
        values: Array,
        free: NDArray[np.bool_],
        weights: NoiseEstimate,
    ) -> NormalEquations:
        """Return the normal equations of the same unknowns from the forces alone.

        The rows are weighted by a noise, `weights`, after its filter.
        """
        forces, counts = experiment.recording.forces, experiment.row_counts(weights)

        def rows(part: slice) -> Rows:
            found = self.forces(experiment, motion, values, part)
            return forces.values[part] - found.values, found.columns(free), counts[part]

        parts = prediction.chunks(experiment.recording.samples)
        return NormalEquations.of(map(rows, parts), weights.covariance, weights.filter)

    @property
    def delay(self) -> float:
        """Lag of the forces behind the lengths, s."""
        return self._one("delay")

    def channel_delays(self, group: str) -> Array:
        """Return the delays of single forces (group ``Q``) or lengths (``q``), (6,), s."""
        return self._per_actuator(deviation.CHANNEL_DELAYS[group])

    def low_passes(self, group: str) -> Array:
        """Return the time constants of the same channels, (6,), s."""
        return self._per_actuator(deviation.LOW_PASSES[group])

    @property
    def zeros(self) -> Array:
        """(6,), error of the measured lengths, positive if too long, m."""
        return self._per_actuator("strut_length")

    @property
    def gains(self) -> Array:
        """(6,), ratio of measured to true forces."""
        return (1.0 + self._shares("force_constant")) * self._motor_factors[0]

    @property
    def _motor_factors(self) -> Array:
        """(2, 6), factors of the forces of voltages, and of the damping in them."""
        effects = [
            np.outer(effect, self._shares(f"motor.{name}"))
            for name, effect in deviation.MOTOR_EFFECTS.items()
        ]
        return np.exp(np.sum(effects, axis=0))

    def parameters(self, values: Array) -> Array:
        """Return the parameters, (m,), with the true damping by the induced voltage."""
        if not self.robot.description.forces_of_voltages:
            return values
        names = self.robot.parameter_names
        own = [names.index(one.name) for one in BACK_EMF.parameters]
        changed = values.copy()
        changed[own] *= self._motor_factors[1]
        return changed

    def _shares(self, group: str) -> Array:
        """Return the sums of common and own errors of the actuators, (6,)."""
        return self._one(f"{group}.common") + self._per_actuator(f"{group}.each")

    def _one(self, group: str) -> float:
        found = zip(self.chosen, self.theta, strict=True)
        return float(sum(value for one, value in found if one.group == group))

    def _per_actuator(self, group: str) -> Array:
        """Return the entries of a group by the actuator number at the end of their names, (6,)."""
        result = np.zeros(ACTUATORS)
        for one, value in zip(self.chosen, self.theta, strict=True):
            if one.group == group:
                result[one.channel] += value
        return result

    def _sample(self, motion: Motion, times: Array, *, own_clock: bool) -> Samples:
        """Return the motion at the true times that belong to time stamps, s."""
        fast = self._one("clock")
        if own_clock and isinstance(motion, HarmonicMotion):
            return replace(motion, omega=motion.omega * (1 + fast)).at(times / (1 + fast))
        return motion.at(times * (1 - fast))
