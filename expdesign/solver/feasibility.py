"""Motions within the limits: random starts, perturbed motions, and slightly infeasible ones.

A random or perturbed motion is scaled down about home until the smoothed model keeps every limit.

A solution that slightly violates the exact model is first corrected by the smallest change of its
coefficients that the linearised rows require: violations at a few moments then cost little of the
objective. The rest is removed by shrinking the motion about its centre. That costs more, and it
may fail: where the effects of rates and accelerations on a strut cancel, a smaller motion may
violate a limit that the larger one keeps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from scipy.optimize import brentq, nnls

from constraints.arrays import Array
from expdesign.configuration import ComputationError
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.problem.design_problem import DesignProblem
from expdesign.problem.program import Program, smoothing_gap
from expdesign.recheck.limit_check import grid_points, local_worst, states_at
from expdesign.robot import LimitModel
from expdesign.solver.phases import coarse_points
from expdesign.trajectory import FourierTrajectory

GRID_MARGIN = 5e-5
"""Share of each range that is kept free on the fine grid, for violations between its points."""
LARGEST_MARGIN = 0.2
"""Largest margin for the effect of smoothed friction, as a share of a range."""
SMALLEST_FACTOR = 0.8
"""Smallest factor by which a motion is shrunk."""

_DECAY = 0.7
_BISECTIONS = 16
_LARGEST_SHARE = 4.0
_INSIDE = 0.95
_HOP_NOISE = 0.3
"""Standard deviation in scaled variables; among 0.2, 0.3 and 0.45 the best (measured)."""
_HOP_BISECTIONS = 12
_HOP_INSIDE = 0.98
_STEPS = 4
_NO_DISTANCE = 1e-9
"""Residual of an inconsistent set of rows."""
_NEAR = 0.03
"""Distance from the bound, as a share of the range, within which a step holds a local worst: it
does not bring rows near their bounds that are farther away."""
_LITTLE = 0.98
"""Tried first: most motions need less, and few of their moments are near a bound."""
_RESOLUTION = 1e-6


class InfeasibleLimitsError(ComputationError):
    """Not even a very small trajectory keeps the limits."""


def random_start(
    problem: DesignProblem, rng: np.random.Generator, points: int, width: float
) -> Array:
    """Draw the scaled variables of a motion that keeps every limit, (z,).

    The amplitudes of harmonic k are normal with a standard deviation of k^−0.7 quarter reaches
    of their coordinate; ω is uniform in the upper half of its range. The motion is then scaled
    about home. The limits are tested at `points` of one period, with dry friction smoothed by
    `width`, m/s.

    Raises
    ------
    InfeasibleLimitsError
        Not even a minute motion about home keeps the limits.
    """
    variables = problem.variables
    table = np.zeros((COORDINATES, variables.per_coordinate))
    half = (variables.per_coordinate + 1) // 2
    decay = variables.orders**-_DECAY
    table[:, 0] = 0.3 * rng.normal(size=COORDINATES)
    table[:, 1:half] = 0.5 * decay[1:half] * rng.normal(size=(COORDINATES, half - 1))
    table[:, half:] = 0.5 * decay[half:] * rng.normal(size=(COORDINATES, half - 1))
    table *= variables.orders  # from reaches to scaled variables
    lower, upper = variables.bounds()
    omega = rng.uniform((lower[-1] + upper[-1]) / 2, upper[-1])
    phases = 2 * np.pi * np.arange(points) / points

    def is_kept(at: float, share: float) -> bool:
        candidate = np.append((share * table).ravel(), at)
        violations = problem.smooth_violations(candidate, phases, width)
        return bool(np.all(violations <= 0))

    for at in (omega, lower[-1]):
        share = _largest(partial(is_kept, at), 0.0, _LARGEST_SHARE, _BISECTIONS)
        if share > 0:
            return np.append((_INSIDE * share * table).ravel(), at)
    raise InfeasibleLimitsError(
        "no motion keeps the limits: even a minute one about home breaks "
        f"{_broken(problem, table, lower[-1], width)}"
    )


def _broken(problem: DesignProblem, table: Array, omega: float, width: float) -> str:
    share = _LARGEST_SHARE / 2**_BISECTIONS
    candidate = np.append((share * table).ravel(), omega)
    phases = 2 * np.pi * np.arange(64) / 64
    violations = np.max(problem.smooth_violations(candidate, phases, width), axis=0)
    broken = np.flatnonzero(violations > 0)
    keys = dict.fromkeys(problem.limits.keys[row] for row in broken)
    return ", ".join(keys) or "one of them"


def _largest(is_kept: Callable[[float], bool], low: float, high: float, steps: int) -> float:
    """Return by bisection the largest number that is kept, from `low`, which is."""
    for _ in range(steps):
        middle = (low + high) / 2
        low, high = (middle, high) if is_kept(middle) else (low, middle)
    return low


def perturb(problem: DesignProblem, origin: Array, rng: np.random.Generator, width: float) -> Array:
    """Add normal noise to scaled variables, (z,), and scale the motion until it keeps the limits.

    Dry friction is smoothed by `width`, m/s.
    """
    variables = problem.variables
    noise = rng.normal(size=(COORDINATES, variables.per_coordinate))
    table = origin[:-1].reshape(COORDINATES, -1) + _HOP_NOISE * noise
    lower, upper = variables.bounds()
    omega = np.clip(origin[-1] * np.exp(_HOP_NOISE * rng.normal()), lower[-1], upper[-1])
    points = coarse_points(variables.harmonics)
    phases = 2 * np.pi * np.arange(points) / points

    def motion(factor: float) -> Array:
        return np.append((factor * table).ravel(), omega)

    def is_kept(factor: float) -> bool:
        return bool(np.all(problem.smooth_violations(motion(factor), phases, width) <= 0))

    return motion(_HOP_INSIDE * _largest(is_kept, 0.0, 1.0, _HOP_BISECTIONS))


@dataclass(frozen=True)
class RestoredMotion:
    """A motion brought within the limits, and the factor of its amplitudes; 1: not shrunk."""

    trajectory: FourierTrajectory
    factor: float
    before: Array
    """(N, R), violations of the given motion at the instants of the grid."""
    values: Array
    """(N, R), limited quantities of the restored motion."""
    kept: bool = True
    """False if even `SMALLEST_FACTOR` violates a limit."""


def restore_limits(
    problem: DesignProblem,
    x: Array,
    margin: float,
    width: float,
    points: int | None = None,
) -> RestoredMotion:
    """Return a motion near that of scaled variables, (z,), that keeps all limits on a grid.

    ω is not changed. Friction is smoothed by `width`, m/s, in the derivatives; `margin` and
    `points` have the meaning of `shrink_to_limits`.
    """
    count = points or grid_points(problem.cost.samples)
    phases = 2 * np.pi * np.arange(count) / count
    before = violations = problem.limits.violations(problem.states(x, phases))
    reached, least = x, float(np.max(before))
    seen = np.zeros(before.shape, dtype=bool)
    for _ in range(_STEPS):
        if not -margin < least < np.inf:
            break
        # Moments of earlier steps stay: without their rows their violations come back.
        seen |= local_worst(violations, periodic=True) & (violations > -_NEAR)
        used = np.any(seen, axis=1)
        gap = smoothing_gap(
            problem.limits,
            problem.states(x, phases[used]),
            violations[used],
            width,
            0,
            periodic=True,
        )
        program = problem.program(
            phases[used],
            seen[used],
            width=width,
            level=0.0,
            samples=problem.cost.samples,
            margins=np.minimum(gap, LARGEST_MARGIN) + 2 * margin,
        )
        step = least_change(program, x)
        if step is None:
            break
        x = x + step
        violations = problem.limits.violations(problem.states(x, phases))
        worst = float(np.max(violations))
        if not worst < least:
            break
        reached, least = x, worst
    shrunk = shrink_to_limits(problem, problem.variables.trajectory(reached), margin, points)
    return replace(shrunk, before=before)


def least_change(program: Program, x: Array) -> Array | None:
    """Return the shortest step, (z,), that satisfies the linearised rows; None without one.

    The last variable does not change. By Lawson and Hanson's least distance programming (Solving
    Least Squares Problems, 1974, chapter 23): with G d ≥ h, d follows from the residual of the
    nonnegative least squares problem min |Gᵀu|² + (hᵀu − 1)².
    """
    rows = program.linear_rows(x)
    above, below = rows.values - program.row_upper, program.row_lower - rows.values
    upper = above > below
    jacobian = np.where(upper, -1.0, 1.0)[:, None] * rows.jacobian()[:, :-1]
    matrix = np.vstack([jacobian.T, np.where(upper, above, below)])
    if not np.all(np.isfinite(matrix)):
        return None
    target = np.zeros(len(matrix))
    target[-1] = 1.0
    try:
        weights, distance = nnls(matrix, target)
    except RuntimeError:  # no convergence within three times as many iterations as there are rows
        return None
    if not distance > _NO_DISTANCE:
        return None
    residual = matrix @ weights - target
    return np.append(-residual[:-1] / residual[-1], 0.0)


def shrink_to_limits(
    problem: DesignProblem,
    trajectory: FourierTrajectory,
    margin: float = GRID_MARGIN,
    points: int | None = None,
) -> RestoredMotion:
    """Return the largest multiple (≤ 1) of a motion that keeps all limits on a grid.

    Parameters
    ----------
    margin : float
        Share of each limit's range that is kept free.
    points : int, optional
        Points of the grid over one period; by default those of the fine grid.
    """
    times = trajectory.sample_times(points or grid_points(problem.cost.samples))
    values = problem.limits.values(states_at(trajectory, times))
    rows = problem.limits.excess(values)
    if np.all(rows <= -margin):
        return RestoredMotion(trajectory, 1.0, rows, values)
    for smallest in (_LITTLE, SMALLEST_FACTOR):
        # Decisive are the local worst moments of each row near its bound: shrinking hardly moves
        # them, and the distance admits motions shrunk by the smallest factor.
        near_bound = np.isfinite(rows) & (rows > -2 * (1 - smallest))
        peaks = local_worst(rows, periodic=True) & near_bound
        decisive = peaks | np.roll(peaks, 1, axis=0) | np.roll(peaks, -1, axis=0) | (rows > 0)
        near, limits = times[np.any(decisive, axis=1)], problem.limits.among(decisive)

        @cache
        def excess(factor: float, near: Array = near, limits: LimitModel = limits) -> float:
            states = states_at(_scale(trajectory, factor), near)
            worst = np.max(limits.violations(states), initial=-1.0)
            # NaN counts as a violation.
            return float(np.nan_to_num(np.clip(worst, -1.0, 1.0), nan=1.0)) + margin

        if excess(smallest) > 0:
            continue
        factor = brentq(excess, smallest, 1.0, xtol=_RESOLUTION) if excess(1.0) > 0 else 1.0
        while excess(factor) > 0:
            factor -= _RESOLUTION
        shrunk = _scale(trajectory, factor)
        values = problem.limits.values(states_at(shrunk, times))
        # Rows that were far from their bounds may now be near.
        if smallest == SMALLEST_FACTOR or not np.any(problem.limits.excess(values) > 0):
            return RestoredMotion(shrunk, factor, rows, values)
    shrunk = _scale(trajectory, SMALLEST_FACTOR)
    values = problem.limits.values(states_at(shrunk, times))
    return RestoredMotion(shrunk, SMALLEST_FACTOR, rows, values, kept=False)


def _scale(trajectory: FourierTrajectory, factor: float) -> FourierTrajectory:
    return replace(trajectory, mu=factor * trajectory.mu, nu=factor * trajectory.nu)
