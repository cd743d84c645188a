"""Where solves set out from: random motions, and good ones thrown out of their basin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, nnls

from constraints.arrays import Array
from expdesign.configuration import ComputationError
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.problem.design_problem import DesignProblem, LimitedProgram, hidden_by_smoothing
from expdesign.recheck.limit_check import grid_points, local_worst, states_at
from expdesign.robot import LimitModel
from expdesign.solver.phases import coarse_points
from expdesign.trajectory import FourierTrajectory

_DECAY = 0.7
_BISECTIONS = 16
_LARGEST_SHARE = 4.0
_INSIDE = 0.95
_HOP_NOISE = 0.3
"""In scaled variables; of 0.2, 0.3 and 0.45 it gains most (measured)."""
_HOP_BISECTIONS = 12
_HOP_INSIDE = 0.98


class InfeasibleLimitsError(ComputationError):
    """No trajectory was found that keeps the limits, not even a very small one."""


def random_start(
    problem: DesignProblem, rng: np.random.Generator, points: int, width: float
) -> Array:
    """Draw amplitudes, then shrink the motion about home until every limit is kept.

    The amplitudes of harmonic k are normal with a standard deviation of k^−0.7 quarter reaches
    of their coordinate; ω is uniform in the upper half of its range. The limits are tested at
    `points` of one period, with dry friction smoothed by `width`, m/s.

    Raises
    ------
    InfeasibleLimitsError
        Not even a motion of 1e-4 of the drawn size keeps the limits.
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

    def kept(at: float, share: float) -> bool:
        candidate = np.append((share * table).ravel(), at)
        violations = problem.smooth_violations(candidate, phases, width)
        return bool(np.all(violations <= 0))

    for at in (omega, lower[-1]):
        share = largest(partial(kept, at), 0.0, _LARGEST_SHARE, _BISECTIONS)
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


def largest(kept: Callable[[float], bool], low: float, high: float, steps: int) -> float:
    """Return by bisection the largest number that is kept; `low` is taken to be."""
    for _ in range(steps):
        middle = (low + high) / 2
        low, high = (middle, high) if kept(middle) else (low, middle)
    return low


def perturbed(
    problem: DesignProblem, origin: Array, rng: np.random.Generator, width: float
) -> Array:
    """Add normal noise to the scaled variables, then shrink the motion into its limits.

    `origin` has scaled variables (z,); dry friction has a width in m/s.
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

    def kept(factor: float) -> bool:
        return bool(np.all(problem.smooth_violations(motion(factor), phases, width) <= 0))

    return motion(_HOP_INSIDE * largest(kept, 0.0, 1.0, _HOP_BISECTIONS))


_STEPS = 4
LARGEST_MARGIN = 0.2
"""Share of a range that covers what smoothed friction hides, at most."""
_NO_DISTANCE = 1e-9
"""Residual of what no step keeps."""
_NEAR = 0.03
"""Share of its range within which a local worst of a row is held in a step: what is farther from
its bound does not come near by it."""

SMALLEST_FACTOR = 0.8
_LITTLE = 0.98
"""Tried first: most motions need less, and few of their moments are near a bound."""
_RESOLUTION = 1e-6

GRID_MARGIN = 5e-5
"""Share of each range that is kept free on the fine grid: what it can miss between its points."""


@dataclass(frozen=True)
class Shrunk:
    """A motion and the factor that its amplitudes were multiplied by; 1: not at all."""

    trajectory: FourierTrajectory
    factor: float
    before: Array
    """(N, R), violations of the motion as it was given, at the grid's instants."""
    values: Array
    """(N, R), limited quantities of the shrunk one."""
    kept: bool = True
    """False when even `SMALLEST_FACTOR` breaks a limit."""


def brought_within(
    problem: DesignProblem,
    x: Array,
    margin: float,
    width: float,
    points: int | None = None,
) -> Shrunk:
    """Return a motion near that of scaled variables, (z,), that keeps all limits on a grid.

    Margin and points are those of `shrink_to_limits`; friction is smoothed by `width`, m/s, in the
    derivatives. ω stays. `before` of what comes back is of the motion that was given.
    """
    count = points or grid_points(problem.cost.samples)
    phases = 2 * np.pi * np.arange(count) / count
    before = violations = problem.limits.violations(problem.states(x, phases))
    reached, least = x, float(np.max(before))
    seen = np.zeros(before.shape, dtype=bool)
    for _ in range(_STEPS):
        if not -margin < least < np.inf:
            break
        # Moments of the steps before stay: without their rows what they held comes back.
        seen |= local_worst(violations, periodic=True) & (violations > -_NEAR)
        used = np.any(seen, axis=1)
        hidden = hidden_by_smoothing(
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
            margins=np.minimum(hidden, LARGEST_MARGIN) + 2 * margin,
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


def least_change(program: LimitedProgram, x: Array) -> Array | None:
    """Return the shortest step, (z,), to where a program's linear rows are kept; None without one.

    The last variable stays. By Lawson and Hanson's least distance programming (Solving Least
    Squares Problems, 1974, chapter 23): with G d ≥ h, d is read off the residual of the nonnegative
    least squares problem min |Gᵀu|² + (hᵀu − 1)².
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
    except RuntimeError:  # it gives up after three times as many iterations as there are rows
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
) -> Shrunk:
    """Return the largest multiple (≤ 1) of a motion that keeps all limits on a grid.

    The margin is the share of each limit's range that is kept free; the grid has so many points of
    a period, by default those of the fine grid.
    """
    times = trajectory.sample_times(points or grid_points(problem.cost.samples))
    values = problem.limits.values(states_at(trajectory, times))
    rows = problem.limits.excess(values)
    if np.all(rows <= -margin):
        return Shrunk(trajectory, 1.0, rows, values)
    for smallest in (_LITTLE, SMALLEST_FACTOR):
        # The moments that decide are the worst ones of each row; shrinking moves them little.
        decisive = _decisive(rows, smallest)
        near, limits = times[np.any(decisive, axis=1)], problem.limits.among(decisive)

        @cache
        def excess(factor: float, near: Array = near, limits: LimitModel = limits) -> float:
            states = states_at(_scaled(trajectory, factor), near)
            worst = np.max(limits.violations(states), initial=-1.0)
            # What is not a number is not kept either.
            return float(np.nan_to_num(np.clip(worst, -1.0, 1.0), nan=1.0)) + margin

        if excess(smallest) > 0:
            continue
        factor = brentq(excess, smallest, 1.0, xtol=_RESOLUTION) if excess(1.0) > 0 else 1.0
        while excess(factor) > 0:
            factor -= _RESOLUTION
        shrunk = _scaled(trajectory, factor)
        values = problem.limits.values(states_at(shrunk, times))
        # What was far from its bound may have come near.
        if smallest == SMALLEST_FACTOR or not np.any(problem.limits.excess(values) > 0):
            return Shrunk(shrunk, factor, rows, values)
    shrunk = _scaled(trajectory, SMALLEST_FACTOR)
    values = problem.limits.values(states_at(shrunk, times))
    return Shrunk(shrunk, SMALLEST_FACTOR, rows, values, kept=False)


def _decisive(rows: Array, smallest: float) -> NDArray[np.bool_]:
    """Mark the moments at which a row has a local worst that is near its bound, (N, R).

    Near enough for a motion that is not shrunk by more than a factor.
    """
    peaks = local_worst(rows, periodic=True) & np.isfinite(rows) & (rows > -2 * (1 - smallest))
    return peaks | np.roll(peaks, 1, axis=0) | np.roll(peaks, -1, axis=0) | (rows > 0)


def _scaled(trajectory: FourierTrajectory, factor: float) -> FourierTrajectory:
    return replace(trajectory, mu=factor * trajectory.mu, nu=factor * trajectory.nu)
