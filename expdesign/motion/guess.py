"""Where the search for a ramp starts: simple motions between its ends, the least bad first."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.motion.limits import moving_states
from expdesign.motion.ramp_problem import RampProblem
from expdesign.motion.spline import FIXED, SplineRamp, derivatives
from expdesign.recheck import Motion

_POINTS = 200
_SHORTEST, _GROWTH, _COUNT = 0.05, 1.35, 20
"""Durations of the polynomials that are tried: 50 ms to 15 s."""
_FADES = (0.25, 0.5, 1.0)


def guesses(problem: RampProblem, orbit: Motion, period: float, width: float) -> list[SplineRamp]:
    """Return ramps between the problem's ends, sorted by how much they break the limits.

    Polynomials of fifth order through both ends, of many durations, and the periodic motion
    itself with an amplitude that grows from zero (or fades to it). Those that keep every limit
    come first, the shortest of them before the others.

    Parameters
    ----------
    orbit : Motion
        The periodic motion on the ramp's own time axis, which begins (ramp in: ends) at 0.
    period : float
        Its period, s.
    width : float
        Smoothing of dry friction, m/s.
    """
    shares = np.linspace(0.0, 1.0, _POINTS)
    found = []
    durations = _SHORTEST * _GROWTH ** np.arange(_COUNT)
    ramps = [_polynomial(problem, float(duration), shares) for duration in durations]
    ramps += [_faded(problem, orbit, share * period, shares) for share in _FADES]
    for ramp in ramps:
        states = moving_states(ramp, shares * ramp.duration)
        worst = float(np.max(problem.limits.smooth_violations(states, width)))
        found.append((max(worst, 0.0), ramp.duration, ramp))
    found.sort(key=lambda entry: entry[:2])
    return [ramp for _, _, ramp in found]


def _polynomial(problem: RampProblem, duration: float, shares: Array) -> SplineRamp:
    # One piece has six control points: the ends determine them all.
    ends = problem.with_intervals(1).at_duration(duration)
    return _fitted(problem, duration, shares, derivatives(1, shares)[0] @ ends)


def _faded(problem: RampProblem, orbit: Motion, duration: float, shares: Array) -> SplineRamp:
    home = problem.limits.robot.home
    arriving = np.array_equal(problem.start.pose, home)
    times = (shares - 1) * duration if arriving else shares * duration
    grown = shares if arriving else 1 - shares
    weight = grown**3 * (10 - 15 * grown + 6 * grown**2)
    poses = home + weight[:, None] * (orbit.sample(times).pose - home)
    return _fitted(problem, duration, shares, poses)


def _fitted(problem: RampProblem, duration: float, shares: Array, poses: Array) -> SplineRamp:
    """Return the ramp between the problem's ends that is closest to the poses."""
    basis = derivatives(problem.intervals, shares)[0]
    coefficients = problem.at_duration(duration)
    coefficients[FIXED:-FIXED] = 0.0
    left = poses - basis @ coefficients
    inner, *_ = np.linalg.lstsq(basis[:, FIXED:-FIXED], left, rcond=None)
    coefficients[FIXED:-FIXED] = inner
    return SplineRamp("guess", duration, coefficients)
