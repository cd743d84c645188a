"""Model of a recording along alternative wirings and lags of its channels.

All wirings of the forces are fitted at once; lengths move the regressor and are tried one after the
other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from constraints.arrays import Array, ComplexArray, Mask
from estimation.channels.readings import readings_of, thin_rows
from estimation.channels.wiring import (
    DETERMINED,
    ORDERS,
    OTHER_GAIN,
    PAIRS_OF_ORDERS,
    SPREADS,
    STRUTS,
    UNITS,
    Candidate,
    ChannelLag,
    ForceFit,
    Wiring,
    round_factor,
)
from estimation.kinematics import signs_about
from estimation.measurement_model import Motion
from estimation.measurement_model.prediction import held_regressor_kernel
from estimation.processing import NoiseModel, PeriodicRecording
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.terms.rigid_platform import MASS
from expdesign.robot import Robot
from expdesign.trajectory import FourierTrajectory, PhaseBasis

_FORCE_ROWS = 1000
"""Largest number of rows of the forces in use: means over periods, or single samples."""
_ROWS_TOGETHER = 4000
"""Rows of delays that are evaluated at once; more need memory beyond the processor's cache."""
_STEPS = 12
_DAMPING = 1e-9
_REACHED = 1e-6
"""m. Last Newton step: the error after it is of the order of its square over a metre."""
_LARGEST_STEP = 0.3
"""Largest step of a pose, in units of the characteristic length."""
_REGULAR = 0.2
"""Least determinant of the Jacobian of a regular pose, relative to that at home."""
_SHORTEST, _LONGEST = 0.5, 2.0
"""Possible lengths of a strut, relative to that at home."""
_MOST_STRUTS = 4
LEAST = 40.0
"""Least decrease of the sum of squares, in variances; by chance it has a probability of 1e-10."""
MUCH_BETTER = 4.0
"""Ratio of unexplained forces from which on another wiring is preferred to a simpler one."""
_EQUAL = 1e-3
"""Unexplained share, in addition; another order or sign leaves 4 % or more."""
OF_LAG = 0.5
"""Least decrease by a lag of the channels as measured, relative to that by any of all wirings."""
_LOW_PASS = np.polynomial.laguerre.laggauss(16)
"""Delays of a low pass over its time constant, and their shares."""
_ALIKE = 0.1
_FURTHER = 3
"""Harmonics of lengths, in addition to those of the motion."""
_PHASES = 240
_UNLIKE = 0.1
"""Largest sum of 1 − correlation of the six lengths with those of a design that was executed."""
_CLEARLY = 8.0
MOST_SHIFTED = 2
_TINY_LAG = 1e-9
_UNCORRELATED = 0.05
_MOST_NOISE, _SHORT = 0.1, 0.25
"""Largest unexplained share of the forces' variation that may be noise, and the largest ratio of
its memory to that of the forces."""
_CLEAR_WORK = 10.0
"""Work of the actuators over a period that is not noise, in standard deviations."""


class ChannelModel:
    """Rows of a recording, and the model along alternative lengths and delays.

    Attributes
    ----------
    least_decrease : float
        Least decrease of the unexplained share that noise does not cause.
    possible : bool
        Whether the lengths of most struts are possible in any unit.
    spread : float
        Standard deviation of the unexplained share due to noise.

    Parameters
    ----------
    harmonics : int or None
        Harmonics of the motion; None: it has no period.
    zeros : (6,)
        Lengths of the struts at readings of zero, m. Signs and scales act on the readings.
    least_zeros : (6,)
        Smallest error of a length's zero that is a fault, m.
    least_delay : float
        Smallest delay that is a fault, s.
    """

    def __init__(
        self,
        robot: Robot,
        recording: PeriodicRecording,
        noise: NoiseModel,
        harmonics: int | None,
        zeros: Array,
        least_zeros: Array,
        least_delay: float,
    ) -> None:
        self.robot, self.omega, self.step = robot, recording.omega, recording.step
        self.zeros, self.least_zeros, self.least_delay = zeros, least_zeros, least_delay
        self._filtered = recording.forces.response is not None
        self._measured = readings_of(recording, harmonics)
        self.readings = self._measured.values - zeros
        found = self._find_unit()
        self.unit, self.possible = found or 1.0, found is not None
        coloured, variances = noise.forces.filter, np.diag(noise.forces.covariance)
        self._density: Array | None = None
        rows = _FORCE_ROWS
        if coloured is not None and coloured.samples == len(recording.forces.values):
            # One filter for all channels, as any of them may belong to any strut.
            spectrum = np.diagonal(coloured.spectrum, axis1=1, axis2=2).real
            self._density, rows = np.mean(spectrum, axis=1), coloured.samples
            variances = np.mean(spectrum / self._density[:, None], axis=0)
        used = self._measured.used_forces(recording.forces.times)
        self.force_times, forces, counts = thin_rows(recording.forces, rows, used)
        self._measured_forces, self.forces = forces, self.whiten(forces)
        self._work_noise = float(
            np.sqrt(np.max(np.diag(noise.forces.covariance)) / np.mean(counts))
        )
        self._set_noise(variances * float(np.sum(1 / counts)))
        self._scale = np.repeat([1.0, 1 / robot.characteristic_length], COORDINATES // 2)
        self.period = recording.period
        self._motions: dict[Wiring, Motion] = {}

    def _set_noise(self, variances: Array, repeated: float = 1.0) -> None:
        """Set the sums of squares of the noise, (6,), and how many samples hold as much as one."""
        self._variances = variances
        self._share = float(np.sum(variances) / np.sum(self.forces**2))
        values = self.forces.size / repeated
        self.least_decrease = LEAST * self._share / values
        self.spread = self._share * float(np.sqrt(2 / values))
        self._last_fit: tuple[tuple[Motion, float, float], ForceFit] | None = None

    def take_rest_as_noise(self, found: Candidate) -> bool:
        """Take the unexplained forces of a candidate as noise, with its memory, if they may be.

        They must be a small part of the forces' variation, and correlated over a time that is short
        against that of the forces: an error of the model follows the motion.
        """
        fit = self.fit(self.motion(found.lengths), found.delay, found.low_pass or 0.0)
        rest, forces = self.residuals(found, fit), found.forces.apply(self.forces)
        small = np.sum(np.var(rest, axis=0)) < _MOST_NOISE * np.sum(np.var(forces, axis=0))
        memory = _correlated_samples(rest)
        if not small or memory > _SHORT * _correlated_samples(forces):
            return False
        variances = np.empty(ACTUATORS)
        variances[found.forces.channels] = np.sum((rest / found.forces.gains) ** 2, axis=0)
        self._work_noise = float(np.sqrt(memory * np.max(variances) / len(rest)))
        self._set_noise(variances, memory)
        return True

    def _find_unit(self) -> float | None:
        """Return the unit of the lengths, relative to that stated, with which most are possible."""
        home = self.robot.inverse_kinematics(self.robot.home)
        ends = np.quantile(self.readings, (0.05, 0.95), axis=0)
        for unit in UNITS:
            fits = np.zeros(ACTUATORS, dtype=bool)
            for sign in (1, -1):
                lengths = (self.zeros + sign * unit * ends) / home
                fits |= np.all((lengths > _SHORTEST) & (lengths < _LONGEST), axis=0)
            if np.count_nonzero(fits) >= _MOST_STRUTS:
                return unit
        return None

    def motion(
        self,
        lengths: Wiring,
        near: Motion | None = None,
        lag: ChannelLag | None = None,
    ) -> Motion:
        """Return the motion with the readings nearest to the measured lengths.

        Damped Newton steps, one row at a time, from a near motion or from home; lengths that no
        pose has end at a near one. With the lag of one of the lengths, its readings are those of
        a later instant. One from home is computed once.
        """
        if near is not None or lag is not None:
            return self._solve_motion(lengths, near, lag)
        if lengths not in self._motions:
            self._motions[lengths] = self._solve_motion(lengths, None, None)
        return self._motions[lengths]

    def regular_motion(self, lengths: Wiring) -> Motion | None:
        """Return the motion with the readings if it is far from singular poses, otherwise None.

        Poses of wrong zeros may be on the other side of a singular one: those of other zeros are
        then found from home.
        """
        motion = self.motion(lengths)
        poses = np.vstack([self.robot.home, motion.at(self._measured.times).pose()])
        volumes = np.linalg.det(self.robot.lengths_and_jacobian(poses)[1])
        return motion if np.all(volumes / volumes[0] > _REGULAR) else None

    def _solve_motion(self, lengths: Wiring, near: Motion | None, lag: ChannelLag | None) -> Motion:
        wanted = lengths.apply(self.readings) + self.zeros
        if lag is not None and lag.group == "q":
            changes = self._measured.change(int(lengths.channels[lag.strut]), lag.seconds)
            wanted[:, lag.strut] += lengths.gains[lag.strut] * changes
        home = np.broadcast_to(self.robot.home, wanted.shape)
        poses = (home if near is None else near.at(self._measured.times).pose()).copy()
        largest = _LARGEST_STEP * self.robot.characteristic_length
        rows = np.arange(len(wanted))  # that have not converged: mostly few
        for _ in range(_STEPS):
            found, jacobian = self.robot.lengths_and_jacobian(poses[rows])
            slopes = jacobian * self._scale
            turned = slopes.transpose(0, 2, 1)
            matrix = turned @ slopes + _DAMPING * np.eye(COORDINATES)
            step = np.linalg.solve(matrix, turned @ (wanted[rows] - found)[:, :, None])[:, :, 0]
            size = np.linalg.norm(step, axis=1, keepdims=True)
            step *= np.minimum(1, largest / np.maximum(size, 1e-300))
            poses[rows] += self._scale * step
            rows = rows[~(size[:, 0] < _REACHED)]
            if not len(rows):
                break
        return self._measured.fit_motion(poses)

    def columns(self, motion: Motion, delay: float = 0.0, low_pass: float = 0.0) -> Array:
        """Return A, (R, 6, m), for forces behind a delay and a low pass, s.

        Behind a lag the jumps of dry friction are spread over a step. Sharp ones would give the sum
        of squares a minimum wherever a sample passes a jump, and the deepest fits the noise; behind
        a filter samples do not show such jumps either.
        """
        if not (delay or low_pass or self._filtered):
            state = np.split(motion.at(self.force_times).state(), 3, axis=1)
            return self.whiten(self.robot.regressor(*state))
        nodes, weights = _LOW_PASS if low_pass else (np.zeros(1), np.ones(1))
        times = self._measured.hold(self.force_times - delay - low_pass * nodes[:, None])
        kernel, std = held_regressor_kernel(self.robot.terms), self.step / float(np.sqrt(12))
        pieces = min(len(nodes), -(-times.size // _ROWS_TOGETHER))
        found = np.zeros(())
        for late, shares in zip(
            np.array_split(times, pieces), np.array_split(weights, pieces), strict=True
        ):
            sampled = motion.at(late.ravel())
            signs = signs_about(self.robot, sampled, std)
            columns = kernel(sampled.state(), signs, self.robot.machine)[0]
            by_delay = columns.reshape(*late.shape, *columns.shape[1:])
            found = found + np.tensordot(shares, by_delay, axes=1)
        return self.whiten(found)

    def whiten(self, rows: Array) -> Array:
        """Return forces (R, 6), or columns (R, 6, m), over the spectrum of coloured noise."""
        if self._density is None:
            return rows
        scale = np.sqrt(self._density).reshape(-1, *(1,) * (rows.ndim - 1))
        return np.fft.irfft(np.fft.rfft(rows, axis=0) / scale, len(rows), axis=0)

    def fit(self, motion: Motion, delay: float = 0.0, low_pass: float = 0.0) -> ForceFit:
        """Return the fits of the forces along a motion, behind a delay and a low pass, s.

        The last ones are kept.
        """
        at = motion, delay, low_pass
        if self._last_fit is None or self._last_fit[0] != at:
            self._last_fit = at, self.fit_columns(self.columns(*at))
        return self._last_fit[1]

    def fit_columns(self, columns: Array) -> ForceFit:
        """Return the fits of the forces by columns, (R, 6, m)."""
        return ForceFit(columns, self.forces, self._variances)

    def candidate_as_measured(self) -> Candidate:
        """Return the wiring of the recording as it was read, with its unexplained forces.

        Forces with all signs reversed explain nothing.
        """
        measured = Candidate.as_measured()
        motion = self.motion(measured.lengths)
        fit = self.fit(motion)
        if self._orient(measured.forces, fit, motion, 0.0) is not measured.forces:
            return measured
        return replace(measured, excess=fit.excess(measured.forces))

    def candidate(self, lengths: Wiring, delay: float) -> Candidate:
        """Return the best wiring of the forces for given lengths and delay."""
        motion = self.motion(lengths)
        fit = self.fit(motion, delay)
        forces, other = Wiring.as_measured(), fit.best()
        if self.is_better(fit.excess(other), fit.excess(forces)):
            forces = other
        next_best = fit.next_best(forces)
        scaled, next_scaled = fit.best_with_scales()
        if self.is_better(fit.excess(scaled), fit.excess(forces)):
            forces, next_best = scaled, min(fit.excess(forces), next_scaled)
        excess = fit.excess(forces)
        forces = self._orient(forces, fit, motion, delay)
        return Candidate(lengths, forces, delay, excess, next_best)

    def _orient(self, forces: Wiring, fit: ForceFit, motion: Motion, delay: float) -> Wiring:
        """Return the wiring of the forces, with all signs reversed if physics demands it.

        A fit with free parameters does not depend on this sign. The mass must be positive, and over
        a period, mostly also without one, the actuators must do the work of friction. If the two
        disagree, or the work is within the noise, fewer reversed signs are preferred.
        """
        names = self.robot.parameter_names
        mass = float(fit.parameters(forces)[names.index(MASS)]) if MASS in names else 0.0
        state = np.split(
            motion.at(self._measured.hold(self.force_times - delay)).state(), 3, axis=1
        )
        rates = self.robot.strut_motion(*state).length_rate
        own = forces.apply(self._measured_forces)
        work = float(np.sum(own * rates))
        noise = (
            self._work_noise * float(np.linalg.norm(rates)) * float(np.max(np.abs(forces.gains)))
        )
        clear = work * mass > 0 and abs(work) > _CLEAR_WORK * noise
        sign = work if clear else float(np.sum(np.sign(forces.gains)))
        return forces if sign >= 0 else replace(forces, gains=-forces.gains)

    def is_better(self, excess: float, other: float) -> bool:
        """Return whether a wiring is preferred to a simpler one, by their unexplained shares."""
        least = max(self.least_decrease, _EQUAL, (MUCH_BETTER - 1) * self.left(excess))
        return other - excess > least

    def differs(self, one: Candidate, other: Candidate) -> bool:
        """Return whether order, sign, scale or zero of a channel differ."""
        pairs = ((one.lengths, other.lengths), (one.forces, other.forces))
        return any(
            np.any(a.channels != b.channels) or not np.allclose(a.gains, b.gains, rtol=_ALIKE)
            for a, b in pairs
        ) or bool(np.any(np.abs(one.lengths.offsets - other.lengths.offsets) > self.least_zeros))

    def least(self, found: Candidate) -> float:
        """Return the least decrease of the unexplained share by a wiring.

        It is smaller if nothing but a delay differs: this is one trial, not thousands.
        """
        as_measured = not self.differs(found, Candidate.as_measured())
        return OF_LAG * self.least_decrease if found.delay and as_measured else self.least_decrease

    def left(self, excess: float) -> float:
        """Return the part of an unexplained share that is not noise."""
        return max(excess - SPREADS * self.spread, 0.0)

    def variance_of(self, found: Candidate) -> float:
        """Return the variance of one degree of freedom in the unexplained share.

        Unexplained forces count as noise.
        """
        return max(1 + found.excess / self._share, 1.0) * self.least_decrease / LEAST

    def explained_variation(self, candidate: Candidate) -> tuple[float, float]:
        """Return the shares of the forces' variation that are explained, and that are noise."""
        wiring = candidate.forces
        forces = wiring.apply(self.forces)
        variation = float(np.sum((forces - np.mean(forces, axis=0)) ** 2))
        noise = float(self._variances[wiring.channels] @ wiring.gains**2)
        left = candidate.excess * float(np.sum(forces**2)) + noise
        return float(np.clip(1 - left / variation, 0, 1)), min(noise / variation, 1.0)

    def nominal_scale(self, candidate: Candidate) -> tuple[float, float]:
        """Return the factor of the explained forces over those of the nominal parameters.

        And the square of the cosine between both: whether they differ by a factor at all.
        """
        motion = self.motion(candidate.lengths)
        fit = self.fit(motion, candidate.delay, candidate.low_pass or 0.0)
        explained = fit.columns @ fit.parameters(candidate.forces)
        nominal = fit.columns @ self.robot.parameters
        own, both = float(np.sum(nominal**2)), float(np.sum(explained * nominal))
        return both / own, both**2 / own / float(np.sum(explained**2))

    def gain_errors(self, found: Candidate) -> Array:
        """Return the relative standard deviations of the gains of the forces, (6,)."""
        fit = self.fit(self.motion(found.lengths), found.delay, found.low_pass or 0.0)
        return fit.fit_gains(found.forces)[1]

    def effect_of_lag(self, present: Candidate, late: float) -> Array:
        """Return the change, (R, 6), of forces by a further lag, s, that no parameter explains."""
        motion, low_pass = self.motion(present.lengths), present.low_pass or 0.0
        # A tiny lag, as the jumps of dry friction are spread behind any.
        now = self.fit(motion, present.delay + _TINY_LAG, low_pass)
        later = self.columns(motion, present.delay + late, low_pass)
        effect = (later - now.columns) @ now.parameters(present.forces)
        own = np.einsum("rim,ri->m", now.columns, effect) @ now.root
        return np.asarray(effect - now.columns @ (now.root @ own), np.float64)

    def residuals(self, present: Candidate, fit: ForceFit) -> Array:
        """Return the forces that a fit does not explain with a wiring, (R, 6)."""
        explained = fit.columns @ fit.parameters(present.forces)
        return np.asarray(present.forces.apply(self.forces) - explained, np.float64)

    def share(self, forces: Array) -> float:
        """Return the energy of forces, (R, 6), relative to that of those measured."""
        return float(np.sum(forces**2) / np.sum(self.forces**2))

    def largest_share(self, shapes: Array, rest: Array, fit: ForceFit) -> float:
        """Return the largest share of the forces that one of some shapes, (R, 6, n), explains.

        It is the share in the `rest`, (R, 6), in addition to the columns of a fit.
        """
        columns = fit.columns
        own = np.einsum("rim,rin->nm", columns, shapes, optimize=True) @ fit.root
        energies = np.einsum("rin,rin->n", shapes, shapes)
        left = energies - np.sum(own**2, axis=1)
        seen = left > DETERMINED * energies
        explained = np.einsum("rin,ri->n", shapes, rest)[seen] ** 2 / left[seen]
        return float(np.max(explained, initial=0.0)) / float(np.sum(self.forces**2))

    def wiring_of_design(self, design: FourierTrajectory) -> tuple[Wiring, Array] | None:
        """Return the wiring that gives the lengths of the designed motion, begun at any time.

        With the mean differences of its lengths from those of the design, (6,), m. None if the
        machine does not execute it, or if several wirings give these lengths.
        """
        harmonics = design.harmonics + _FURTHER
        if len(self.readings) <= 2 * harmonics + 1:
            return None
        phases = 2 * np.pi * np.arange(_PHASES) / _PHASES
        planned = self.robot.inverse_kinematics(design.sample(phases / design.omega).pose)
        middle, wanted = _series(phases, planned, harmonics)
        mean, found = _series(self.omega * self._measured.times, self.readings, harmonics)
        turns = np.exp(1j * np.outer(phases, np.arange(1, harmonics + 1)))
        sizes = np.linalg.norm(wanted, axis=0)[:, None] * np.linalg.norm(found, axis=0)
        products = np.einsum("tk,ki,kj->tij", turns, wanted.conj(), found, optimize=True).real
        alike = products / sizes
        unlike = ACTUATORS - np.abs(alike).reshape(_PHASES, -1) @ PAIRS_OF_ORDERS
        time, order = np.unravel_index(int(np.argmin(unlike)), unlike.shape)
        turned = np.sign(alike[:, STRUTS, ORDERS[order]])
        signs, best = turned[time], float(unlike[time, order])
        same = np.zeros(unlike.shape, dtype=bool)
        same[:, order] = np.all(turned == signs, axis=1)
        if best > _UNLIKE or float(np.min(unlike[~same])) < _CLEARLY * best:
            return None
        channels = ORDERS[order]
        energies = np.sum(np.abs(found) ** 2, axis=0)[channels]
        gains = products[time, STRUTS, channels] / energies
        sizes = np.abs(gains) / self.unit
        far = np.abs(np.log(sizes)) > np.log(OTHER_GAIN)
        gains = self.unit * signs * np.where(far, round_factor(sizes), 1.0)
        offsets = middle - self.zeros - gains * mean[channels]
        shifted = np.abs(offsets) > self.least_zeros
        apart = shifted & self.stand_out(offsets)
        shifted = apart if np.any(apart) else shifted
        return Wiring(channels, gains, np.where(shifted, offsets, 0.0)), -offsets

    @staticmethod
    def stand_out(differences: Array) -> Mask:
        """Return which lengths, at most two, differ from a design clearly more than the others."""
        sizes = np.abs(differences)
        return np.asarray(sizes > _CLEARLY * float(np.median(sizes)))


def _correlated_samples(channels: Array) -> float:
    """Return how many samples of channels, (R, 6), hold as much as one independent sample."""
    spectrum = np.abs(np.fft.rfft(channels - np.mean(channels, axis=0), 2 * len(channels), 0)) ** 2
    products = np.fft.irfft(spectrum, axis=0)[: len(channels)]
    alike = np.mean(products / products[0], axis=1)
    return 1 + 2 * float(np.sum(alike[1 : int(np.argmax(alike < _UNCORRELATED))]))


def _series(phases: Array, values: Array, harmonics: int) -> tuple[Array, ComplexArray]:
    """Return means, (6,), and complex amplitudes, (n, 6), of lengths at phases, rad."""
    basis = PhaseBasis.at(phases, harmonics).value
    found = np.linalg.lstsq(basis, values, rcond=None)[0]
    return found[0], np.asarray(found[harmonics + 1 :] - 1j * found[1 : harmonics + 1])
