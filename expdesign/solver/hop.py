"""A hop: a good trajectory, thrown out of its basin, solved and finished again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.problem import DesignProblem
from expdesign.solver.continuation import coarse_points
from expdesign.solver.stage import StageRecord

_SIZES = (0.1, 0.2, 0.4)
_BEHIND = {"hop": 0.03, "sharp": 0.01}
"""Cost by which a hop may be behind. One per cent: the finish was seen to gain so unevenly."""
_BISECTIONS = 12
_INSIDE = 0.98


def perturbed(
    problem: DesignProblem, origin: Array, rng: np.random.Generator, width: float
) -> Array:
    """Add normal noise to the scaled variables, then shrink the motion into its limits.

    The size of the noise is drawn from three orders, because neither small nor large hops alone
    find the better basins.

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
    size = rng.choice(_SIZES)
    noise = rng.normal(size=(6, variables.per_coordinate))
    table = origin[:-1].reshape(6, -1) + size * noise
    lower, upper = variables.bounds()
    omega = np.clip(origin[-1] * np.exp(size * rng.normal()), lower[-1], upper[-1])
    points = coarse_points(variables.harmonics)
    phases = 2 * np.pi * np.arange(points) / points

    def motion(factor: float) -> Array:
        return np.append((factor * table).ravel(), omega)

    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        factor = (low + high) / 2
        violations = problem.smooth_violations(motion(factor), phases, width)
        low, high = (factor, high) if np.all(violations <= 0) else (low, factor)
    return motion(_INSIDE * low)


@dataclass(frozen=True)
class Screening:
    """Decides after each stage whether a hop or a new start is worth going on.

    Attributes
    ----------
    reference : tuple of StageRecord
        What the motion that it is measured by had reached after its own stages.
    """

    reference: tuple[StageRecord, ...]

    def hopeless(self, record: StageRecord) -> bool:
        """Tell whether it is too far behind what the reference had reached at the same stage.

        A later stage says more about the finished motion than an earlier one, and is stricter.
        """
        alike = [one for one in self.reference if _kind(one) == _kind(record)]
        return bool(alike) and record.objective > alike[-1].objective + _BEHIND[record.name]


def _kind(record: StageRecord) -> tuple[str, float, float, int]:
    """Return what must agree for two costs to be of the same problem."""
    return record.name, record.width, record.level, record.samples
