"""A primal–dual interior point method for few variables and many dense rows.

Ipopt factorises a sparse system of all rows in every iteration. With z variables and r rows the
same step follows from z equations (Nocedal, Wright 2006, ch. 19), and r ≫ z: for 67 variables and
2 000 rows an iteration takes a small fraction of the time. Slacks admit violated rows. The merit
function of the line search is the barrier objective plus the ℓ₁ norm of the difference between
slacks and rows. A slack follows its row wherever the row stays within its bounds, so that the
curvature of the rows does not shorten the steps.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError
from scipy.linalg.lapack import dposv

from constraints.arrays import Array
from expdesign.problem.program import LinearRows, Program, largest_excess
from expdesign.solver.barrier import (
    Bounds,
    Duals,
    SlackStep,
    SlackTrial,
    barrier_multipliers,
    eliminate_slacks,
    optimality_error,
    slack_step,
    try_slacks,
    update_multipliers,
)

FEASIBLE = 1e-3
"""Violation, as a share of a limit's range, below which an iterate of the search counts as
feasible. The finish removes such violations, and the recheck judges the result."""
WEIGHT = 10.0
"""Weight of the objective against the rows. Measured: with a weight of 1 one start in five is lost
in the first steps of Ipopt's barrier."""
RENEWED = 6
"""Iterations between two evaluations of the cost's own Hessian: fewer improve no search
(measured)."""

_FALL = 0.9
"""μ of an iteration as a share of the one before; less where there are few iterations. Rules that
follow the progress need fewer iterations and end in worse optima (measured)."""
_STEEPEST = 0.865
"""Smallest such share where slacks follow: if μ falls faster they end on bounds."""
_SMALLEST = 1e-6
"""μ at the end, if the iterations suffice."""
_CLOSEST = 0.99
"""Largest share of the distance to the nearest bound that one step covers; for small μ 1 − μ."""
_SUFFICIENT = 1e-4
"""Share of the predicted decrease that a step must achieve."""
_HALVINGS = 12
_TOLERANCE = 1e-4
"""Tolerance of the optimality conditions, scaled as in Ipopt."""
_CURVATURE = 1e-8
"""Added to the diagonal of the cost's own Hessian: it regularises flat directions."""
_DAMPED = 0.2
"""Powell's factor: an update retains at least this share of the curvature along a step."""

IterationReport = Callable[[int, float, float, Array], bool]
"""(number of the iteration, objective, largest violation, iterate) → whether to continue."""


class Standstill(NamedTuple):
    """Criterion for an objective that no longer changes."""

    change: float = 2e-4
    """Largest relative change of the objective that counts as none."""
    iterations: int = 5
    """Number of consecutive iterations without a change."""
    feasible: float = FEASIBLE
    """Largest excess of a row that counts as none."""


STANDSTILL = Standstill()


@dataclass(frozen=True)
class Solution:
    """Last iterate of a solver, with its status and statistics."""

    x: Array
    objective: float
    multipliers: Array
    """(r,), Lagrange multipliers of the rows; positive at the upper bound."""
    status: str
    """In Ipopt's terms, e.g. ``"Solve_Succeeded"``."""
    iterations: int
    evaluations: Mapping[str, int]
    """Number of calls of f, g, their derivatives and the Hessian."""
    seconds: float
    best: Array
    """The start, or the feasible iterate with the lowest objective; without one the least
    violated."""

    @property
    def converged(self) -> bool:
        """True for ``Solve_Succeeded`` and ``Solved_To_Acceptable_Level``."""
        return self.status in {"Solve_Succeeded", "Solved_To_Acceptable_Level"}

    @property
    def usable(self) -> Array:
        """The last iterate of a solver that converged, otherwise the best one, (z,)."""
        return self.x if self.converged else self.best


@dataclass
class BestIterate:
    """The best iterate of one solve: the lowest objective among the feasible ones."""

    x: Array
    objective: float = np.inf
    violation: float = np.inf

    def offer(self, x: Array, objective: float, violation: float) -> None:
        """Replace the best iterate if this one is better."""
        if not np.isfinite(objective):
            return
        feasible, was_feasible = violation <= FEASIBLE, self.violation <= FEASIBLE
        better = (
            objective < self.objective if feasible and was_feasible else violation < self.violation
        )
        if (feasible and not was_feasible) or better:
            self.x, self.objective, self.violation = x.copy(), objective, violation


def solve_by_interior_point(
    program: Program,
    start: Array,
    *,
    most: int,
    barrier: float = 0.1,
    following: bool = True,
    renewed: int | None = RENEWED,
    standstill: Standstill = STANDSTILL,
    report: IterationReport | None = None,
) -> Solution:
    """Minimise with the cost's own curvature; return the last iterate whatever the status.

    Parameters
    ----------
    start : (z,)
        Initial variables.
    most : int
        Largest number of iterations.
    barrier : float
        Initial μ: the larger, the farther from its start the solution may be.
    following : bool
        Whether slacks follow their rows within the bounds. This is better for a feasible start;
        from far outside it ends in worse optima.
    renewed : int, optional
        Iterations after which the cost's own Hessian is evaluated again; None: only once. Between
        evaluations BFGS updates correct it by the gradients of the Lagrangian.
    standstill : Standstill
        Criterion to stop at a feasible iterate before the optimality conditions hold.
    report : callable, optional
        Called once per iteration; False stops the solver.
    """
    began = time.perf_counter()
    solver, renewed = _Solver(program, following), renewed or most + 1
    here = solver.first_iterate(start, barrier)
    best = BestIterate(start)
    hessian = np.eye(start.size) if here.hessian is None else here.hessian
    slope = here.point.slope(here.duals.values)
    done, unchanged = 0, 0
    fall = min(_FALL, (_SMALLEST / barrier) ** (1 / most))
    if following:
        fall = max(fall, _STEEPEST)
    while True:
        point = here.point
        violation, objective = solver.violation(point), point.cost / WEIGHT
        best.offer(point.x, objective, violation)
        if report is not None and not report(done + 1, objective, violation, point.x):
            status = "User_Requested_Stop"
            break
        if not (np.isfinite(point.cost) and np.all(np.isfinite(point.values))):
            status = "Invalid_Number_Detected"
            break
        slacks = here.tried.slacks
        if optimality_error(solver.bounds, slope, point.values, slacks, here.duals) < _TOLERANCE:
            status = "Solve_Succeeded"
            break
        if unchanged >= standstill.iterations and violation < standstill.feasible:
            status = "Solved_To_Acceptable_Level"
            break
        if done == most:
            status = "Maximum_Iterations_Exceeded"
            break
        barrier = max(fall * barrier, _SMALLEST)
        step = solver.newton_step(here, hessian, barrier)
        if step is None:
            status = "Invalid_Number_Detected"
            break
        there = solver.line_search(here, step, barrier, curved=(done + 1) % renewed == 0)
        if there is None:
            status = "Search_Direction_Becomes_Too_Small"
            break
        here, before = there, point
        slope = here.point.slope(here.duals.values)
        hessian = update_hessian(
            hessian if here.hessian is None else here.hessian,
            here.point.x - before.x,
            slope - before.slope(here.duals.values),
        )
        change = abs(here.point.cost - before.cost)
        same = change <= standstill.change * max(1.0, abs(before.cost))
        unchanged = unchanged + 1 if same and violation < standstill.feasible else 0
        done += 1
    return Solution(
        x=point.x,
        objective=objective,
        multipliers=solver.row_part(here.duals.values) / WEIGHT,
        status=status,
        iterations=done,
        evaluations=solver.counts,
        seconds=time.perf_counter() - began,
        best=best.x,
    )


def update_hessian(hessian: Array, step: Array, change: Array) -> Array:
    """Return the damped BFGS update of a Hessian, (z, z).

    A positive semidefinite matrix stays so: a change of the gradient that contradicts this is
    damped (Nocedal, Wright 2006, procedure 18.2). A direction without curvature adds nothing.

    Parameters
    ----------
    step, change : (z,)
        Step of the variables, and the change of the gradient along it.

    Examples
    --------
    >>> import numpy as np
    >>> update_hessian(np.eye(2), np.array([1.0, 0.0]), np.array([3.0, 0.0])).tolist()
    [[3.0, 0.0], [0.0, 1.0]]
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


@dataclass(frozen=True)
class _Point:
    """Objective and bounded values at a point, with their derivatives.

    The bounded values are some variables, with unit derivatives, and then the rows.
    """

    x: Array
    cost: float
    gradient: Array
    values: Array
    variables: NDArray[np.intp]
    rows: LinearRows

    def change(self, step: Array) -> Array:
        """Return the change of the bounded values along a step, to first order."""
        return np.concatenate([step[self.variables], self.rows.jacobian_product(step)])

    def slope(self, multipliers: Array) -> Array:
        """Return the gradient of the objective plus the bounded values times multipliers."""
        own = len(self.variables)
        slope = self.gradient + self.rows.transposed_product(multipliers[own:])
        slope[self.variables] += multipliers[:own]
        return slope

    def curvature(self, weights: Array) -> Array:
        """Return the weighted sum of the outer products of the values' gradients, (z, z)."""
        own = len(self.variables)
        curvature = self.rows.curvature(weights[own:])
        curvature[self.variables, self.variables] += weights[:own]
        return curvature


@dataclass(frozen=True)
class _Iterate:
    point: _Point
    hessian: Array | None
    """The cost's own, where it was evaluated."""
    tried: SlackTrial
    duals: Duals


@dataclass(frozen=True)
class _Step:
    x: Array
    rest: SlackStep
    curvature: float
    """Of the objective along it."""


@dataclass
class _Solver:
    """One solve: the program with the objective times `WEIGHT`, and the penalty so far."""

    program: Program
    following: bool
    bounds: Bounds = field(init=False)
    counts: dict[str, int] = field(init=False)
    penalty: float = 1.0

    def __post_init__(self) -> None:
        self.bounds = Bounds.of(self.program)
        self.counts = {"f": 0, "grad_f": 0, "g": 0, "jac_g": 0}

    def first_iterate(self, start: Array, barrier: float) -> _Iterate:
        """Return the iterate at the start, with slacks inside their bounds."""
        point, hessian = self.evaluate(self.nearest(start), curved=True)
        inside = self.bounds.inside(point.values)
        duals = barrier_multipliers(self.bounds, inside, barrier)
        no_change = np.zeros_like(inside)
        tried = try_slacks(self.bounds, point.values, inside, no_change, 1.0, False)
        return _Iterate(point, hessian, tried, duals)

    def newton_step(self, here: _Iterate, hessian: Array, barrier: float) -> _Step | None:
        """Return Newton's step on the conditions of the central path; None if it is not finite."""
        point, slacks, duals = here.point, here.tried.slacks, here.duals
        curvature, multipliers = eliminate_slacks(self.bounds, point.values, slacks, duals, barrier)
        matrix = hessian + point.curvature(curvature)
        right = -point.slope(multipliers)
        if not (np.all(np.isfinite(matrix)) and np.all(np.isfinite(right))):
            return None
        x = _solve_positive(matrix, right)
        change = point.change(x) + (point.values - slacks)
        step = slack_step(self.bounds, slacks, duals, change, barrier, _closest(barrier))
        return _Step(x, step, float(x @ hessian @ x))

    def line_search(
        self, here: _Iterate, step: _Step, barrier: float, *, curved: bool
    ) -> _Iterate | None:
        """Halve the step until the merit function decreases; return the iterate reached.

        If it decreases nowhere, a short step is taken nevertheless; None if that is not finite.
        The first trial nearly always succeeds: only there all derivatives are evaluated at once.
        """
        bounds, point, before, rest = self.bounds, here.point, here.tried, step.rest
        share, slope = rest.share, float(point.gradient @ step.x) + rest.slope
        if before.distance > 0:
            needed = (slope + max(step.curvature, 0.0) / 2) / (0.7 * before.distance)
            if needed > self.penalty:
                self.penalty = 1.5 * needed
        merit = self._merit(point.cost, before, barrier)
        fall = slope - self.penalty * before.distance
        there, hessian = None, None
        for halving in range(_HALVINGS):
            share *= 0.5 if halving else 1.0
            x = self.nearest(point.x + share * step.x)
            if halving == 0:
                there, hessian = self.evaluate(x, curved=curved)
                cost, values = there.cost, there.values
            else:
                there = None
                cost, values = self._values(x)
            close, change = _closest(barrier), share * rest.change
            tried = try_slacks(bounds, values, before.slacks, change, close, self.following)
            found = self._merit(cost, tried, barrier)
            if found <= merit + _SUFFICIENT * share * fall + 1e-10 * abs(merit):
                break
        else:
            if not np.isfinite(found):
                return None
        if there is None:
            there, hessian = self.evaluate(x, curved=curved)
        duals = update_multipliers(bounds, tried.slacks, here.duals, rest, share, barrier)
        return _Iterate(there, hessian, tried, duals)

    def _merit(self, cost: float, tried: SlackTrial, barrier: float) -> float:
        found = cost - barrier * tried.logarithms + self.penalty * tried.distance
        return found if np.isfinite(found) else np.inf

    def nearest(self, x: Array) -> Array:
        """Return the variables clipped to their bounds."""
        return np.clip(x, self.program.lower, self.program.upper)

    def row_part(self, values: Array) -> Array:
        """Return the elements of bounded values, or of their multipliers, that belong to rows."""
        return values[len(self.bounds.variables) :]

    def violation(self, point: _Point) -> float:
        """Return the largest excess of a row."""
        rows = self.row_part(point.values)
        return largest_excess(rows, self.program.row_lower, self.program.row_upper)

    def evaluate(self, x: Array, *, curved: bool) -> tuple[_Point, Array | None]:
        """Return the values and derivatives at a point; with `curved` also the cost's Hessian.

        The objective is NaN where the information matrix has no eigenvalues.
        """
        self.counts["grad_f"] += 1
        self.counts["jac_g"] += 1
        hessian = None
        try:
            if curved:
                cost, gradient, hessian = self.program.cost_derivatives(x)
                hessian = WEIGHT * hessian + _CURVATURE * np.eye(x.size)
            else:
                cost, gradient = self.program.cost_gradient(x)
        except LinAlgError:
            cost, gradient = np.nan, np.full(x.size, np.nan)
        rows, bounded = self.program.linear_rows(x), self.bounds.variables
        values = np.concatenate([x[bounded], rows.values])
        return _Point(x, WEIGHT * cost, WEIGHT * gradient, values, bounded, rows), hessian

    def _values(self, x: Array) -> tuple[float, Array]:
        """Return objective and bounded values alone."""
        self.counts["f"] += 1
        self.counts["g"] += 1
        try:
            cost = WEIGHT * self.program.cost(x)
        except LinAlgError:
            cost = np.nan
        return cost, np.concatenate([x[self.bounds.variables], self.program.rows(x)])


def _closest(barrier: float) -> float:
    return max(_CLOSEST, 1 - barrier)


def _solve_positive(matrix: Array, right: Array) -> Array:
    """Solve a system that is positive definite except for rounding errors."""
    more = 0.0
    while True:
        _, x, failed = dposv(matrix if more == 0 else matrix + more * np.eye(len(matrix)), right)
        if not failed:
            return np.asarray(x)
        more = max(1e-6, 10 * more)
