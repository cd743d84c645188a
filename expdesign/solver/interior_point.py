"""A primal–dual interior point method for few variables and many rows, all of them dense.

Ipopt factorises a sparse system of all rows in every iteration. With z variables and r rows the
same step follows from z equations (Nocedal, Wright 2006, ch. 19), and r ≫ z: for 67 variables and
2 000 rows an iteration takes a small part of the time. Rows that are broken are allowed for by
slacks; a step is judged by the barrier's objective with the ℓ₁ norm of what slacks and rows differ
by. Where a row stays within its bounds its slack follows it, so that rows which bend do not shorten
the steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError
from scipy.linalg.lapack import dposv

from constraints.arrays import Array
from expdesign.problem.design_problem import LimitedProgram, largest_excess
from expdesign.problem.path_slope import LinearRows
from expdesign.solver.barrier import (
    Bounds,
    Duals,
    SlackStep,
    Trial,
    condensed,
    error,
    pushes,
    slack_step,
    stepped,
    trial,
)

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


_FALL = 0.9
"""μ of an iteration as a share of the one before; less where there are few iterations. Rules that
watch the progress need fewer and end in worse optima (measured)."""
_STEEPEST = 0.865
"""Such a share at least where slacks follow: if μ falls faster they end on bounds."""
_SMALLEST = 1e-6
"""μ at the end, where there are iterations enough."""
_CLOSEST = 0.99
"""Share of the way to the nearest bound that a step goes at most; where μ is small all but μ."""
_SUFFICIENT = 1e-4
"""Share of the predicted decrease that a step has to give."""
_HALVINGS = 12
_TOLERANCE = 1e-4
"""Of the conditions of optimality, scaled as Ipopt does."""

RENEWED = 6
"""Iterations that share the cost's own Hessian: with fewer the search gains no more (measured)."""


class Standstill(NamedTuple):
    """When the objective stands still."""

    change: float = 2e-4
    """Of the objective, relative, that counts as none."""
    iterations: int = 5
    """One after the other without any."""
    feasible: float = FEASIBLE
    """Excess of a row that counts as none."""


STANDSTILL = Standstill()


@dataclass(frozen=True)
class _Iterate:
    point: Point
    hessian: Array | None
    """The cost's own, where it was computed anew."""
    tried: Trial
    duals: Duals


@dataclass(frozen=True)
class _Step:
    x: Array
    rest: SlackStep
    curvature: float
    """Of the objective along it."""


def solve_by_interior_point(
    program: LimitedProgram,
    start: Array,
    *,
    most: int,
    barrier: float = 0.1,
    following: bool = True,
    renewed: int | None = RENEWED,
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
    following : bool
        Whether slacks follow their rows within the bounds: better where the start keeps its rows;
        from far outside it ends in worse optima.
    renewed : int, optional
        Iterations after which the cost's own Hessian is computed anew; None: only once. Meanwhile
        it is corrected by what the gradients differ by, those of the rows among them.
    standstill : Standstill
        Where it ends, within its rows, although the conditions of optimality do not hold yet.
    report : callable, optional
        Called once per iteration; False stops the solver.
    """
    solver = _InteriorPoint(program, report, following=following)
    return solver.solve(start, barrier, most, renewed or most + 1, standstill)


class _InteriorPoint:
    """One solve: see `solve_by_interior_point`."""

    def __init__(self, program: LimitedProgram, report: Report | None, *, following: bool) -> None:
        self._program, self._following = BoundedProgram(program), following
        self._bounds, self._report = self._program.bounds, report
        self._penalty = 1.0

    def solve(
        self, start: Array, barrier: float, most: int, renewed: int, standstill: Standstill
    ) -> Solution:
        """Iterate until it converges, stands still, is stopped, or has no iterations left."""
        began = time.perf_counter()
        point, first = self._program.at(self._program.nearest(start), curved=True)
        hessian = np.eye(start.size) if first is None else first
        inside = self._bounds.inside(point.values)
        duals = pushes(self._bounds, inside, barrier)
        tried = trial(self._bounds, point.values, inside, np.zeros_like(inside), 1.0, False)
        here = _Iterate(point, first, tried, duals)
        slope = point.slope(duals.values)
        status, done, still = "Maximum_Iterations_Exceeded", 0, 0
        fall = min(_FALL, (_SMALLEST / barrier) ** (1 / most))
        if self._following:
            fall = max(fall, _STEEPEST)
        while True:
            violation = self._program.violation(point)
            now = done + 1, point.cost / WEIGHT, violation, point.x
            if self._report is not None and not self._report(*now):
                status = "User_Requested_Stop"
                break
            if not (np.isfinite(point.cost) and np.all(np.isfinite(point.values))):
                status = "Invalid_Number_Detected"
                break
            if error(self._bounds, slope, point.values, here.tried.slacks, duals) < _TOLERANCE:
                status = "Solve_Succeeded"
                break
            if still >= standstill.iterations and violation < standstill.feasible:
                status = "Solved_To_Acceptable_Level"
                break
            if done == most:
                break
            barrier = max(fall * barrier, _SMALLEST)
            step = self._step(here, hessian, barrier)
            if step is None:
                status = "Invalid_Number_Detected"
                break
            there = self._moved(here, step, barrier, curved=(done + 1) % renewed == 0)
            if there is None:
                status = "Search_Direction_Becomes_Too_Small"
                break
            before, here, point, duals = point, there, there.point, there.duals
            slope = point.slope(duals.values)
            hessian = updated(
                hessian if there.hessian is None else there.hessian,
                point.x - before.x,
                slope - before.slope(duals.values),
            )
            stood = abs(point.cost - before.cost) <= standstill.change * max(1.0, abs(before.cost))
            still = still + 1 if stood and violation < standstill.feasible else 0
            done += 1
        return Solution(
            x=point.x,
            objective=point.cost / WEIGHT,
            multipliers=self._program.of_rows(duals.values) / WEIGHT,
            status=status,
            converged=status in {"Solve_Succeeded", "Solved_To_Acceptable_Level"},
            iterations=done,
            evaluations=self._program.counts,
            seconds=time.perf_counter() - began,
        )

    def _step(self, here: _Iterate, hessian: Array, barrier: float) -> _Step | None:
        """Return Newton's step on the conditions of the central path; None where there is none."""
        point, slacks, duals = here.point, here.tried.slacks, here.duals
        curvature, multipliers = condensed(self._bounds, point.values, slacks, duals, barrier)
        matrix = hessian + point.curvature(curvature)
        right = -point.slope(multipliers)
        if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(right))):
            return None
        x = _solved(matrix, right)
        moved = point.moved(x) + (point.values - slacks)
        step = slack_step(self._bounds, slacks, duals, moved, barrier, _closest(barrier))
        return _Step(x, step, float(x @ hessian @ x))

    def _moved(
        self, here: _Iterate, step: _Step, barrier: float, *, curved: bool
    ) -> _Iterate | None:
        """Go as far along the step as the merit function falls; return where that leads.

        Where it falls nowhere, a short step is taken all the same; None where there is no number.
        Nearly always the first trial is taken: only of this one everything is computed at once.
        """
        bounds, point, before, rest = self._bounds, here.point, here.tried, step.rest
        share, slope = rest.share, float(point.gradient @ step.x) + rest.slope
        if before.apart > 0:
            needed = (slope + max(step.curvature, 0.0) / 2) / (0.7 * before.apart)
            if needed > self._penalty:
                self._penalty = 1.5 * needed
        merit = self._merit(point.cost, before, barrier)
        fall = slope - self._penalty * before.apart
        there, hessian = None, None
        for halving in range(_HALVINGS):
            share *= 0.5 if halving else 1.0
            x = self._program.nearest(point.x + share * step.x)
            if halving == 0:
                there, hessian = self._program.at(x, curved=curved)
                cost, values = there.cost, there.values
            else:
                there = None
                cost, values = self._program.values(x)
            close, change = _closest(barrier), share * rest.change
            tried = trial(bounds, values, before.slacks, change, close, self._following)
            found = self._merit(cost, tried, barrier)
            if found <= merit + _SUFFICIENT * share * fall + 1e-10 * abs(merit):
                break
        else:
            if not np.isfinite(found):
                return None
        if there is None:
            there, hessian = self._program.at(x, curved=curved)
        duals = stepped(bounds, tried.slacks, here.duals, rest, share, barrier)
        return _Iterate(there, hessian, tried, duals)

    def _merit(self, cost: float, tried: Trial, barrier: float) -> float:
        found = cost - barrier * tried.logarithms + self._penalty * tried.apart
        return found if np.isfinite(found) else np.inf


def _closest(barrier: float) -> float:
    return max(_CLOSEST, 1 - barrier)


def _solved(matrix: Array, right: Array) -> Array:
    """Solve a system that is positive definite but for rounding."""
    more = 0.0
    while True:
        _, x, failed = dposv(matrix if more == 0 else matrix + more * np.eye(len(matrix)), right)
        if not failed:
            return np.asarray(x)
        more = max(1e-6, 10 * more)


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


_DAMPED = 0.2
"""Share of the curvature along a step that an update leaves at least: Powell's."""


def updated(hessian: Array, step: Array, change: Array) -> Array:
    """Return a Hessian (z, z) that explains what a step has changed the gradient by, (z,) each.

    What is positive semidefinite stays so: where the change says otherwise it counts in part
    (Nocedal, Wright 2006, procedure 18.2). A step along which there is no curvature tells nothing.
    """
    along = hessian @ step
    expected, found = float(step @ along), float(step @ change)
    if not (np.isfinite(found) and expected > np.finfo(float).eps * float(step @ step)):
        return hessian
    if found < _DAMPED * expected:
        share = (1 - _DAMPED) * expected / (expected - found)
        change = share * change + (1 - share) * along
        found = _DAMPED * expected
    return (
        hessian
        + np.multiply.outer(change, change / found)
        - np.multiply.outer(along, along / expected)
    )
