"""Lag of the forces behind the lengths: a delay, a low pass of all forces, or both.

A low pass of first order is a mixture of delays, exponentially weighted. A delay is certain if it
explains clearly more than a low pass does, and hardly less than both together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from constraints.arrays import Array
from estimation.diagnostics.channel_fit import ChannelLag
from estimation.diagnostics.finding import join_words
from estimation.measurement_model import HarmonicMotion
from expdesign.configuration.estimate import DataSection
from expdesign.configuration.tolerances import RobotTolerances
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.robot import Robot

LOW_PASS_NODES, LOW_PASS_WEIGHTS = np.polynomial.laguerre.laggauss(16)
"""Delays of a low pass over its time constant, and their shares."""
LEAST = 40.0
"""Least decrease of the sum of squares, in variances; by chance it has a probability of 1e-10."""
_STEPS_LATE = (1, 2, 3, 5, 7, 10, 14, 20)
"""Delays that are tried, in steps of the recording."""
_MOST_OF_PERIOD = 0.1
_CLEARLY_ONE = 0.225
"""Least difference between a delay and a low pass in least decreases: 9 in χ²."""
_SMALL_PART = 0.1
"""Decrease by a low pass in addition to a delay, relative to the difference between either alone,
up to which the lag is a delay: the low pass is less than a quarter of it."""
_DIGITS = 0.01
_SPACINGS = (1 / 8, 1 / 64)
"""Of delays near the best one, in steps of the recording."""
_NEIGHBOURS = np.arange(-8, 9)
_SIGMAS = 5
_RANGE = np.geomspace(0.02, 5.0, 32)
"""Distances from a delay, in steps of the recording."""
_SHOWN = 0.02
"""Smallest part of a lag that is stated."""
_LARGEST_LOW_PASS = 1.5
"""ωτ of the slowest low pass that the mixture of delays of `estimators.joint_equations` can be."""
_LEAST_ACCELERATION = 0.1
"""Relative to the root mean square of all harmonics."""


def delays_to_try(step: float, period: float) -> list[float]:
    """Return the delays, s, that a search begins with; none for a period of ten samples."""
    steps = [sign * late for late in _STEPS_LATE for sign in (1, -1)]
    return [late * step for late in steps if abs(late) * step < _MOST_OF_PERIOD * period]


@dataclass(frozen=True, eq=False)
class Lag:
    """Delay and low pass of the forces, and the unexplained rest."""

    delay: float
    """s."""
    low_pass: float | None
    """Time constant of a low pass that is a part of the lag, s; None: it is clearly a delay."""
    excess: float


@dataclass(frozen=True, eq=False)
class LagSearch:
    """Search for the lag of the forces with a given wiring."""

    excess: Callable[[float, float], float]
    """Unexplained share of the forces behind a delay and a low pass, s."""
    step: float
    least_decrease: float
    """Least decrease of the unexplained share that noise does not cause."""

    def delay_near(self, delay: float) -> Lag:
        """Return the best delay within a step of a first one."""
        found = minimize_scalar(
            lambda late: self.excess(late, 0.0),
            bounds=(delay - self.step, delay + self.step),
            method="bounded",
            options={"xatol": _DIGITS * self.step},
        )
        return Lag(float(found.x), None, float(found.fun))

    def best_near(self, found: Lag) -> Lag:
        """Return the best delay within a step of a first one, whatever local minima there are.

        Every sample that passes a jump of dry friction may make one.
        """
        for spacing in _SPACINGS:
            delays = found.delay + self.step * spacing * _NEIGHBOURS
            tried = [Lag(late, None, self.excess(late, 0.0)) for late in delays.tolist()]
            found = min([found, *tried], key=lambda one: one.excess)
        return found

    def split(self, found: Lag) -> Lag:
        """Return a delay as it is, or as a delay and a low pass if it is not clearly one."""
        lag, digits = found.delay, _DIGITS * self.step
        slow = minimize_scalar(
            lambda constant: self.excess(0.0, constant),
            bounds=(lag / 2, 2 * lag),
            method="bounded",
            options={"xatol": digits},
        )
        # The sum of both is known much better than the parts.
        both = minimize(
            lambda at: self.excess(at[0] * (1 - at[1]), at[0] * at[1]),
            (lag, 0.5),
            method="Nelder-Mead",
            bounds=((0.0, 2 * lag), (0.0, 1.0)),
            options={
                "xatol": digits,
                "fatol": _DIGITS * self.least_decrease,
                "initial_simplex": [(lag, 0.3), (lag, 0.7), (1.1 * lag, 0.5)],
            },
        )
        clear = _CLEARLY_ONE * self.least_decrease
        # A low pass also smooths the noise of the lengths in the columns: a small part of one is
        # no evidence for it.
        little = max(clear, _SMALL_PART * (float(slow.fun) - found.excess))
        if found.excess < min(float(slow.fun) - clear, float(both.fun) + little):
            return found
        total, share = both.x.tolist()
        constant = total * share
        return Lag(total - constant, constant, float(both.fun))

    def delay_error(self, found: Lag, variance: float) -> float:
        """Return the standard deviation of the delay, s, by the variance of the excess.

        It is the largest by the ranges of one to five standard deviations. They differ where a
        sample passes a jump of dry friction: near the best delay such jumps fit the noise, and
        between two of them nothing changes. All parameters are free.
        """
        sides = np.array([-1.0, 1.0])[:, None] * _RANGE * self.step
        found_at = np.vectorize(lambda late: self.excess(found.delay + late, found.low_pass or 0.0))
        sigmas = np.arange(1.0, _SIGMAS + 1)
        beyond = (found_at(sides) - found.excess) / variance
        inside = beyond[:, :, None] < sigmas**2
        farthest = np.max(np.where(inside, _RANGE[:, None], 0.0), axis=(0, 1))
        return float(self.step * np.max(farthest / sigmas))


def describe_lag(robot: Robot, lag: float, constant: float | None, section: DataSection) -> str:
    """Describe a lag of the forces, s, that may be a delay or a filter, and how to state it.

    It is in addition to the delays and filters of the section.
    """
    if constant is None:
        return (
            f"the lengths lag behind the forces by about {-1e3 * lag:.3g} ms (not certain), or the "
            "forces passed a faster filter than `data.filter` states"
        )
    tolerances = robot.description.tolerances or RobotTolerances()
    missing = [name for name in ("delay", "low_pass") if getattr(tolerances, name) is None]
    rest = join_words(f"`tolerances.{name}`" for name in missing)
    total = lag + constant
    known = "State what is known as `data.delay` and `data.filter`"
    slow = constant > _SHOWN * total and not any(section.channel_filters("Q"))
    late = lag if slow else total
    stated = np.array(section.channel_delays("Q")) + late
    fits = [f"`data.delay: {{forces: {_delays(stated)}}}`"] if late > _SHOWN * total else []
    cutoff = 1 / (2 * np.pi * constant) if slow else 0.0
    fits += [f"`data.filter: {{Q: {{low_pass: {cutoff:.3g} Hz, order: 1}}}}`"] if slow else []
    return (
        f"the forces lag behind the lengths by about {1e3 * total:.3g} ms in all (not certain), by "
        f"a delay, a low pass or both (best fit: a delay of {1e3 * lag:.2g} ms and a low pass of "
        f"{1e3 * constant:.2g} ms). {known}, or else the best fit, {join_words(fits)}"
        f"{', and its uncertainty as ' * bool(rest)}{rest}"
    )


def describe_channel_lag(lag: ChannelLag, section: DataSection) -> str:
    """Describe the lag of a single channel that may be a delay or a filter, and how to state it."""
    channel = f"{lag.group}{lag.strut + 1}"
    late = np.array(section.channel_delays(lag.group))
    late[lag.strut] += lag.seconds
    cutoff = 1 / (2 * np.pi * lag.seconds)
    noun = {"q": "lengths", "Q": "forces"}[lag.group]
    known = f"{{{noun}: {_delays(late)}}}"
    return (
        f"{channel} lags behind the other channels by about {1e3 * lag.seconds:.3g} ms (not "
        f"certain), by a delay or a low pass. State the delay, `data.delay: {known}`, or the "
        f"filter, `data.filter: {{{channel}: {{low_pass: {cutoff:.3g} Hz, order: 1}}}}`"
    )


def _delays(values: Array) -> str:
    """Return delays, s, as in a run file: one if all are equal."""
    shown = [f"{1e3 * each:.3g} ms" if each else "0" for each in values]
    return shown[0] if len(set(shown)) == 1 else f"[{', '.join(shown)}]"


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
