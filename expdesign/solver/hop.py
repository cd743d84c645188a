"""A hop: the best trajectory so far, thrown out of its basin but not out of its limits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from expdesign.problem import DesignProblem
from expdesign.solver.continuation import coarse_points

Array = NDArray[np.float64]

_SIZES = (0.05, 0.1, 0.2)
_BISECTIONS = 12
_INSIDE = 0.98


def perturbed(
    problem: DesignProblem, origin: Array, rng: np.random.Generator, width: float
) -> Array:
    """Add normal noise to the scaled variables, then shrink the motion into its limits.

    The noise of harmonic k falls as 1/k; its size is drawn from three orders, because neither
    small nor large hops alone find the better basins.

    Parameters
    ----------
    problem : DesignProblem
    origin : (z,)
        Scaled variables.
    rng : numpy Generator
    width : float
        Smoothing of dry friction, m/s.
    """
    variables = problem.variables
    n = variables.harmonics
    size = rng.choice(_SIZES)
    noise = rng.normal(size=(6, variables.per_coordinate)) / variables.orders
    table = origin[:-1].reshape(6, -1) + size * noise
    lower, upper = variables.bounds()
    omega = np.clip(origin[-1] * np.exp(size * rng.normal()), lower[-1], upper[-1])
    points = coarse_points(n)
    phases = 2 * np.pi * np.arange(points) / points

    def motion(factor: float) -> Array:
        return np.append((factor * table).ravel(), omega)

    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        factor = (low + high) / 2
        violations = problem.smooth_violations(motion(factor), phases, width)
        low, high = (factor, high) if np.all(violations <= 0) else (low, factor)
    return motion(_INSIDE * low)
