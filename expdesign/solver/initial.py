"""Where solves set out from: random motions, and good ones thrown out of their basin."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import ComputationError
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.problem.design_problem import DesignProblem
from expdesign.solver.continuation import coarse_points

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
