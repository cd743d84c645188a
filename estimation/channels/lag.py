"""Lags of all forces or of one channel: a delay, a low pass, or both.

A low pass of first order is a mixture of delays, exponentially weighted. A delay is certain if it
explains clearly more than a low pass does, and hardly less than both together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, lru_cache
from itertools import product
from operator import itemgetter

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from constraints.arrays import Array
from estimation.channels.model import OF_LAG, ChannelModel
from estimation.channels.readings import MOST_LATE
from estimation.channels.wiring import Candidate, ChannelLag, Wiring
from estimation.measurement_model import HarmonicMotion, Motion
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.robot import Robot

_STEPS_LATE = (1, 2, 3, 5, 7, 10, 14, MOST_LATE)
"""Delays that are tried, in steps of the recording."""
_MOST_OF_PERIOD = 0.1
_CLEARLY_ONE = 0.225
"""Least difference between a delay and a low pass in least decreases: 9 in χ²."""
_SMALL_PART = 0.1
"""Decrease by a low pass in addition to a delay, relative to the difference between either alone,
up to which the lag is a delay: the low pass is less than a quarter of it."""
_DIGITS = 0.01
_SIGMAS = 3.0
_RANGE = np.geomspace(0.01, 5.0, 14)
"""Distances from a delay, in steps of the recording."""
_STEPS_OF_CHANNEL = (0, 1, 3, 7, 15)
"""Lags of a single channel, in steps of the recording: ends of ranges that are searched."""
_CHANNEL_DIGITS = 0.05
_LARGEST_LOW_PASS = 1.5
"""ωτ of the slowest low pass that the mixture of delays of `estimators.joint_equations` can be."""
_LEAST_ACCELERATION = 0.1
"""Relative to the root mean square of all harmonics."""


def delays_to_try(step: float, period: float) -> list[float]:
    """Return the delays, s, that a search begins with; none for a period of ten samples."""
    steps = [sign * late for late in _STEPS_LATE for sign in (1, -1)]
    return [late * step for late in steps if abs(late) * step < _MOST_OF_PERIOD * period]


class LagSearch:
    """Search for the lag of the forces with given channels."""

    def __init__(self, model: ChannelModel, lengths: Wiring, forces: Wiring) -> None:
        motion = model.motion(lengths)

        @cache
        def excess(delay: float, low_pass: float = 0.0) -> float:
            return model.fit_columns(model.columns(motion, delay, low_pass)).excess(forces)

        self.model = model
        self.excess = excess
        """Unexplained share of the forces behind a delay and a low pass, s."""

    def best(self, present: Candidate) -> Candidate:
        """Return a candidate with the best delay, or delay and low pass, if it is a fault."""
        step, period = self.model.step, self.model.period
        delays = [(self.excess(late), late) for late in delays_to_try(step, period)]
        if not delays:  # a period of ten samples has no room for any
            return present
        later = self.delay_near(present, min(delays)[1])
        if abs(later.delay) < self.model.least_delay:
            return present
        if present.excess - later.excess <= self.model.least(later):
            return later
        # A delay alone may leave most of a low pass.
        return self.split(later)

    def delay_near(self, present: Candidate, delay: float) -> Candidate:
        """Return a candidate with the best delay within a step of a first one."""
        step = self.model.step
        found = minimize_scalar(
            self.excess,
            bounds=(delay - step, delay + step),
            method="bounded",
            options={"xatol": _DIGITS * step},
        )
        late = float(found.x)
        return replace(present, delay=late, low_pass=None, excess=float(found.fun))

    def split(self, found: Candidate) -> Candidate:
        """Return a delay as it is, or as a delay and a low pass if it is not clearly one."""
        if found.delay <= 0 or found.low_pass is not None:
            return found
        lag, digits = found.delay, _DIGITS * self.model.step
        slow = minimize_scalar(
            lambda constant: self.excess(0.0, constant),
            bounds=(lag / 2, 2 * lag),
            method="bounded",
            options={"xatol": digits},
        )
        clear = _CLEARLY_ONE * self.model.least_decrease
        # A low pass also smooths the noise of the lengths in the columns: a small part of one is
        # no evidence for it.
        little = max(clear, _SMALL_PART * (float(slow.fun) - found.excess))
        late = found.excess < float(slow.fun) - clear
        if late and self._gain(found) < little / 4:
            return found
        # The sum of both is known much better than the parts.
        both = minimize(
            lambda at: self.excess(lag * at[0] * (1 - at[1]), lag * at[0] * at[1]),
            (1.0, 0.5),
            method="Nelder-Mead",
            bounds=((0.0, 2.0), (0.0, 1.0)),
            options={
                "xatol": digits / lag,
                "fatol": _DIGITS * self.model.least_decrease,
                "initial_simplex": [(1.0, 0.3), (1.0, 0.7), (1.1, 0.5)],
            },
        )
        if late and found.excess < float(both.fun) + little:
            return found
        total, share = (both.x * (lag, 1.0)).tolist()
        constant = total * share
        return replace(found, delay=total - constant, low_pass=constant, excess=float(both.fun))

    def _gain(self, found: Candidate) -> float:
        """Return the largest decrease of the excess by a low pass for a share s of a delay.

        It changes by −c s² + k s⁴, since the mean lag stays the same.
        """
        lag, squares = found.delay, np.array([1 / 16, 1 / 4])
        rises = [
            (self.excess(lag * (1 - s), lag * s) - found.excess) / s**2 for s in np.sqrt(squares)
        ]
        k = (rises[1] - rises[0]) / (squares[1] - squares[0])
        c = k * squares[0] - rises[0]
        return 0.0 if c <= 0 else c**2 / (4 * k) if k > 0 else np.inf


def delay_error(model: ChannelModel, found: Candidate) -> float:
    """Return the standard deviation of the delay, s, with all parameters free.

    The part of noise is a third of the distance, on the farther side, at which the sum of squares
    is larger by nine variances: far from the best delay, jumps of dry friction make it no parabola.
    Jumps are spread over a step, but a sample has their full height: where samples meet the jumps
    changes the delay, by step/√12 for a single one, and less the more jumps there are.
    """
    excess, distances = LagSearch(model, found.lengths, found.forces).excess, _RANGE * model.step
    farthest = 0.0
    for side in (-1.0, 1.0):
        delays = (found.delay + side * distances).tolist()
        rise = np.array([excess(late, found.low_pass or 0.0) for late in delays]) - found.excess
        sigmas = np.sqrt(np.maximum(np.maximum.accumulate(rise), 0.0) / model.variance_of(found))
        farthest = max(farthest, float(np.interp(_SIGMAS, sigmas, distances)))
    slopes = model.effect_of_lag(found, _DIGITS * model.step)
    single = float(np.sum(slopes**4)) ** 0.5 / float(np.sum(slopes**2))
    return float(np.hypot(farthest / _SIGMAS, model.step / np.sqrt(12) * single))


def with_channel_lag(model: ChannelModel, present: Candidate) -> Candidate:
    """Return the candidate with the lag of the single channel that explains most, if any."""
    if present.channel_lag is not None:
        return present
    near = model.motion(present.lengths)
    columns = columns_of_lags(model, present, near)
    places = list(product("qQ", range(ACTUATORS)))
    now = model.fit(near, present.delay, present.low_pass or 0.0)
    first = [columns(ChannelLag(*at, model.step)) for at in places]
    parameters = now.parameters(present.forces)
    slopes = np.stack([(each - now.columns) @ parameters for each in first], axis=2)
    rest = model.residuals(present, now)
    if model.largest_share(slopes, rest, now) < OF_LAG * model.least_decrease:
        return present

    def late(group: str, strut: int, seconds: float) -> Candidate:
        lag = ChannelLag(group, strut, seconds)
        excess = model.fit_columns(columns(lag)).excess(present.forces)
        return replace(present, channel_lag=lag, excess=excess)

    tried = {
        (place, number): late(*place, steps * model.step).excess
        for number, steps in enumerate(_STEPS_OF_CHANNEL[1:-1], 1)
        for place in places
    }
    place, number = min(tried, key=lambda each: tried[each])
    found = minimize_scalar(
        lambda seconds: late(*place, seconds).excess,
        bounds=[_STEPS_OF_CHANNEL[number + by] * model.step for by in (-1, 1)],
        method="bounded",
        options={"xatol": _CHANNEL_DIGITS * model.step},
    )
    return late(*place, float(found.x)) if found.x >= model.least_delay else present


def columns_of_lags(
    model: ChannelModel, present: Candidate, near: Motion
) -> Callable[[ChannelLag | None], Array]:
    """Return the columns, (R, 6, m), behind the lag of one channel, near a motion."""

    @lru_cache(maxsize=2)  # without a lag and with that of a force: the same for six channels
    def of_forces(seconds: float) -> Array:
        return model.columns(near, present.delay + seconds, present.low_pass or 0.0)

    def columns(lag: ChannelLag | None) -> Array:
        if lag is not None and lag.group == "q":
            motion = model.motion(present.lengths, near, lag)
            return model.columns(motion, present.delay, present.low_pass or 0.0)
        found = of_forces(0.0).copy()
        if lag is not None:
            found[:, lag.strut] = of_forces(lag.seconds)[:, lag.strut]
        return found

    return columns


def slow_low_pass_warning(
    robot: Robot, motion: HarmonicMotion, constants: Mapping[str, float]
) -> str:
    """Return a warning of time constants, s, too long for the model of unknown low passes.

    Empty if there is none.
    """
    scale = np.repeat([1.0, robot.characteristic_length], COORDINATES // 2)
    name, constant = max(constants.items(), key=itemgetter(1), default=("", 0.0))
    rate = motion.omega * _highest_harmonic(motion, scale)
    if rate * constant <= _LARGEST_LOW_PASS:
        return ""
    group = "q" if name.startswith("length") else "Q"
    cutoff = 1 / (2 * np.pi * constant)
    return (
        f"{name}: a low pass of {1e3 * constant:.3g} ms is too slow for the model of unknown low "
        f"passes, a mixture of delays: at the highest frequency of the motion, "
        f"{rate / (2 * np.pi):.3g} Hz, ωτ = {rate * constant:.2g}, and from {_LARGEST_LOW_PASS} on "
        f"it is wrong by 10 % or more. State the filter, `data.filter: {{{group}: {{low_pass: "
        f"{cutoff:.3g} Hz, order: 1}}}}`, and as `tolerances.low_pass` its uncertainty alone"
    )


def _highest_harmonic(motion: HarmonicMotion, scale: Array) -> int:
    """Return the highest harmonic that matters.

    It and those above have a tenth of the root mean square acceleration.
    """
    count = motion.harmonics
    waves = motion.table[:, 1:].reshape(len(motion.table), 2, count)
    accelerations = waves * scale[:, None, None] * np.arange(1, count + 1) ** 2
    energy = np.sum(accelerations**2, axis=(0, 1))
    above = np.cumsum(energy[::-1])[::-1]
    return int(np.count_nonzero(above > _LEAST_ACCELERATION**2 * above[0]))
