"""Lag of the forces behind the lengths: a delay, a low pass of all forces, or both.

A low pass of first order is a mixture of delays, exponentially weighted. A delay is certain if it
explains clearly more than a low pass does, and hardly less than both together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from estimation.diagnostics.finding import join_words
from expdesign.configuration.tolerances import RobotTolerances
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

    def delay_error(self, found: Lag) -> float:
        """Return the standard deviation of the delay due to noise of the forces, s.

        It is that of the curvature over half a step, for jumps of dry friction have no derivative;
        all parameters are free.
        """
        half = self.step / 2
        below, middle, above = (
            self.excess(found.delay + late, found.low_pass or 0.0) for late in (-half, 0, half)
        )
        curvature = (below - 2 * middle + above) / half**2 * LEAST / self.least_decrease
        return float(np.sqrt(2 / curvature)) if curvature > 0 else half


def describe_lag(robot: Robot, lag: float, constant: float | None) -> str:
    """Describe a lag of the forces, s, that may be a delay or a filter."""
    if constant is None:
        return (
            f"the lengths lag behind the forces by about {-1e3 * lag:.3g} ms, or the forces passed "
            "a faster filter than `data.filter` states"
        )
    stated = robot.description.tolerances or RobotTolerances()
    missing = [name for name in ("delay", "low_pass") if getattr(stated, name) is None]
    rest = join_words(f"`tolerances.{name}`" for name in missing)
    return (
        f"the forces lag behind the lengths by about {1e3 * (lag + constant):.3g} ms in all, by a "
        f"delay, a low pass or both (best fit: a delay of {1e3 * lag:.2g} ms and a low pass of "
        f"{1e3 * constant:.2g} ms). State what is known as `data.delay` and `data.filter`"
        f"{', what is not known as ' * bool(rest)}{rest}"
    )
