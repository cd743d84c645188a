"""Motion of a machine whose controller follows strut lengths that belong to other joints.

A controller computes the lengths of a designed motion with the nominal joints. The machine has
others: its struts have exactly these lengths, and its platform moves along another path, with more
harmonics than the design. Without these harmonics an estimate of the joints would be too certain.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial

import numpy as np

from constraints.arrays import Array, ComplexArray
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.noise import lines_of, multiplicity
from expdesign.recheck.limit_check import Motion
from expdesign.robot import ForwardKinematicsError, Robot, deviation
from expdesign.trajectory import MOST_HARMONICS, FourierTrajectory, PoseSamples

_NEGLIGIBLE = 1.0
"""Expected χ² of the harmonics that are left out: less than what the noise adds to one parameter.
They are shared among tens of unknowns."""
_POINTS = 4 * MOST_HARMONICS
_DRAWS = 16
_NEGLIGIBLE_OF_DRAWN = 3.0
"""Number of drawn machines, and their mean χ² at most: so few scatter by more than 1."""
Noise = Array | Callable[[int], ComplexArray] | None
"""Covariance of one sample, (6, 6), or a function of the number of lines of coloured noise."""


def raised_harmonics(
    robot: Robot,
    motion: FourierTrajectory,
    length_noise: Noise,
    force_noise: Noise,
    samples: float,
    per_period: float,
) -> int:
    """Return the largest number of harmonics that machines within the tolerances move with.

    The controller follows the lengths of the robot as described. Higher harmonics have less effect
    on lengths and forces of all samples than the noise, for deviations of one standard deviation
    each. Near singular poses the motion is not linear in the deviations; some machines are
    therefore drawn, and their harmonics counted as well.

    Parameters
    ----------
    length_noise, force_noise : (6, 6), callable, or None
        Covariances of one sample, m² and N²; those of coloured noise at the multiples 0 … L − 1 of
        the motion's frequency, (L, 6, 6), as a function of L; None: unknown, and not counted.
    samples, per_period : float
        Number of samples in the recording, and in one period; harmonics above half of the latter
        are not counted.

    Returns
    -------
    int
        At least the harmonics of the motion, at most `MOST_HARMONICS`.
    """
    chosen = [
        one
        for one in deviation.toleranced_deviations(robot)
        if one.group in deviation.MOVING_GROUPS
    ]
    least = motion.harmonics
    if not chosen or least >= MOST_HARMONICS:
        return least
    times = np.arange(_POINTS) * motion.period / _POINTS
    state = np.concatenate([*motion.sample(times), np.zeros((_POINTS, COORDINATES))], axis=1)
    forces = deviation.deviating_forces(robot, state, times, None, robot.parameters, chosen)
    lengths = deviation.length_deviation_columns(robot, state, times, chosen)
    tolerances = np.array([each.tolerance for each in chosen])
    jacobian = robot.length_jacobian(state[:, :COORDINATES])
    drawn = _drawn_motions(robot, state[:, :COORDINATES], chosen)
    moves = (
        (np.linalg.solve(jacobian, lengths * tolerances), _NEGLIGIBLE),
        (drawn / np.sqrt(max(drawn.shape[-1], 1)), _NEGLIGIBLE_OF_DRAWN),
    )
    every = [(np.fft.rfft(poses, axis=0), most) for poses, most in moves]
    count = min(MOST_HARMONICS, int(per_period / 2)) + 1
    of_lengths, of_forces = (
        noise(count) if callable(noise) else noise for noise in (length_noise, force_noise)
    )

    def is_enough(harmonics: int, lines: ComplexArray, most: float) -> bool:
        orders = np.arange(len(lines))[:, None, None]
        left = np.where(orders > harmonics, lines, 0)
        derivatives = [
            np.fft.irfft(left * (1j * motion.omega * orders) ** order, _POINTS, axis=0)
            for order in range(3)
        ]
        shown = _mean_square(jacobian @ derivatives[0], of_lengths)
        shown += _mean_square(forces.state_slope @ np.concatenate(derivatives, axis=1), of_forces)
        return samples * shown <= most

    for lines, most in every:
        key = partial(is_enough, lines=lines, most=most)
        least = bisect_left(range(MOST_HARMONICS), True, lo=least, key=key)
    return least


def _drawn_motions(robot: Robot, poses: Array, chosen: Sequence[deviation.Deviation]) -> Array:
    """Return the moves of drawn machines, (S, 6, d), d ≤ 16: some cannot follow the lengths."""
    rng, found = np.random.default_rng(0), []
    tolerances = np.array([each.tolerance for each in chosen])
    lengths = robot.inverse_kinematics(poses)
    for values in tolerances * rng.standard_normal((_DRAWS, len(chosen))):
        machine = deviation.apply_deviations(robot, chosen, values)
        zeros = np.zeros(ACTUATORS)
        for one, value in zip(chosen, values, strict=True):
            if one.group == "strut_length":
                zeros[one.channel] = value
        with suppress(ForwardKinematicsError):
            found.append(machine.forward_kinematics(lengths - zeros, poses) - poses)
    return np.stack(found, axis=2) if found else np.zeros((*poses.shape, 0))


def _mean_square(values: Array, covariance: Array | ComplexArray | None) -> float:
    """Return the mean of the sum of χ² of series, (S, 6, t), over a period."""
    if covariance is None:
        return 0.0
    white = covariance.shape == (ACTUATORS, ACTUATORS)
    count = MOST_HARMONICS + 1 if white else len(covariance)
    lines, weights = lines_of(values)[:count], multiplicity(len(values))[:count, None, None]
    scaled = np.linalg.solve(np.linalg.cholesky(covariance), lines)
    return float(np.sum(weights * np.abs(scaled) ** 2)) / len(values)


def sampled_harmonics(per_period: float) -> int:
    """Return the largest number of harmonics that the samples of a period determine safely.

    Examples
    --------
    >>> sampled_harmonics(100)
    24
    """
    return int(per_period - 1) // 4


@dataclass(frozen=True, eq=False)
class FollowedLengths:
    """Motion of a machine whose struts have the lengths of a robot with other joints."""

    motion: Motion
    """Designed motion of the robot."""
    robot: Robot
    """As the controller describes it."""
    machine: Robot
    zeros: Array
    """(6,), excess of the measured lengths, m, by which the struts are too short."""

    def sample(self, times: Array) -> PoseSamples:
        """Return pose, rate and acceleration of the machine at times, s.

        Raises
        ------
        ForwardKinematicsError
            No pose of the machine has these lengths.
        """
        states = self.motion.sample(times)
        wanted = self.robot.strut_motion(*states)
        pose = self.machine.forward_kinematics(wanted.length - self.zeros, states.pose)
        jacobian = self.machine.length_jacobian(pose)

        def solved(rates: Array) -> Array:
            return np.asarray(np.linalg.solve(jacobian, rates[..., None])[..., 0], dtype=np.float64)

        rate = solved(wanted.length_rate)
        curved = self.machine.strut_motion(pose, rate, np.zeros_like(rate)).length_acceleration
        return PoseSamples(pose, rate, solved(wanted.length_acceleration - curved))
