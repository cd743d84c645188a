"""Search for the wiring of a recording: order, sign, scale and zero of its channels, and the delay.

All wirings of the forces are fitted at once; lengths move the regressor and are tried one after the
other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from constraints.arrays import Array, ComplexArray
from estimation.diagnostics.channel_fit import (
    DETERMINED,
    ORDERS,
    OTHER_GAIN,
    SPREADS,
    STRUTS,
    UNITS,
    Candidate,
    ChannelLag,
    ForceFit,
    Wiring,
    round_factor,
)
from estimation.diagnostics.channel_lag import (
    LEAST,
    LOW_PASS_NODES,
    LOW_PASS_WEIGHTS,
    Lag,
    LagSearch,
    delays_to_try,
)
from estimation.measurement_model import HarmonicMotion
from estimation.processing import NoiseModel, PeriodicRecording
from estimation.processing.periodic_recording import Channels
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.terms.rigid_platform import MASS
from expdesign.robot import Robot
from expdesign.trajectory import FourierTrajectory, PhaseBasis

_FORCE_ROWS, _LENGTH_ROWS = 1000, 256
"""Largest number of rows in use: means over periods, or single samples."""
_STEPS = 12
_DAMPING = 1e-9
_REACHED = 1e-6
"""m. Last Newton step: the error after it is of the order of its square over a metre."""
_LARGEST_STEP = 0.3
"""Largest step of a pose, in units of the characteristic length."""
_ROUND_THE_BASE = [
    (first + turn * STRUTS) % ACTUATORS
    for first in range(ACTUATORS)
    for turn in (1, -1)
    if (first, turn) != (0, 1)
]
"""Orders that count the struts from another one, or backwards."""
_FACTORS = (2.0, 0.5)
_SHORTEST, _LONGEST = 0.5, 2.0
"""Possible lengths of a strut, relative to that at home."""
_MOST_STRUTS = 4
_MUCH_BETTER = 4.0
"""Ratio of unexplained forces from which on another wiring is preferred to a simpler one."""
_EQUAL = 1e-3
"""Unexplained share, in addition; another order or sign leaves 4 % or more."""
_SMALL = 0.01
_MOSTLY = 0.4
"""Share of the unexplained forces that a delay or the zero of a length may leave."""
_STEPS_OF_CHANNEL = (0, 1, 3, 7, 15)
"""Lags of a single channel, in steps of the recording: ends of ranges that are searched."""
_OF_LENGTHS = 4
"""Harmonics of a length that is shifted, relative to those of the motion."""
_OF_LAG = 0.5
"""Least decrease by a lag of the channels as measured, relative to that by any of all wirings."""
_ZERO_DIGITS = 0.05
_ZEROS = np.array([-16, -8, -4, -2, -1, 0, 1, 2, 4, 8, 16])
"""Errors of a length's zero that are tried, in smallest faults."""
_ALIKE = 0.1
_FURTHER = 3
"""Harmonics of lengths, in addition to those of the motion."""
_PHASES = 240
_UNLIKE = 0.1
"""Largest sum of 1 − correlation of the six lengths with those of a design that was executed."""
_CLEARLY = 8.0
_MOST_SHIFTED = 2
_CLEAR_WORK = 10.0
"""Work of the actuators over a period that is not noise, in standard deviations."""
_LEAST_SHARE = 0.2
"""Share of the unexplained forces that one of several faults must explain."""
_ROUNDS = 4
_EACH = np.eye(ACTUATORS)


class ChannelSearch:
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
    harmonics : int
        Harmonics of the motion.
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
        harmonics: int,
        zeros: Array,
        least_zeros: Array,
        least_delay: float,
    ) -> None:
        self.robot, self.omega, self.step = robot, recording.omega, recording.step
        self.zeros, self.least_zeros, self.least_delay = zeros, least_zeros, least_delay
        self.length_times, lengths, _ = _thin_rows(recording.lengths, _LENGTH_ROWS)
        self.readings = lengths - zeros
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
        self.force_times, forces, counts = _thin_rows(recording.forces, rows)
        self._measured_forces, self.forces = forces, self._whiten(forces)
        self._work_noise = float(
            np.sqrt(np.max(np.diag(noise.forces.covariance)) / np.mean(counts))
        )
        self._variances = variances * float(np.sum(1 / counts))
        share = float(np.sum(self._variances) / np.sum(self.forces**2))
        self._share = share
        self.least_decrease = LEAST * share / self.forces.size
        self.spread = share * float(np.sqrt(2 / self.forces.size))
        self._harmonics = min(_OF_LENGTHS * harmonics, (len(self.readings) - 1) // 2)
        most = min(harmonics, (len(self.readings) - 1) // 2)
        basis = PhaseBasis.at(self.omega * self.length_times, most)
        self._to_series = np.asarray(np.linalg.pinv(basis.value), np.float64)
        self._scale = np.repeat([1.0, 1 / robot.characteristic_length], COORDINATES // 2)
        self._delays = delays_to_try(self.step, recording.period)

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
        near: HarmonicMotion | None = None,
        lag: ChannelLag | None = None,
    ) -> HarmonicMotion:
        """Return the motion with the readings nearest to the measured lengths.

        Damped Newton steps, one row at a time, from a near motion or from home; lengths that no
        pose has end at a near one. With the lag of one of the lengths, its readings are shifted
        along their Fourier series.
        """
        wanted = lengths.apply(self.readings) + self.zeros
        if lag is not None and lag.group == "q":
            now, late = (
                PhaseBasis.at(self.omega * (self.length_times + shift), self._harmonics).value
                for shift in (0.0, lag.seconds)
            )
            series = np.linalg.lstsq(now, wanted[:, lag.strut], rcond=None)[0]
            wanted[:, lag.strut] += (late - now) @ series
        home = np.broadcast_to(self.robot.home, wanted.shape)
        poses = home if near is None else near.at(self.length_times).pose()
        largest = _LARGEST_STEP * self.robot.characteristic_length
        for _ in range(_STEPS):
            found, jacobian = self.robot.lengths_and_jacobian(poses)
            slopes = jacobian * self._scale
            turned = slopes.transpose(0, 2, 1)
            matrix = turned @ slopes + _DAMPING * np.eye(COORDINATES)
            step = np.linalg.solve(matrix, turned @ (wanted - found)[:, :, None])[:, :, 0]
            size = np.linalg.norm(step, axis=1, keepdims=True)
            step *= np.minimum(1, largest / np.maximum(size, 1e-300))
            poses = poses + self._scale * step
            if np.max(size) < _REACHED:
                break
        return HarmonicMotion((self._to_series @ poses).T, self.omega)

    def _whiten(self, rows: Array) -> Array:
        """Return forces (R, 6), or columns (R, 6, m), over the spectrum of coloured noise."""
        if self._density is None:
            return rows
        scale = np.sqrt(self._density).reshape(-1, *(1,) * (rows.ndim - 1))
        return np.fft.irfft(np.fft.rfft(rows, axis=0) / scale, len(rows), axis=0)

    def columns(self, motion: HarmonicMotion, delay: float = 0.0, low_pass: float = 0.0) -> Array:
        """Return A, (R, 6, m), for forces behind a delay and a low pass, s."""
        nodes, weights = (LOW_PASS_NODES, LOW_PASS_WEIGHTS) if low_pass else ([0.0], [1.0])
        states = (motion.at(self.force_times - delay - low_pass * x).state() for x in nodes)
        columns = [self.robot.regressor(*np.split(state, 3, axis=1)) for state in states]
        return self._whiten(np.tensordot(weights, columns, axes=1))

    def fit(self, motion: HarmonicMotion, delay: float = 0.0, low_pass: float = 0.0) -> ForceFit:
        """Return the fits of the forces along a motion, behind a delay and a low pass, s."""
        return ForceFit(self.columns(motion, delay, low_pass), self.forces, self._variances)

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

    def _orient(
        self, forces: Wiring, fit: ForceFit, motion: HarmonicMotion, delay: float
    ) -> Wiring:
        """Return the wiring of the forces, with all signs reversed if physics demands it.

        A fit with free parameters does not depend on this sign. The mass must be positive, and over
        a period the actuators must do the work of friction. If the two disagree, or the work is
        within the noise, fewer reversed signs are preferred.
        """
        names = self.robot.parameter_names
        mass = float(fit.parameters(forces)[names.index(MASS)]) if MASS in names else 0.0
        state = np.split(motion.at(self.force_times - delay).state(), 3, axis=1)
        rates = self.robot.strut_motion(*state).length_rate
        own = forces.apply(self._measured_forces)
        work = float(np.sum(own * rates))
        noise = (
            self._work_noise * float(np.linalg.norm(rates)) * float(np.max(np.abs(forces.gains)))
        )
        clear = work * mass > 0 and abs(work) > _CLEAR_WORK * noise
        sign = work if clear else float(np.sum(np.sign(forces.gains)))
        return forces if sign >= 0 else replace(forces, gains=-forces.gains)

    def candidate(self, lengths: Wiring, delay: float) -> Candidate:
        """Return the best wiring of the forces for given lengths and delay."""
        motion = self.motion(lengths)
        fit = self.fit(motion, delay)
        forces, other = Wiring.as_measured(), fit.best()
        if self._is_better(fit.excess(other), fit.excess(forces)):
            forces = other
        next_best = fit.next_best(forces)
        scaled, next_scaled = fit.best_with_scales()
        if self._is_better(fit.excess(scaled), fit.excess(forces)):
            forces, next_best = scaled, min(fit.excess(forces), next_scaled)
        excess = fit.excess(forces)
        forces = self._orient(forces, fit, motion, delay)
        return Candidate(lengths, forces, delay, excess, next_best)

    def _is_better(self, excess: float, other: float) -> bool:
        """Return whether a wiring is preferred to a simpler one, by their unexplained shares."""
        least = max(self.least_decrease, _EQUAL, (_MUCH_BETTER - 1) * self.left(excess))
        return other - excess > least

    def least(self, found: Candidate) -> float:
        """Return the least decrease of the unexplained share by a wiring.

        It is smaller if nothing but a delay differs: this is one trial, not thousands.
        """
        as_measured = not self._differs(found, Candidate.as_measured())
        return _OF_LAG * self.least_decrease if found.delay and as_measured else self.least_decrease

    def left(self, excess: float) -> float:
        """Return the part of an unexplained share that is not noise."""
        return max(excess - SPREADS * self.spread, 0.0)

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
        columns = self.columns(motion, candidate.delay, candidate.low_pass or 0.0)
        fit = ForceFit(columns, self.forces, self._variances)
        explained, nominal = (
            columns @ values for values in (fit.parameters(candidate.forces), self.robot.parameters)
        )
        own, both = float(np.sum(nominal**2)), float(np.sum(explained * nominal))
        return both / own, both**2 / own / float(np.sum(explained**2))

    def search(self, design: FourierTrajectory | None) -> Candidate:
        """Return the wiring that explains most, found by single changes.

        Order, sign and scale of the lengths come from the design, if they can. Discrete changes
        are tried first, then the zero of a length and the value of the delay.
        """
        known = None if design is None else self.wiring_of_design(design)
        measured = Wiring.as_measured()
        measured = replace(measured, gains=self.unit * measured.gains)
        best = self.candidate(known or measured, 0.0)
        # The machine may stand elsewhere than planned, or move less: the forces decide.
        lengths, plainer = best.lengths, list[Wiring]()
        if np.any(lengths.offsets):
            plainer.append(replace(lengths, offsets=np.zeros(ACTUATORS)))
        if np.any(np.abs(lengths.gains) != self.unit):
            plainer.append(replace(lengths, gains=self.unit * np.sign(lengths.gains)))
        tried = [best, *(self.candidate(one, 0.0) for one in plainer)]
        best = min(tried, key=lambda each: each.excess)
        if np.count_nonzero(best.lengths.offsets) > _MOST_SHIFTED:
            # Zeros of all lengths, or a machine that stands elsewhere: the forces must be clear.
            given = [each for each in tried if not np.any(each.lengths.offsets)]
            plain = min(given, key=lambda each: each.excess)
            least = max(self.least_decrease, (_MUCH_BETTER - 1) * self.left(best.excess))
            best = replace(best, next_best=min(best.next_best, plain.excess))
            best = best if plain.excess - best.excess > least else plain
        for _ in range(_ROUNDS):
            if self.left(best.excess) < _SMALL or best.channel_lag is not None:
                break
            tried = [self.candidate(*each) for each in self._neighbours(best, known is not None)]
            if not tried:
                break
            found = min(tried, key=lambda one: one.excess)
            others = (one.excess for one in tried if self._differs(one, found))
            found = replace(found, next_best=min(found.next_best, *others, np.inf))
            late = self._with_lag(best), self._with_channel_lag(best)
            refined = *late, *self._zeros(best, 1 - _LEAST_SHARE)
            moved = min(refined, key=lambda one: one.excess)
            if moved.excess < found.excess and self._is_no_imitation(best, moved):
                found = moved
            if best.excess - found.excess < max(self.least_decrease, _LEAST_SHARE * best.excess):
                break
            best = found
        best = self._without_small_zeros(best)
        for _ in range(_ROUNDS):
            if best.channel_lag is not None:
                break
            tried = [self._with_lag(best), self._with_channel_lag(best)]
            if best.excess > self.least_decrease:
                tried += self._zeros(best, _MOSTLY)
            found, *rest = sorted(tried, key=lambda one: one.excess)
            decrease = best.excess - found.excess
            # What is left may be an error of the noise, which is the same with and without a lag.
            least = max(self.least(found), (1 / _MOSTLY - 1) * self.left(found.excess))
            if decrease < least or not self._is_no_imitation(best, found):
                break
            # The lag of one channel is a part of that of all, and no other wiring.
            next_ones = [one.excess for one in rest if one.channel_lag is None]
            best = replace(found, next_best=min([found.next_best, *next_ones]))
        return self._simplest(self._split_lag(best))

    def _split_lag(self, found: Candidate) -> Candidate:
        """Return the wiring with a lag that is not clearly a delay as a delay and a low pass."""
        if found.delay <= 0 or found.low_pass is not None:
            return found
        return _with_lag(found, self.lag_search(found).split(_lag_of(found)))

    def lag_search(self, found: Candidate) -> LagSearch:
        """Return the search for the lag of the forces with a wiring."""
        motion = self.motion(found.lengths)
        return LagSearch(
            lambda delay, constant: self.fit(motion, delay, constant).excess(found.forces),
            self.step,
            self.least_decrease,
        )

    def delay_error(self, found: Candidate) -> float:
        """Return the standard deviation of the delay, s, with all parameters free.

        Unexplained forces count as noise.
        """
        level = max(1 + found.excess / self._share, 1.0) * self.least_decrease / LEAST
        return self.lag_search(found).delay_error(_lag_of(found), level)

    def gain_errors(self, found: Candidate) -> Array:
        """Return the relative standard deviations of the gains of the forces, (6,)."""
        fit = self.fit(self.motion(found.lengths), found.delay, found.low_pass or 0.0)
        return fit.fit_gains(found.forces)[1]

    def _simplest(self, found: Candidate) -> Candidate:
        """Return the wiring with the fewest channels in another order among equal ones.

        A symmetric machine is the same with its struts counted from another one, or backwards.
        """

        def count_moved(one: Candidate) -> int:
            orders = one.lengths.channels, one.forces.channels
            return sum(int(np.count_nonzero(order != STRUTS)) for order in orders)

        best = found
        for order in _ROUND_THE_BASE:
            lengths, forces = found.lengths.reorder(order), found.forces.reorder(order)
            other = replace(found, lengths=lengths, forces=forces)
            if count_moved(other) < count_moved(best):
                fit = self.fit(self.motion(lengths), found.delay, found.low_pass or 0.0)
                excess = fit.excess(forces)
                if not self._is_better(found.excess, excess):
                    best = replace(other, excess=excess)
        return best

    def _without_small_zeros(self, found: Candidate) -> Candidate:
        """Return the wiring without errors of zeros that are no fault, and with the best delay."""
        lengths = found.lengths
        large = np.abs(lengths.offsets) >= self.least_zeros
        lengths = replace(lengths, offsets=np.where(large, lengths.offsets, 0.0))
        found = replace(found, lengths=lengths)
        columns = self._columns_of_lags(found, self.motion(lengths))(found.channel_lag)
        fit = ForceFit(columns, self.forces, self._variances)
        found = replace(found, excess=fit.excess(found.forces))
        return self._at_delay(found, found.delay) if found.delay else found

    def _is_no_imitation(self, present: Candidate, found: Candidate) -> bool:
        """Return whether a delay or a zero explains more than any effect in one strut.

        The effects are a constant force, a spring, a gain and an inertia.
        """
        motion = self.motion(present.lengths)
        columns = self.columns(motion, present.delay, present.low_pass or 0.0)
        parameters = ForceFit(columns, self.forces, self._variances).parameters(present.forces)
        state = np.split(motion.at(self.force_times).state(), 3, axis=1)
        struts = self.robot.strut_motion(*state)
        shapes = (
            np.ones_like(self.forces),
            struts.length - np.mean(struts.length, axis=0),
            self.robot.regressor(*state) @ parameters,
            struts.length_acceleration,
        )
        own = np.concatenate([self._whiten(each)[:, :, None] * _EACH for each in shapes], axis=2)
        most = self._explained_by(own, present, columns)
        return present.excess - found.excess > max(self.least(found), most)

    def _explained_by(self, shapes: Array, present: Candidate, columns: Array) -> float:
        """Return the largest share of the forces that one of some shapes, (R, 6, n), explains.

        It is in addition to the columns, (R, 6, m), of a wiring.
        """
        fit = ForceFit(columns, self.forces, self._variances)
        rest = present.forces.apply(self.forces) - columns @ fit.parameters(present.forces)
        own = np.einsum("rim,rin->nm", columns, shapes, optimize=True) @ fit.root
        energies = np.einsum("rin,rin->n", shapes, shapes)
        left = energies - np.sum(own**2, axis=1)
        seen = left > DETERMINED * energies
        explained = np.einsum("rin,ri->n", shapes, rest)[seen] ** 2 / left[seen]
        return float(np.max(explained, initial=0.0)) / float(np.sum(self.forces**2))

    def _differs(self, one: Candidate, other: Candidate) -> bool:
        """Return whether order, sign, scale or zero of a channel differ."""
        pairs = ((one.lengths, other.lengths), (one.forces, other.forces))
        return any(
            np.any(a.channels != b.channels) or not np.allclose(a.gains, b.gains, rtol=_ALIKE)
            for a, b in pairs
        ) or bool(np.any(np.abs(one.lengths.offsets - other.lengths.offsets) > self.least_zeros))

    def _neighbours(self, present: Candidate, known: bool) -> Iterator[tuple[Wiring, float]]:
        """Yield lengths and delays that differ by one change; delays only for known lengths."""
        lengths, delay = present.lengths, present.delay
        yield from ((lengths, late) for late in self._delays)
        if known:
            return
        for order in _length_orders():
            yield lengths.reorder(order), delay
        means = np.mean(lengths.apply(self.readings), axis=0)
        for strut in range(ACTUATORS):
            yield lengths.scale(strut, -1.0, means[strut]), delay
            for factor in (-1.0, *_FACTORS):
                yield lengths.scale(strut, factor), delay

    def _with_lag(self, present: Candidate) -> Candidate:
        """Return the wiring with the best delay, or delay and low pass, if it is a fault."""
        excess = self.lag_search(present).excess
        delays = [(excess(late, 0.0), late) for late in self._delays]
        if not delays:  # a period of ten samples has no room for any
            return present
        later = self._at_delay(present, min(delays)[1])
        if abs(later.delay) < self.least_delay:
            return present
        if present.excess - later.excess <= self.least(later):
            return later
        # A delay alone may leave most of a low pass.
        return self._split_lag(_with_lag(later, self.lag_search(later).best_near(_lag_of(later))))

    def _with_channel_lag(self, present: Candidate) -> Candidate:
        """Return the wiring with the lag of the single channel that explains most, if any."""
        if present.channel_lag is not None:
            return present
        near = self.motion(present.lengths)
        columns = self._columns_of_lags(present, near)
        places = list(product("qQ", range(ACTUATORS)))
        now, first = columns(None), [columns(ChannelLag(*at, self.step)) for at in places]
        parameters = ForceFit(now, self.forces, self._variances).parameters(present.forces)
        slopes = np.stack([(each - now) @ parameters for each in first], axis=2)
        if self._explained_by(slopes, present, now) < _OF_LAG * self.least_decrease:
            return present

        def late(group: str, strut: int, seconds: float) -> Candidate:
            lag = ChannelLag(group, strut, seconds)
            excess = ForceFit(columns(lag), self.forces, self._variances).excess(present.forces)
            return replace(present, channel_lag=lag, excess=excess)

        tried = {
            (place, number): late(*place, steps * self.step).excess
            for number, steps in enumerate(_STEPS_OF_CHANNEL[1:-1], 1)
            for place in places
        }
        place, number = min(tried, key=lambda each: tried[each])
        found = minimize_scalar(
            lambda seconds: late(*place, seconds).excess,
            bounds=[_STEPS_OF_CHANNEL[number + by] * self.step for by in (-1, 1)],
            method="bounded",
            options={"xatol": _ZERO_DIGITS * self.step},
        )
        return late(*place, float(found.x)) if found.x >= self.least_delay else present

    def _columns_of_lags(
        self, present: Candidate, near: HarmonicMotion
    ) -> Callable[[ChannelLag | None], Array]:
        """Return the columns, (R, 6, m), behind the lag of one channel, near a motion."""

        @lru_cache(maxsize=2)  # without a lag and with that of a force: the same for six channels
        def of_forces(seconds: float) -> Array:
            return self.columns(near, present.delay + seconds, present.low_pass or 0.0)

        def columns(lag: ChannelLag | None) -> Array:
            if lag is not None and lag.group == "q":
                motion = self.motion(present.lengths, near, lag)
                return self.columns(motion, present.delay, present.low_pass or 0.0)
            found = of_forces(0.0).copy()
            if lag is not None:
                found[:, lag.strut] = of_forces(lag.seconds)[:, lag.strut]
            return found

        return columns

    def _zeros(self, present: Candidate, most: float) -> Iterator[Candidate]:
        """Yield wirings with another zero of one length.

        Zeros that promise to leave more than the share `most` are left out.
        """
        near = self.motion(present.lengths)
        for strut in range(ACTUATORS):
            yield self._at_zero(present, strut, most, near)

    def _at_delay(self, present: Candidate, delay: float) -> Candidate:
        """Return the wiring with the best delay near a first one."""
        return _with_lag(present, self.lag_search(present).delay_near(delay))

    def _at_zero(
        self, present: Candidate, strut: int, most: float, near: HarmonicMotion
    ) -> Candidate:
        """Return the wiring with the zero of one length that explains most."""

        def excess(offset: float) -> float:
            motion = self.motion(present.lengths.shift(strut, offset), near)
            return self.fit(motion, present.delay, present.low_pass or 0.0).excess(present.forces)

        # On both sides: the curve is no parabola far from the minimum, and may mislead near zero.
        step = self.least_zeros[strut]
        offsets = step * _ZEROS
        values = np.array([excess(offset) if offset else present.excess for offset in offsets])
        best = int(np.argmin(values[1:-1])) + 1
        if offsets[best] == 0 or values[best] > most * present.excess:
            return present
        found = minimize_scalar(
            excess,
            bounds=(offsets[best - 1], offsets[best + 1]),
            method="bounded",
            options={"xatol": _ZERO_DIGITS * step},
        )
        offset = float(found.x)
        if abs(offset) < step:
            return present
        return replace(
            present, lengths=present.lengths.shift(strut, offset), excess=float(found.fun)
        )

    def wiring_of_design(self, design: FourierTrajectory) -> Wiring | None:
        """Return the wiring that gives the lengths of the designed motion, begun at any time.

        None if the machine does not execute it, or if several wirings give these lengths.
        """
        harmonics = design.harmonics + _FURTHER
        if len(self.readings) <= 2 * harmonics + 1:
            return None
        phases = 2 * np.pi * np.arange(_PHASES) / _PHASES
        planned = self.robot.inverse_kinematics(design.sample(phases / design.omega).pose)
        middle, wanted = _series(phases, planned, harmonics)
        mean, found = _series(self.omega * self.length_times, self.readings, harmonics)
        turns = np.exp(1j * np.outer(phases, np.arange(1, harmonics + 1)))
        sizes = np.linalg.norm(wanted, axis=0)[:, None] * np.linalg.norm(found, axis=0)
        products = np.einsum("tk,ki,kj->tij", turns, wanted.conj(), found, optimize=True).real
        alike = (products / sizes)[:, STRUTS, ORDERS]
        unlike = np.sum(1 - np.abs(alike), axis=2)
        time, order = np.unravel_index(int(np.argmin(unlike)), unlike.shape)
        signs, best = np.sign(alike[time, order]), float(unlike[time, order])
        same = np.zeros(unlike.shape, dtype=bool)
        same[:, order] = np.all(np.sign(alike[:, order]) == signs, axis=1)
        if best > _UNLIKE or float(np.min(unlike[~same])) < _CLEARLY * best:
            return None
        channels = ORDERS[order]
        energies = np.sum(np.abs(found) ** 2, axis=0)[channels]
        gains = products[time, STRUTS, channels] / energies
        sizes = np.abs(gains) / self.unit
        far = np.abs(np.log(sizes)) > np.log(OTHER_GAIN)
        gains = self.unit * signs * np.where(far, round_factor(sizes), 1.0)
        offsets = middle - self.zeros - gains * mean[channels]
        usual = _CLEARLY * float(np.median(np.abs(offsets)))
        shifted = np.abs(offsets) > self.least_zeros
        apart = shifted & (np.abs(offsets) > usual)
        if 0 < np.count_nonzero(apart) <= _MOST_SHIFTED:
            shifted = apart
        return Wiring(channels, gains, np.where(shifted, offsets, 0.0))


def _lag_of(found: Candidate) -> Lag:
    return Lag(found.delay, found.low_pass, found.excess)


def _with_lag(found: Candidate, lag: Lag) -> Candidate:
    return replace(found, delay=lag.delay, low_pass=lag.low_pass, excess=lag.excess)


def _series(phases: Array, values: Array, harmonics: int) -> tuple[Array, ComplexArray]:
    """Return means, (6,), and complex amplitudes, (n, 6), of lengths at phases, rad."""
    basis = PhaseBasis.at(phases, harmonics).value
    found = np.linalg.lstsq(basis, values, rcond=None)[0]
    return found[0], np.asarray(found[harmonics + 1 :] - 1j * found[1 : harmonics + 1])


def _length_orders() -> Iterator[NDArray[np.intp]]:
    """Yield orders with two struts swapped, counted from another strut, or reversed."""
    for i, j in combinations(range(ACTUATORS), 2):
        order = STRUTS.copy()
        order[[i, j]] = j, i
        yield order
    yield from _ROUND_THE_BASE


def _thin_rows(channels: Channels, most: int) -> tuple[Array, Array, Array]:
    """Return times, values and counts of at most so many rows of a recording's channels."""
    rows = np.unique(np.linspace(0, len(channels.values) - 1, most).astype(np.intp))
    return channels.times[rows], channels.values[rows], channels.counts[rows]
