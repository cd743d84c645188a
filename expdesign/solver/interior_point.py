"""A primal–dual interior point method for few variables and many rows, all of them dense.

Ipopt factorises a sparse system of all rows in every iteration. With z variables and r rows the
same step follows from z equations (Nocedal, Wright 2006, ch. 19), and r ≫ z: for 67 variables and
2 000 rows an iteration takes a small part of the time. Rows that are broken are allowed for by
slacks; a step is judged by the barrier's objective with the ℓ₁ norm of what slacks and rows differ
by.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from constraints.arrays import Array
from expdesign.problem.design_problem import LimitedProgram, largest_excess
from expdesign.problem.path_slope import LinearRows
from expdesign.solver.barrier import Bounds, Pair
from expdesign.solver.solution import FEASIBLE, WEIGHT, Report, Solution

_FALL = 0.9
"""μ of an iteration as a share of the one before; less where there are few iterations. Rules that
watch the progress need fewer and end in worse optima (measured)."""
_SMALLEST = 1e-6
"""μ at the end."""
_CLOSEST = 0.99
"""Share of the way to the nearest bound that a step goes at most; where μ is small all but μ."""
_SUFFICIENT = 1e-4
"""Share of the predicted decrease that a step has to give."""
_HALVINGS = 12
_TOLERANCE = 1e-4
"""Of the conditions of optimality, scaled as Ipopt does."""
_REUSED = 2
"""Iterations that share a Hessian of the cost, the dearest part of them: it changes little."""


class Standstill(NamedTuple):
    """When the objective stands still."""

    change: float = 2e-4
    """Of the objective, relative, that counts as none."""
    iterations: int = 5
    """One after the other without any."""


STANDSTILL = Standstill()


@dataclass(frozen=True)
class _Point:
    """Objective and bounded values at a point, with their derivatives.

    What is bounded are some variables, whose own derivatives are one, and the rows.
    """

    x: Array
    cost: float
    gradient: Array
    hessian: Array
    values: Array
    variables: NDArray[np.intp]
    rows: LinearRows

    def moved(self, step: Array) -> Array:
        """Return what a step changes the bounded values by."""
        return np.concatenate([step[self.variables], self.rows.moved(step)])

    def pulled(self, weights: Array) -> Array:
        """Return the weighted sum of their gradients."""
        own = len(self.variables)
        pulled = self.rows.pulled(weights[own:])
        pulled[self.variables] += weights[:own]
        return pulled

    def curvature(self, weights: Array) -> Array:
        """Return the weighted sum of every gradient times itself, (z, z)."""
        own = len(self.variables)
        curvature = self.rows.curvature(weights[own:])
        curvature[self.variables, self.variables] += weights[:own]
        return curvature


@dataclass
class _Duals:
    """Multipliers: of slacks against values, and of the lower and upper bounds."""

    values: Array
    lower: Array
    upper: Array


@dataclass(frozen=True)
class _Step:
    x: Array
    slacks: Array
    duals: _Duals


def solve_by_interior_point(
    program: LimitedProgram,
    start: Array,
    *,
    most: int,
    barrier: float = 0.1,
    feasible: float = FEASIBLE,
    curvature: float = 1e-8,
    standstill: Standstill = STANDSTILL,
    report: Report | None = None,
) -> Solution:
    """Minimise, with the cost's own curvature; return the last iterate whatever the status.

    Parameters
    ----------
    start : (z,)
        Initial variables.
    most : int
        Most iterations.
    barrier : float
        μ at the beginning: the larger, the farther from its start it may end.
    feasible : float
        Excess of a row that counts as none, where the objective stands still.
    curvature : float
        Added to the Hessian in every direction: in place of that of the rows, which is left out.
    standstill : Standstill
        Where it ends, within its rows, although the conditions of optimality do not hold yet.
    report : callable, optional
        Called once per iteration; False stops the solver.
    """
    solver = _InteriorPoint(program, most, feasible, curvature, standstill, report)
    return solver.solve(start, barrier)


class _InteriorPoint:
    """One solve: see `solve_by_interior_point`."""

    def __init__(
        self,
        program: LimitedProgram,
        most: int,
        feasible: float,
        curvature: float,
        standstill: Standstill,
        report: Report | None,
    ) -> None:
        self._program, self._most, self._report = program, most, report
        self._feasible, self._curvature, self._still = feasible, curvature, standstill
        self._bounds = Bounds.of(program)
        self._counts = {"f": 0, "grad_f": 0, "g": 0, "jac_g": 0}
        self._penalty = 1.0

    def solve(self, start: Array, barrier: float) -> Solution:
        """Iterate until it converges, stands still, is stopped, or has no iterations left."""
        began = time.perf_counter()
        bounded = self._bounds.variables
        point = self._at(np.clip(start, self._program.lower, self._program.upper), None)
        slacks = self._bounds.inside(point.values)
        lower, upper = (np.where(side, 1.0, 0.0) for side in self._bounds.sides)
        duals = _Duals(np.zeros(len(slacks)), lower, upper)
        status, done, still = "Maximum_Iterations_Exceeded", 0, 0
        fall = min(_FALL, (_SMALLEST / barrier) ** (1 / self._most))
        while True:
            rows = point.values[len(bounded) :]
            violation = largest_excess(rows, self._program.row_lower, self._program.row_upper)
            now = done + 1, point.cost / WEIGHT, violation, point.x
            if self._report is not None and not self._report(*now):
                status = "User_Requested_Stop"
                break
            if not (np.isfinite(point.cost) and np.all(np.isfinite(point.values))):
                status = "Invalid_Number_Detected"
                break
            gaps = self._bounds.gaps(slacks)
            products = self._bounds.products(gaps, (duals.lower, duals.upper))
            if self._error(point, slacks, duals, products) < _TOLERANCE:
                status = "Solve_Succeeded"
                break
            if still >= self._still.iterations and violation < self._feasible:
                status = "Solved_To_Acceptable_Level"
                break
            if done == self._most:
                break
            barrier = max(fall * barrier, _SMALLEST)
            step = self._step(point, slacks, duals, gaps, barrier)
            if step is None:
                status = "Invalid_Number_Detected"
                break
            before, moved = point.cost, self._moved(point, slacks, duals, gaps, step, barrier)
            if moved is None:
                status = "Search_Direction_Becomes_Too_Small"
                break
            x, slacks, duals = moved
            point = self._at(x, point.hessian if (done + 1) % _REUSED else None)
            stood = abs(point.cost - before) <= self._still.change * max(1.0, abs(before))
            still = still + 1 if stood and violation < self._feasible else 0
            done += 1
        return Solution(
            x=point.x,
            objective=point.cost / WEIGHT,
            multipliers=duals.values[len(bounded) :] / WEIGHT,
            status=status,
            converged=status in {"Solve_Succeeded", "Solved_To_Acceptable_Level"},
            iterations=done,
            evaluations=self._counts,
            seconds=time.perf_counter() - began,
        )

    def _with_rows(self, x: Array, rows: Array) -> Array:
        """Return what is bounded: of the variables, and the rows."""
        return np.concatenate([x[self._bounds.variables], rows])

    def _cost(self, x: Array) -> float:
        try:
            return self._program.cost(x)
        except LinAlgError:  # the information of such a motion is not finite
            return np.nan

    def _at(self, x: Array, hessian: Array | None) -> _Point:
        """Return what there is to know at a point, with a Hessian of before if one is given."""
        self._counts["grad_f"] += 1
        self._counts["jac_g"] += 1
        try:
            if hessian is None:
                cost, gradient, hessian = self._program.cost_derivatives(x)
                hessian = WEIGHT * hessian
            else:
                cost, gradient = self._program.cost_gradient(x)
        except LinAlgError:
            cost, gradient, hessian = np.nan, np.full(x.size, np.nan), np.eye(x.size)
        rows = self._program.linear_rows(x)
        return _Point(
            x,
            WEIGHT * cost,
            WEIGHT * gradient,
            hessian,
            self._with_rows(x, rows.values),
            self._bounds.variables,
            rows,
        )

    def _error(self, point: _Point, slacks: Array, duals: _Duals, products: Array) -> float:
        multipliers = (duals.values, duals.lower, duals.upper)
        size = sum(float(np.sum(np.abs(part))) for part in multipliers)
        scale = max(100.0, size / max(1, 2 * len(duals.values))) / 100
        dual = (
            point.gradient + point.pulled(duals.values),
            duals.upper - duals.lower - duals.values,
            products,
        )
        largest = max(float(np.max(np.abs(part), initial=0.0)) for part in dual)
        return max(largest / scale, float(np.max(np.abs(point.values - slacks), initial=0.0)))

    def _step(
        self,
        point: _Point,
        slacks: Array,
        duals: _Duals,
        gaps: Pair,
        barrier: float,
    ) -> _Step | None:
        """Return Newton's step on the conditions of the central path; None where there is none."""
        below, above = self._bounds.pushes(gaps, barrier)
        curvature = duals.lower / gaps[0] + duals.upper / gaps[1]
        towards = duals.values + below - above
        apart = point.values - slacks
        matrix = point.hessian + point.curvature(curvature)
        matrix[np.diag_indices_from(matrix)] += self._curvature
        right = -point.gradient - point.pulled(duals.values + curvature * apart - towards)
        if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(right))):
            return None
        x = _solved(matrix, right)
        moved = point.moved(x) + apart
        values = curvature * moved - towards
        lower = below - duals.lower - duals.lower / gaps[0] * moved
        upper = above - duals.upper + duals.upper / gaps[1] * moved
        return _Step(x, moved, _Duals(values, lower, upper))

    def _moved(
        self,
        point: _Point,
        slacks: Array,
        duals: _Duals,
        gaps: Pair,
        step: _Step,
        barrier: float,
    ) -> tuple[Array, Array, _Duals] | None:
        """Go as far along the step as the merit function falls; return where that leads.

        Where it falls nowhere, a short step is taken all the same; None where there is no number.
        """
        close = max(_CLOSEST, 1 - barrier)
        share = self._bounds.longest(close, gaps, (step.slacks, -step.slacks))
        dual_share = self._bounds.longest(
            close, (duals.lower, duals.upper), (step.duals.lower, step.duals.upper)
        )
        apart = float(np.sum(np.abs(point.values - slacks)))
        below, above = self._bounds.pushes(gaps, barrier)
        slope = float(point.gradient @ step.x + (above - below) @ step.slacks)
        curvature = max(float(step.x @ point.hessian @ step.x), 0.0) / 2
        if apart > 0:
            needed = (slope + curvature) / (0.7 * apart)
            if needed > self._penalty:
                self._penalty = 1.5 * needed
        merit = self._merit(point.cost, slacks, apart, barrier)
        fall = slope - self._penalty * apart
        for _ in range(_HALVINGS):
            x = np.clip(point.x + share * step.x, self._program.lower, self._program.upper)
            moved = self._bounds.within(slacks + share * step.slacks)
            self._counts["f"] += 1
            self._counts["g"] += 1
            cost = WEIGHT * self._cost(x)
            values = self._with_rows(x, self._program.rows(x))
            found = self._merit(cost, moved, float(np.sum(np.abs(values - moved))), barrier)
            if found <= merit + _SUFFICIENT * share * fall + 1e-10 * abs(merit):
                break
            share /= 2
        else:
            if not np.isfinite(found):
                return None
        gap = self._bounds.gaps(moved)
        # The products stay within ten orders of magnitude of μ.
        lower, upper = (
            np.where(side, np.clip(multiplier, 1e-10 * push, 1e10 * push), 0.0)
            for side, multiplier, push in zip(
                self._bounds.sides,
                (
                    duals.lower + dual_share * step.duals.lower,
                    duals.upper + dual_share * step.duals.upper,
                ),
                self._bounds.pushes(gap, barrier),
                strict=True,
            )
        )
        values = duals.values + share * step.duals.values
        return x, moved, _Duals(values, lower, upper)

    def _merit(self, cost: float, slacks: Array, apart: float, barrier: float) -> float:
        found = cost - barrier * self._bounds.logarithms(slacks) + self._penalty * apart
        return found if np.isfinite(found) else np.inf


def _solved(matrix: Array, right: Array) -> Array:
    """Solve a system that is positive definite but for rounding."""
    more = 0.0
    while True:
        try:
            return np.asarray(cho_solve(cho_factor(matrix + more * np.eye(len(matrix))), right))
        except LinAlgError:
            more = max(1e-6, 10 * more)
