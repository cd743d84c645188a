"""The search for the shortest ramp between two states of motion that keeps every limit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.configuration import ComputationError
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.motion.executable import enclose_segment, moving_states
from expdesign.motion.ramp import (
    FIXED,
    MotionState,
    RampProblem,
    RampProgram,
    SplineRamp,
    derivatives,
)
from expdesign.problem.program import smoothing_gap
from expdesign.progress import report_progress
from expdesign.recheck.certificate import certify
from expdesign.recheck.limit_check import (
    TOLERANCE,
    LimitCheck,
    Motion,
    local_worst,
    range_share_in_words,
    worst_sampled,
)
from expdesign.solver.interior_point import Standstill, solve_by_interior_point

RESERVE = 2e-3
"""Share of every limit's range that a ramp leaves free, away from its ends: for the rounding and
interpolation of a controller."""
LONGER = 5e-3
"""Share by which the duration found is lengthened before it is rounded up to whole steps."""
_ATTEMPTS = 4
_CLOSE_ENOUGH = 0.3
_LOST = 0.01
_DIFFERENT = 1.3
_ROUNDS = 12
_ROUNDS_PER_DURATION = 3
_STRETCH = 0.02
_POINTS = 48
_FINE = 1200
_NEAR, _NEAR_PEAK = 0.25, 0.02
_FEASIBLE = 1e-6
_END_SHARE = 0.1
_LARGEST_MARGIN = 0.2
_TIME_SMOOTHNESS = 2e-4
_EXACT = Standstill(feasible=_FEASIBLE)
_solved = partial(solve_by_interior_point, most=40, barrier=0.03, following=False)
"""More iterations, or a larger barrier, end in longer ramps (measured)."""


class NoRampError(ComputationError):
    """No ramp keeps every limit; `name` is ``"ramp in"`` or ``"ramp out"``."""

    def __init__(self, name: str, limit: str, message: str) -> None:
        super().__init__(message)
        self.name, self.limit = name, limit


@dataclass(frozen=True)
class RampAttempt:
    """A ramp from the minimisation of its duration."""

    x: Array
    problem: RampProblem
    violation: float
    """Worst excess of the smoothed rows as a share of their range."""
    limit: str

    @property
    def duration(self) -> float:
        """Duration reached, s."""
        return self.problem.duration(self.x)

    @property
    def promise(self) -> float:
        """Duration, longer if limits are broken, s: the smaller, the better."""
        return self.duration * (1 + 10 * max(self.violation, 0.0))


def shortest(
    problem: RampProblem, guess: SplineRamp, width: float, points: int = _POINTS
) -> RampAttempt:
    """Minimise the duration from a guess, with dry friction smoothed by `width`, m/s.

    Limits are imposed at `points` instants; violated rows are added.
    """
    problem = replace(problem, time_scale=guess.duration)
    x = problem.pack(guess)
    shares = _nodes(points)
    inside = ((shares > 0) & (shares < 1))[:, None] | problem.limits.of_jerk
    basis, fine = (problem.basis(one) for one in (shares, np.linspace(0.0, 1.0, 4 * points)))
    mask: Mask = np.zeros((len(shares), len(problem.limits.keys)), dtype=bool)
    lower, upper = problem.limits.smooth_bounds()
    bounded = np.isfinite(lower) | np.isfinite(upper)
    for attempt in range(_ROUNDS_PER_DURATION):
        margins = _cap_shares(problem, x, shares, width, np.full(mask.shape, RESERVE))
        violations = problem.limits.smooth_violations(problem.states(x, basis), width)
        broken = (violations > _FEASIBLE - margins) & inside & ~mask
        if attempt and not np.any(broken):
            break
        # A shorter motion changes every row that moves, not only those near their bounds.
        near = (violations > -_NEAR) | (problem.limits.moving & bounded)
        mask = mask | broken | (near & inside)
        program = RampProgram(problem, shares, mask, margins, width, _TIME_SMOOTHNESS)
        found = _solved(program, x).x
        if program.excess(found) > _LOST:
            break
        x = found
    violations = problem.limits.smooth_violations(problem.states(x, fine), width)
    _, row = np.unravel_index(int(np.argmax(violations)), violations.shape)
    worst = float(np.max(violations))
    return RampAttempt(x, problem, worst, problem.limits.keys[row])


def find_ramp(
    problem: RampProblem, guesses: Sequence[SplineRamp], name: str, step: float, width: float
) -> SplineRamp:
    """Return the shortest ramp found with a whole number of controller steps of `step` s.

    The search starts from the guesses in this order; those of almost the same duration count once.
    Dry friction is smoothed by `width`, m/s.

    Raises
    ------
    NoRampError
        None of the attempts keeps every limit.
    """
    attempts = []
    for guess in _different(guesses):
        report_progress(f"lead-in and lead-out: the {name}, a guess of {guess.duration:.2g} s")
        attempts.append(shortest(problem, guess, width))
    if not attempts:
        raise ValueError("there is no guess to start from")
    attempts.sort(key=lambda one: one.promise)
    found: SplineRamp | None = None
    for number, attempt in enumerate(attempts):
        if attempt.violation < _CLOSE_ENOUGH and (
            found is None or attempt.duration < found.duration
        ):
            ramp, attempts[number] = _settle_duration(attempt, name, step, width, found)
            found = ramp or found
    found = found or _plain_ramp(problem, guesses, name, step)
    if found is not None:
        return found
    best = min(attempts, key=lambda one: one.violation)
    raise NoRampError(
        name,
        best.limit,
        f"no {name} was found that keeps every limit: the best attempt, of "
        f"{best.duration:.3g} s, breaks {best.limit} by "
        f"{range_share_in_words(best.violation)}",
    )


def _different(guesses: Sequence[SplineRamp]) -> list[SplineRamp]:
    """Return the first guesses of different durations."""
    kept: list[SplineRamp] = []
    for guess in guesses:
        ratios = [guess.duration / other.duration for other in kept]
        if len(kept) < _ATTEMPTS and all(max(r, 1 / r) >= _DIFFERENT for r in ratios):
            kept.append(guess)
    return kept


def _plain_ramp(
    problem: RampProblem, guesses: Sequence[SplineRamp], name: str, step: float
) -> SplineRamp | None:
    """Return the shortest guess that keeps every limit; slow but safe.

    Guesses with the reserve are preferred; none has it if the designed motion touches a limit at
    the end of the ramp.
    """
    kept: SplineRamp | None = None
    for guess in sorted(guesses, key=lambda ramp: ramp.duration):
        duration = int(np.ceil(guess.duration / step - 1e-9)) * step
        scaled = replace(problem, time_scale=duration)
        x = np.append(scaled.pack(guess)[:-1], 1.0)
        ramp = replace(scaled.ramp(x, name), duration=duration)
        worst = _worst_limit(scaled, ramp)
        if worst.possible <= -RESERVE:
            return ramp
        if worst.possible <= TOLERANCE and kept is None:
            kept = ramp
    return kept


def _settle_duration(
    attempt: RampAttempt, name: str, step: float, width: float, known: SplineRamp | None
) -> tuple[SplineRamp | None, RampAttempt]:
    """Solve for the smoothest ramp of whole steps until the unsmoothed model keeps every limit.

    The duration grows if there is none, or if the margins for the smoothing do not converge.
    """
    problem, x = attempt.problem, attempt.x
    steps = int(np.ceil(attempt.duration * (1 + LONGER) / step - 1e-9))
    since, stretch = 0, _STRETCH
    used = np.zeros((_FINE + 1, len(problem.limits.keys)), dtype=bool)
    for number in range(_ROUNDS):
        if known is not None and steps * step >= known.duration:
            break
        report_progress(
            f"lead-in and lead-out: the {name} at {steps * step:.3g} s", number, _ROUNDS
        )
        x = np.append(x[:-1], steps * step / problem.time_scale)
        critical, margins = _critical_rows(problem, x, width)
        # Without the rows of earlier rounds their violations would come back.
        used |= critical
        program = RampProgram(problem, _fine_grid(), used, margins, width, 1.0)
        result = _solved(program.smoothest(x), x, most=60, barrier=0.1, standstill=_EXACT)
        excess = program.excess(result.x)
        if excess > _CLOSE_ENOUGH:
            break
        possible = excess < 10 * _FEASIBLE
        x, since = result.x, since + 1
        ramp = replace(problem.ramp(x, name), duration=steps * step)
        worst = _worst_limit(problem, ramp)
        attempt = RampAttempt(x, problem, worst.possible, worst.key)
        if worst.possible <= TOLERANCE:
            return ramp, attempt
        if not possible or since == _ROUNDS_PER_DURATION:
            steps, since = steps + max(1, int(np.ceil(stretch * steps))), 0
            # If friction binds, steps of 2 % take endless rounds: the second is 4 %, …
            stretch *= 2
            used[:] = False
    return None, attempt


def _worst_limit(problem: RampProblem, ramp: SplineRamp) -> LimitCheck:
    """Return the limit with the largest violation at many instants, or by proof if all are kept."""
    times = ramp.duration * _fine_grid()
    values = problem.limits.values(moving_states(ramp, times))
    sampled = worst_sampled(problem.limits, times, values)
    worst = max(sampled, key=lambda check: check.violation)
    return worst_limit(problem, ramp) if worst.kept else worst


def worst_limit(problem: RampProblem, ramp: SplineRamp) -> LimitCheck:
    """Return the limit with the largest possible excess of a ramp at any instant."""
    return max(certify(problem.limits, enclose_segment(ramp)), key=lambda check: check.possible)


def _nodes(points: int) -> Array:
    """Return the instants with limits as shares of the duration, denser towards both ends."""
    return (1 - np.cos(np.pi * np.arange(points + 1) / points)) / 2


def _fine_grid() -> Array:
    return np.linspace(0.0, 1.0, _FINE + 1)


def _critical_rows(problem: RampProblem, x: Array, width: float) -> tuple[Mask, Array]:
    """Choose the decisive rows of the fine grid, with margins, (K, R) each.

    Instants are the nodes and every local worst of the unsmoothed rows. A row's margin is the
    largest excess of the unsmoothed value over the smoothed one nearby: that covers the jumps of
    dry friction at sign changes.
    """
    fine, limits = _fine_grid(), problem.limits
    states = problem.states(x, problem.basis(fine))
    exact = limits.violations(states)
    reach = _FINE // (2 * _POINTS)
    hidden = smoothing_gap(limits, states, exact, width, reach, periodic=False)
    margins = _cap_shares(problem, x, fine, width, np.minimum(hidden + RESERVE, _LARGEST_MARGIN))
    peaks = local_worst(exact, periodic=False) & (exact > -_NEAR_PEAK)
    regular = np.zeros(len(fine), dtype=bool)
    regular[np.rint(_nodes(_POINTS) * _FINE).astype(int)] = True
    near = ((exact > -_NEAR) | limits.moving) & np.isfinite(exact)
    used = (regular[:, None] & near) | peaks
    used[[0, -1]] &= limits.of_jerk
    return used, margins


def _cap_shares(
    problem: RampProblem, x: Array, shares: Array, width: float, margins: Array
) -> Array:
    """Let margins fade towards both ends, (K, R), whose states are given.

    A row without room at an end, or broken there in its smoothed form, regains room with the cube
    of the time, like a motion of constant jerk. So does one without room on the continuation with
    constant acceleration, up to its natural bound.
    """
    duration = problem.duration(x)
    given = ~problem.limits.of_jerk
    for end, distance, sign in ((problem.start, shares, 1.0), (problem.end, 1 - shares, -1.0)):
        near = distance < _END_SHARE
        passed = sign * duration * np.append(0.0, distance[near])[:, None]
        led = (
            end.pose + passed * end.rate + passed**2 / 2 * end.acceleration,
            end.rate + passed * end.acceleration,
            np.broadcast_to(end.acceleration, (len(passed), COORDINATES)),
            np.zeros((len(passed), COORDINATES)),
        )
        rooms = -problem.limits.smooth_violations(np.hstack(led), width)
        room = rooms[0] + np.zeros(margins.shape)
        room[near] = np.minimum(rooms[0], np.maximum(rooms[1:], np.minimum(rooms[0], 0.0)))
        grown = _LARGEST_MARGIN * (distance / _END_SHARE) ** 3
        margins = np.where(given, np.minimum(margins, room + grown[:, None]), margins)
    return margins


_DURATIONS: list[float] = (0.05 * 1.35 ** np.arange(30)).tolist()
"""Durations of polynomial guesses, s: 50 ms to 5 min."""
_FADES = (0.25, 0.5, 1.0)
_SHARES = np.linspace(0.0, 1.0, 200)


def guesses(problem: RampProblem, orbit: Motion, period: float, width: float) -> list[SplineRamp]:
    """Return ramps between the problem's ends, sorted by their violation of the limits.

    They are polynomials of fifth order through both ends, of many durations, and the periodic
    motion with an amplitude that grows from zero (or fades to it). Those that keep every limit
    come first, the shortest of them before the others. `orbit` is the periodic motion on the
    ramp's own time axis, which begins (ramp in: ends) at 0; dry friction has a width in m/s.
    """
    fades = [_fade_orbit(problem, orbit, share * period) for share in _FADES]
    return _rank_guesses(problem, [*polynomials(problem, width), *fades], width)


def polynomials(problem: RampProblem, width: float) -> list[SplineRamp]:
    """Return the polynomials of fifth order alone, in the same order."""
    return _rank_guesses(
        problem, [_polynomial(problem, duration) for duration in _DURATIONS], width
    )


def pause_near(problem: RampProblem, width: float, *, arriving: bool) -> RampProblem:
    """Return the problem of a ramp between rest near the orbit and the orbit.

    Between the pose at rest and the orbit the speed is a cubic of time: the pose is
    v T/2 − a T²/12 away from the point of the orbit with rate v and acceleration a, and T is the
    duration that breaks the limits least.

    Parameters
    ----------
    arriving : bool
        Whether the orbit is at the problem's end.
    """
    orbit = problem.end if arriving else problem.start
    sign = 1.0 if arriving else -1.0

    def problem_from_rest(duration: float) -> RampProblem:
        distance = sign * orbit.rate * duration / 2 - orbit.acceleration * duration**2 / 12
        rest = MotionState.at_rest(orbit.pose - distance)
        return replace(problem, start=rest) if arriving else replace(problem, end=rest)

    tried = [(problem_from_rest(duration), duration) for duration in _DURATIONS]
    best, _ = min(tried, key=lambda one: _worst(one[0], _polynomial(*one), width))
    return best


def _rank_guesses(
    problem: RampProblem, ramps: Iterable[SplineRamp], width: float
) -> list[SplineRamp]:
    return sorted(ramps, key=lambda ramp: (max(_worst(problem, ramp, width), 0.0), ramp.duration))


def _worst(problem: RampProblem, ramp: SplineRamp, width: float) -> float:
    states = moving_states(ramp, _SHARES * ramp.duration)
    return float(np.max(problem.limits.smooth_violations(states, width)))


def _polynomial(problem: RampProblem, duration: float) -> SplineRamp:
    # One piece has six control points: the ends determine them all.
    ends = replace(problem, intervals=1).at_duration(duration)
    return _fit_spline(problem, duration, derivatives(1, _SHARES)[0] @ ends)


def _fade_orbit(problem: RampProblem, orbit: Motion, duration: float) -> SplineRamp:
    home = problem.limits.robot.home
    arriving = np.array_equal(problem.start.pose, home)
    times = (_SHARES - 1) * duration if arriving else _SHARES * duration
    grown = _SHARES if arriving else 1 - _SHARES
    weight = grown**3 * (10 - 15 * grown + 6 * grown**2)
    poses = home + weight[:, None] * (orbit.sample(times).pose - home)
    return _fit_spline(problem, duration, poses)


def _fit_spline(problem: RampProblem, duration: float, poses: Array) -> SplineRamp:
    """Return the ramp between the problem's ends with the smallest distance from the poses."""
    basis = derivatives(problem.intervals, _SHARES)[0]
    coefficients = problem.at_duration(duration)
    coefficients[FIXED:-FIXED] = 0.0
    left = poses - basis @ coefficients
    inner, *_ = np.linalg.lstsq(basis[:, FIXED:-FIXED], left, rcond=None)
    coefficients[FIXED:-FIXED] = inner
    return SplineRamp("guess", duration, coefficients)
