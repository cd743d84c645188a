"""What a solver of nonlinear programs returns, and what it tells meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from constraints.arrays import Array

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
