"""Where the search for a ramp starts: simple motions between its ends, the least bad first."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from constraints.arrays import Array
from expdesign.motion.limits import moving_states
from expdesign.motion.ramp_problem import RampProblem
from expdesign.motion.spline import FIXED, MotionState, SplineRamp, derivatives
from expdesign.recheck.limit_check import Motion

_DURATIONS: list[float] = (0.05 * 1.35 ** np.arange(30)).tolist()
"""Of the polynomials that are tried: 50 ms to 5 min."""
_FADES = (0.25, 0.5, 1.0)
_SHARES = np.linspace(0.0, 1.0, 200)


def guesses(problem: RampProblem, orbit: Motion, period: float, width: float) -> list[SplineRamp]:
    """Return ramps between the problem's ends, sorted by how much they break the limits.

    Polynomials of fifth order through both ends, of many durations, and the periodic motion
    itself with an amplitude that grows from zero (or fades to it). Those that keep every limit
    come first, the shortest of them before the others. `orbit` is the periodic motion on the
    ramp's own time axis, which begins (ramp in: ends) at 0; dry friction has a width in m/s.
    """
    fades = [_faded(problem, orbit, share * period) for share in _FADES]
    return _ranked(problem, [*polynomials(problem, width), *fades], width)


def polynomials(problem: RampProblem, width: float) -> list[SplineRamp]:
    """Return the polynomials of fifth order alone, in the same order."""
    return _ranked(problem, [_polynomial(problem, duration) for duration in _DURATIONS], width)


def pause_near(problem: RampProblem, width: float, *, arriving: bool) -> RampProblem:
    """Return the problem from rest close to the orbit into it, or out of it to rest.

    The pose at rest is the one from which (to which) the speed grows or fades as a cubic does, in
    the time in which that breaks the limits least: v T/2 − a T²/12 from where the orbit has the
    rate v and the acceleration a.

    Parameters
    ----------
    arriving : bool
        Whether the orbit is at the problem's end.
    """
    orbit = problem.end if arriving else problem.start
    sign = 1.0 if arriving else -1.0

    def paused(duration: float) -> RampProblem:
        way = sign * orbit.rate * duration / 2 - orbit.acceleration * duration**2 / 12
        rest = MotionState.at_rest(orbit.pose - way)
        return replace(problem, start=rest) if arriving else replace(problem, end=rest)

    tried = [(paused(duration), duration) for duration in _DURATIONS]
    best, _ = min(tried, key=lambda one: _worst(one[0], _polynomial(*one), width))
    return best


def _ranked(problem: RampProblem, ramps: Iterable[SplineRamp], width: float) -> list[SplineRamp]:
    return sorted(ramps, key=lambda ramp: (max(_worst(problem, ramp, width), 0.0), ramp.duration))


def _worst(problem: RampProblem, ramp: SplineRamp, width: float) -> float:
    states = moving_states(ramp, _SHARES * ramp.duration)
    return float(np.max(problem.limits.smooth_violations(states, width)))


def _polynomial(problem: RampProblem, duration: float) -> SplineRamp:
    # One piece has six control points: the ends determine them all.
    ends = replace(problem, intervals=1).at_duration(duration)
    return _fitted(problem, duration, derivatives(1, _SHARES)[0] @ ends)


def _faded(problem: RampProblem, orbit: Motion, duration: float) -> SplineRamp:
    home = problem.limits.robot.home
    arriving = np.array_equal(problem.start.pose, home)
    times = (_SHARES - 1) * duration if arriving else _SHARES * duration
    grown = _SHARES if arriving else 1 - _SHARES
    weight = grown**3 * (10 - 15 * grown + 6 * grown**2)
    poses = home + weight[:, None] * (orbit.sample(times).pose - home)
    return _fitted(problem, duration, poses)


def _fitted(problem: RampProblem, duration: float, poses: Array) -> SplineRamp:
    """Return the ramp between the problem's ends that is closest to the poses."""
    basis = derivatives(problem.intervals, _SHARES)[0]
    coefficients = problem.at_duration(duration)
    coefficients[FIXED:-FIXED] = 0.0
    left = poses - basis @ coefficients
    inner, *_ = np.linalg.lstsq(basis[:, FIXED:-FIXED], left, rcond=None)
    coefficients[FIXED:-FIXED] = inner
    return SplineRamp("guess", duration, coefficients)
