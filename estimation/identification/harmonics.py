"""Number of harmonics of the executed motion, from lengths and forces together.

Accelerations weight harmonic k with k²: the forces show harmonics below the noise of the lengths,
and a motion without them biases the parameters. All numbers of harmonics are judged at once, on the
joint normal equations of (p, ξ) with the most harmonics allowed: the Cholesky factor of ξ's part,
its unknowns in the order of the harmonics, contains the least cost of every shorter series. A
harmonic is twelve unknowns; the chosen number has the least cost plus two for each unknown
(Akaike). By chance it is exceeded in a few of a hundred recordings, which costs next to nothing,
and many weak harmonics are found together. A single strong harmonic far above the others does not
pay for those between: its reduction of the cost is tested separately.

Forces may lack another effect, such as cogging, which harmonics would imitate. If the lengths
contradict the further harmonics of the forces, these are not a motion.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
import scipy.linalg as sla
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.significance import ratio_tail
from estimation.estimators import Experiment, ParameterPriors
from estimation.estimators.experiment import MotionEstimate
from estimation.estimators.joint_equations import PerturbedMachine
from estimation.estimators.prior_estimate import invert_covariance
from estimation.kinematics import length_equations, most_harmonics
from estimation.measurement_model import HarmonicMotion, Motion
from estimation.measurement_model.motion import NormalEquations, root_of_pseudo_inverse
from estimation.processing import NoiseEstimate, NoiseModel, PeriodicRecording
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.recheck import followed_lengths
from expdesign.robot import Robot
from expdesign.trajectory import HARMONIC_LEVEL

_PER_UNKNOWN = 2.0
"""Reduction of the cost that an unknown must give (Akaike)."""

_CONTRADICTED = 1e-3
"""Level of the test whether the lengths contradict further harmonics."""

_UNKNOWNS = 2 * COORDINATES
"""Unknowns of a harmonic."""

_DETERMINED = 1e-10
"""Smallest relevant eigenvalue of the scaled information on the parameters."""


def refine_motion(
    robot: Robot, experiment: Experiment, priors: ParameterPriors
) -> MotionEstimate | None:
    """Return the motion supported by forces and lengths together; None for the fitted one.

    The experiment's motion was fitted to the lengths; the refined one has more harmonics.
    """
    fitted, recording = experiment.fitted.motion, experiment.recording
    if not isinstance(fitted, HarmonicMotion):
        raise TypeError("a motion without a period has no harmonics")
    least, most = fitted.harmonics, most_harmonics(recording)
    if least >= most:
        return None
    values = _first_estimate(experiment, priors)
    motion = fitted.with_harmonics(most)
    noise, exact = experiment.noise, PerturbedMachine.exact(robot)
    forces = exact.force_equations(experiment, motion, values, priors.free, noise.forces)
    lengths = length_equations(robot, recording, noise.lengths, motion)
    joint = forces.with_motion(lengths) + priors.equations(values)
    series = _Series(least, motion, priors, joint, lengths)
    wanted = series.choose_number()
    if wanted == least or series.lengths_contradict(wanted):
        return None
    return MotionEstimate.of(robot, recording, *series.motion_with(wanted))


def weigh_signs(robot: Robot, experiment: Experiment, priors: ParameterPriors) -> Experiment:
    """Return the experiment with less weight of samples with uncertain signs of friction."""
    return experiment.with_sign_variance(robot, _first_estimate(experiment, priors))


def with_raised_harmonics(
    robot: Robot, experiment: Experiment, values: Array, machine: PerturbedMachine, motion: Motion
) -> Experiment:
    """Return the experiment with the harmonics that the estimated machine raises.

    A machine that passes near a singular pose raises more than the tolerances do on average. The
    experiment is returned unchanged if its motion has all of them. The estimate is given by its
    parameters, (m,), the machine with its deviations, and its motion.
    """
    linear, recording, noise = experiment.linear_motion, experiment.recording, experiment.noise
    if linear is None or not isinstance(motion, HarmonicMotion):
        return experiment
    designed = replace(motion, table=linear.motion.table).trajectory
    followed = followed_lengths.FollowedLengths(designed, robot, machine.robot, machine.zeros)
    least, recorded = motion.harmonics, recorded_noise(recording, noise)
    wanted = followed_lengths.followed_harmonics(followed, motion.omega, values, recorded, least)
    if wanted == least:
        return experiment
    motion, own = motion.with_harmonics(wanted), machine.robot
    there = length_equations(own, recording, noise.lengths, motion)
    refined = MotionEstimate.of(own, recording, motion, invert_covariance(there.matrix))
    return replace(experiment, refined_motion=refined).with_sign_variance(own, values)


def recorded_noise(
    recording: PeriodicRecording, noise: NoiseModel
) -> followed_lengths.RecordedNoise:
    """Return the noise of a recording at the multiples of its motion's frequency."""
    per_period = recording.period / recording.step

    def of_lines(own: NoiseEstimate) -> followed_lengths.Noise:
        found = own.filter
        if found is None:
            return own.covariance
        every = found.samples / per_period
        return lambda count: found.spectrum[np.rint(np.arange(count) * every).astype(np.intp)]

    lengths, forces = of_lines(noise.lengths), of_lines(noise.forces)
    return followed_lengths.RecordedNoise(lengths, forces, recording.rows, per_period)


def _first_estimate(experiment: Experiment, priors: ParameterPriors) -> Array:
    """Return Gauss–Markov parameters, (m,), of minimum norm if there are several solutions."""
    free, start = priors.free, priors.start
    fitted = experiment.linear_equations(start, free, experiment.noise.forces)
    fitted = fitted + priors.equations(start)
    values = start.copy()
    values[free] += _solve(fitted.matrix, fitted.gradient)
    return values


def _solve(information: Array, gradient: Array) -> Array:
    """Return F⁺ g, g (k,) or (k, n): zero in directions that the data do not determine."""
    root = root_of_pseudo_inverse(information, _DETERMINED)
    return root @ (root.T @ gradient)


@dataclass(frozen=True, eq=False)
class _Series:
    """Joint normal equations with the most harmonics, for the choice of fewer."""

    least: int
    motion: HarmonicMotion
    """Where they were taken."""
    priors: ParameterPriors
    joint: NormalEquations
    lengths: NormalEquations
    """Of (p, ξ) from forces, lengths and prior, and of ξ from the lengths alone."""

    def choose_number(self) -> int:
        """Return the number of harmonics that forces and lengths support together."""
        places = _places(self.motion, self.motion.harmonics)
        count = int(np.count_nonzero(self.priors.free))
        order = np.concatenate([count + places, np.arange(count)])
        size = len(places)
        ordered = self.joint.select(order)
        matrix, gradient = ordered.matrix, ordered.gradient
        scale = np.sqrt(np.diag(matrix)[:size])
        inner = matrix[:size, :size] / np.multiply.outer(scale, scale)
        right = np.column_stack([matrix[:size, size:], gradient[:size]]) / scale[:, None]
        solved = sla.solve_triangular(np.linalg.cholesky(inner), right, lower=True)
        slope, offset = solved[:, :-1], solved[:, -1]
        reductions = []
        for harmonics in range(self.least, self.motion.harmonics + 1):
            n = len(_places(self.motion, harmonics))
            information = matrix[size:, size:] - slope[:n].T @ slope[:n]
            rest = gradient[size:] - slope[:n].T @ offset[:n]
            reductions.append(offset[:n] @ offset[:n] + rest @ _solve(information, rest))
        gains = np.diff(reductions)
        if not len(gains):
            return self.least
        cheapest = int(np.argmin(np.cumsum(np.append(0.0, _PER_UNKNOWN * _UNKNOWNS - gains))))
        single = scipy.stats.chi2.sf(gains, _UNKNOWNS) < HARMONIC_LEVEL / len(gains)
        return self.least + max([cheapest, *(np.flatnonzero(single) + 1).tolist()])

    def lengths_contradict(self, harmonics: int) -> bool:
        """Test whether the lengths contradict the further harmonics of the forces.

        The covariance of the difference between the estimates from forces and lengths and from the
        lengths alone is the difference of both covariances (Hausman, Econometrica 46, 1978).
        """
        places = _places(self.motion, harmonics)
        new = slice(len(_places(self.motion, self.least)), None)
        alone, covariance = _solve_motion(self.lengths.select(places))
        together, smaller = self._together(places)
        white = np.linalg.cholesky(covariance[new, new])
        off = sla.solve_triangular(white, (together - alone)[new], lower=True)
        half = sla.solve_triangular(white, smaller[new, new], lower=True)
        share = sla.solve_triangular(white, half.T, lower=True)
        weights = np.maximum(1 - np.linalg.eigvalsh(share), 0.0)
        return ratio_tail(float(off @ off), weights, np.inf) < _CONTRADICTED

    def motion_with(self, harmonics: int) -> tuple[HarmonicMotion, Array]:
        """Return the motion from forces and lengths together, and Cov(ξ), (x, x)."""
        places = _places(self.motion, harmonics)
        step, covariance = self._together(places)
        moved = np.zeros(self.motion.unknowns)
        moved[places] = step
        motion = self.motion.add_step(moved).with_harmonics(harmonics)
        own = np.argsort(_places(motion, harmonics))
        return motion, covariance[np.ix_(own, own)]

    def _together(self, places: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return the step of some unknowns of ξ, and their covariance, with p eliminated."""
        count = int(np.count_nonzero(self.priors.free))
        cross = self.joint.matrix[count + places, :count]
        right = np.column_stack([cross.T, self.joint.gradient[:count]])
        explained = cross @ _solve(self.joint.matrix[:count, :count], right)
        own = self.joint.select(count + places)
        rest = NormalEquations(0.0, -explained[:, :-1], -explained[:, -1])
        return _solve_motion(own + rest)


def _solve_motion(equations: NormalEquations) -> tuple[Array, Array]:
    """Return N⁻¹ g and N⁻¹."""
    inverse = invert_covariance(equations.matrix)
    return inverse @ equations.gradient, inverse


def _places(motion: HarmonicMotion, harmonics: int) -> NDArray[np.intp]:
    """Return the places of the first harmonics in ξ, (6 (2 H + 1),).

    The frequency, when it is one of them, comes first; then centre and harmonics in turn.
    """
    most = motion.harmonics
    table = np.arange(motion.table.size).reshape(COORDINATES, 2 * most + 1)
    free = [np.array([motion.table.size])] if motion.free_frequency else []
    parts = [np.concatenate([table[:, k], table[:, most + k]]) for k in range(1, harmonics + 1)]
    return np.concatenate([*free, table[:, 0], *parts])
