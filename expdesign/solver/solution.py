"""What a solver of nonlinear programs returns, and what it tells meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from constraints.arrays import Array

FEASIBLE = 1e-3
"""Violation, as a share of a limit's range, below which an iterate of the search counts as kept;
what is left is removed by the finish and judged by the recheck."""
WEIGHT = 10.0
"""Of the objective against the rows. Measured: with a weight of 1 one start in five is lost in the
first steps of Ipopt's barrier."""

Report = Callable[[int, float, float, Array], bool]
"""(number of the iteration, objective, largest violation, iterate) → go on?"""


@dataclass(frozen=True)
class Solution:
    """Where a solver stopped, and why."""

    x: Array
    objective: float
    multipliers: Array
    """(r,), Lagrange multipliers of the rows; positive at the upper bound."""
    status: str
    """In Ipopt's words, e.g. ``"Solve_Succeeded"``."""
    converged: bool
    """True for ``Solve_Succeeded`` and ``Solved_To_Acceptable_Level``."""
    iterations: int
    evaluations: Mapping[str, int]
    """Number of calls of f, g, their derivatives and the Hessian."""
    seconds: float
