"""A program as a solver with slacks sees it: bounded variables are rows like the others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError

from constraints.arrays import Array
from expdesign.problem.design_problem import LimitedProgram, largest_excess
from expdesign.problem.path_slope import LinearRows
from expdesign.solver.barrier import Bounds
from expdesign.solver.solution import WEIGHT

_CURVATURE = 1e-8
"""Added to the cost's own Hessian in every direction: what is flat is no longer so."""


@dataclass(frozen=True)
class Point:
    """Objective and bounded values at a point, with their derivatives.

    What is bounded are some variables, whose own derivatives are one, and the rows.
    """

    x: Array
    cost: float
    gradient: Array
    values: Array
    variables: NDArray[np.intp]
    rows: LinearRows

    def moved(self, step: Array) -> Array:
        """Return what a step changes the bounded values by."""
        return np.concatenate([step[self.variables], self.rows.moved(step)])

    def slope(self, multipliers: Array) -> Array:
        """Return the gradient of the objective with the bounded values times their multipliers."""
        own = len(self.variables)
        slope = self.gradient + self.rows.pulled(multipliers[own:])
        slope[self.variables] += multipliers[:own]
        return slope

    def curvature(self, weights: Array) -> Array:
        """Return the weighted sum of the bounded values' gradients times themselves, (z, z)."""
        own = len(self.variables)
        curvature = self.rows.curvature(weights[own:])
        curvature[self.variables, self.variables] += weights[:own]
        return curvature


class BoundedProgram:
    """Evaluates a program, whose objective it multiplies by `WEIGHT`, and counts how often."""

    def __init__(self, program: LimitedProgram) -> None:
        self._program = program
        self.bounds = Bounds.of(program)
        self.counts = {"f": 0, "grad_f": 0, "g": 0, "jac_g": 0}

    def nearest(self, x: Array) -> Array:
        """Return the variables within their bounds that are nearest to given ones."""
        return np.clip(x, self._program.lower, self._program.upper)

    def of_rows(self, values: Array) -> Array:
        """Return, of something of all that is bounded, the part of the rows."""
        return values[len(self.bounds.variables) :]

    def violation(self, point: Point) -> float:
        """Return the largest excess of a row."""
        rows = self.of_rows(point.values)
        return largest_excess(rows, self._program.row_lower, self._program.row_upper)

    def values(self, x: Array) -> tuple[float, Array]:
        """Return objective and bounded values alone."""
        self.counts["f"] += 1
        self.counts["g"] += 1
        try:
            cost = WEIGHT * self._program.cost(x)
        except LinAlgError:  # the information of such a motion is not finite
            cost = np.nan
        return cost, self._bounded(x, self._program.rows(x))

    def at(self, x: Array, *, curved: bool) -> tuple[Point, Array | None]:
        """Return what there is to know at a point; with the cost's own Hessian where it is asked.

        Where there is none, the objective is no number.
        """
        self.counts["grad_f"] += 1
        self.counts["jac_g"] += 1
        hessian = None
        try:
            if curved:
                cost, gradient, hessian = self._program.cost_derivatives(x)
                hessian = WEIGHT * hessian + _CURVATURE * np.eye(x.size)
            else:
                cost, gradient = self._program.cost_gradient(x)
        except LinAlgError:
            cost, gradient = np.nan, np.full(x.size, np.nan)
        rows, bounded = self._program.linear_rows(x), self.bounds.variables
        values = self._bounded(x, rows.values)
        return Point(x, WEIGHT * cost, WEIGHT * gradient, values, bounded, rows), hessian

    def _bounded(self, x: Array, rows: Array) -> Array:
        return np.concatenate([x[self.bounds.variables], rows])
