"""Motion of a machine whose controller follows strut lengths that belong to other joints.

A controller computes the lengths of a designed motion with the nominal joints. The machine has
others: its struts have exactly these lengths, and its platform moves along another path, with more
harmonics than the design. Without these harmonics an estimate of the joints would be too certain.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array, ComplexArray
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.noise import lines_of, multiplicity
from expdesign.recheck.limit_check import Motion, states_at
from expdesign.robot import ForwardKinematicsError, Robot, deviation
from expdesign.trajectory import MOST_HARMONICS, FourierTrajectory, PoseSamples

_NEGLIGIBLE = 1.0
"""Expected χ² of the harmonics that are left out: less than what the noise adds to one parameter.
They are shared among tens of unknowns."""
_NEGLIGIBLE_OF_A_MACHINE = 3.0
"""The same for one machine: most machines within the tolerances show less."""
_MOST_OF_A_MACHINE = 2 * MOST_HARMONICS
"""Most harmonics of a single machine: few pass so near a singular pose."""
_POINTS = 4 * _MOST_OF_A_MACHINE
Noise = Array | Callable[[int], ComplexArray] | None


@dataclass(frozen=True)
class RecordedNoise:
    """Noise of a recording of a periodic motion.

    Covariances of one sample, (6, 6), m² and N²; those of coloured noise at the multiples 0 … L − 1
    of the motion's frequency, (L, 6, 6), as a function of L; None: unknown, and not counted.
    """

    lengths: Noise
    forces: Noise
    samples: float
    """In the recording."""
    per_period: float
    """Samples in a period: above half of their frequency coloured noise is unknown, and nothing is
    seen."""

    def fewest_harmonics(
        self,
        moves: Array,
        jacobian: Array,
        force_slope: Array,
        omega: float,
        allowed: range,
        negligible: float,
    ) -> int:
        """Return the harmonics of moves, (S, 6, t), above which the χ² of all samples is small."""
        lines = np.fft.rfft(moves, axis=0)
        orders = np.arange(len(lines))[:, None, None]
        of_lengths, of_forces = (
            self._mean_square(noise, len(moves)) for noise in (self.lengths, self.forces)
        )

        def is_enough(harmonics: int) -> bool:
            left = np.where(orders > harmonics, lines, 0)
            derivatives = [
                np.fft.irfft(left * (1j * omega * orders) ** order, len(moves), axis=0)
                for order in range(3)
            ]
            shown = of_lengths(jacobian @ derivatives[0])
            moved = of_forces(force_slope @ np.concatenate(derivatives, axis=1))
            return self.samples * (shown + moved) <= negligible

        return allowed.start + bisect_left(allowed, True, key=is_enough)

    def _mean_square(self, noise: Noise, size: int) -> Callable[[Array], float]:
        """Return a function for the mean sum of χ² of series over a period, (`size`, 6, t)."""
        if noise is None:
            return lambda _: 0.0
        known = int(self.per_period / 2) + 1 if callable(noise) else size
        weights = multiplicity(size)[:known]
        factor = np.linalg.cholesky(noise(len(weights)) if callable(noise) else noise)

        def mean_square(values: Array) -> float:
            scaled = np.linalg.solve(factor, lines_of(values)[: len(weights)])
            return float(np.sum(weights[:, None, None] * np.abs(scaled) ** 2)) / size

        return mean_square


def raised_harmonics(robot: Robot, motion: FourierTrajectory, recorded: RecordedNoise) -> int:
    """Return the largest number of harmonics that machines within the tolerances move with.

    The controller follows the lengths of the robot as described. Higher harmonics have less effect
    on lengths and forces of all samples than the noise, for deviations of one standard deviation
    each. A single machine can have more, above all near singular poses, where its motion is not
    linear in the deviations: see `followed_harmonics`.

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
    times = motion.sample_times(_POINTS)
    state = np.pad(states_at(motion, times), ((0, 0), (0, COORDINATES)))
    forces = deviation.deviating_forces(robot, state, times, None, robot.parameters, chosen)
    lengths = deviation.length_deviation_columns(robot, state, times, chosen)
    tolerances = np.array([each.tolerance for each in chosen])
    jacobian = robot.length_jacobian(state[:, :COORDINATES])
    moves = np.linalg.solve(jacobian, lengths * tolerances)
    slopes = jacobian, forces.state_slope, motion.omega
    return recorded.fewest_harmonics(moves, *slopes, range(least, MOST_HARMONICS), _NEGLIGIBLE)


def followed_harmonics(
    followed: FollowedLengths, omega: float, parameters: Array, recorded: RecordedNoise, least: int
) -> int:
    """Return the number of harmonics of the motion of one machine, with its parameters, (m,).

    Harmonics above this number would show by less than the noise. It is at least `least`, and at
    most a third of the samples of a period: the highest ones are small, and their products with
    the others stay below half of the sampling frequency. It is the most for a machine that has no
    pose with the lengths of the motion: singular poses are near.
    """
    allowed = range(least, min(int(recorded.per_period - 1) // 3, _MOST_OF_A_MACHINE))
    times = np.arange(_POINTS) * 2 * np.pi / omega / _POINTS
    machine = followed.machine
    try:
        state = np.pad(states_at(followed, times), ((0, 0), (0, COORDINATES)))
    except ForwardKinematicsError:
        return max(least, allowed.stop)
    forces = deviation.deviating_forces(machine, state, times, None, parameters, ())
    poses = state[:, :COORDINATES]
    slopes = machine.length_jacobian(poses), forces.state_slope, omega
    return recorded.fewest_harmonics(poses[:, :, None], *slopes, allowed, _NEGLIGIBLE_OF_A_MACHINE)


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
        rates = wanted.length_rate, wanted.length_acceleration
        return PoseSamples(pose, *self.machine.pose_motion(pose, *rates))
