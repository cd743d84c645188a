"""The design problem: variables, objective and limits. It states them and solves nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from constraints import Limit, LimitDefinition
from constraints.arrays import Array, Mask
from expdesign.information.spectral import Criterion
from expdesign.mechanism.term import Term
from expdesign.problem.cost import InformationCost, RegressorKernels
from expdesign.problem.limit_rows import LimitEvaluator, LimitKernels, LimitRows
from expdesign.problem.reach import coordinate_reach
from expdesign.problem.variables import DesignVariables
from expdesign.robot import ExactModel, Robot, hexapod_graph


@dataclass(frozen=True)
class DesignProblem:
    """What is to be designed, for one robot.

    Attributes
    ----------
    exact : ExactModel
        Robot and limits by the unsmoothed model.
    cost : InformationCost
        The smoothed objective; its `samples` and ω bounds are the user's.
    evaluator : LimitEvaluator
        The smoothed limits.
    names : tuple of str
        Parameters that the criterion judges.
    even_scaling : (k,) or None
        Scaling that gives F of a typical motion a unit diagonal: for criteria that do not depend
        on the scaling, but keep more digits in this one.
    """

    exact: ExactModel
    cost: InformationCost
    evaluator: LimitEvaluator
    names: tuple[str, ...]
    even_scaling: Array | None = None

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.exact.robot

    @property
    def limits(self) -> tuple[Limit, ...]:
        """The limits, in the order of the rows."""
        return self.exact.limits

    @property
    def variables(self) -> DesignVariables:
        """The scaled variables."""
        return self.cost.variables

    @property
    def criterion(self) -> Criterion:
        """The criterion of optimality."""
        return self.cost.criterion

    def with_frequency(self, omega_bounds: tuple[float, float]) -> DesignProblem:
        """Return the same problem with other bounds on ω, rad/s; the scaling of ω stays."""
        variables = replace(self.variables, omega_bounds=omega_bounds)
        return replace(
            self,
            cost=replace(self.cost, variables=variables),
            evaluator=replace(self.evaluator, variables=variables),
        )

    def with_harmonics(self, harmonics: int) -> DesignProblem:
        """Return the same problem for a series with another number of harmonics."""
        variables = replace(self.variables, harmonics=harmonics)
        return replace(
            self,
            cost=replace(self.cost, variables=variables),
            evaluator=replace(self.evaluator, variables=variables),
        )

    def starting_at_rest(self) -> DesignProblem:
        """Return the same problem for series whose rate and acceleration vanish at t = 0."""
        variables = replace(self.variables, rest=True)
        return replace(
            self,
            cost=replace(self.cost, variables=variables),
            evaluator=replace(self.evaluator, variables=variables),
        )

    def with_criterion(self, criterion: Criterion) -> DesignProblem:
        """Return the same problem with another criterion, evenly scaled if it may be."""
        cost = replace(self.cost, criterion=criterion)
        if criterion.invariant and self.even_scaling is not None:
            cost = replace(cost, scaling=self.even_scaling)
        return replace(self, cost=cost)

    def smooth_bounds(self, margins: Array | None = None) -> tuple[Array, Array]:
        """Return bounds on the smooth rows, (R,) each or with margins (…, R).

        Parameters
        ----------
        margins : (…, R), optional
            How far the natural bounds are drawn in, as shares of their ranges.
        """
        columns = self.exact.columns()
        parts = [
            limit.smooth_bounds(0.0 if margins is None else margins[..., part])
            for limit, part in zip(self.limits, columns, strict=True)
        ]
        if not parts:
            return np.empty(0), np.empty(0)
        return tuple(np.concatenate(side, axis=-1) for side in zip(*parts, strict=True))  # type: ignore[return-value]

    def row_scale(self) -> Array:
        """Return (R,) the range of every smooth row: what counts as one in the NLP."""
        lower, upper = self.smooth_bounds()
        both = np.isfinite(lower) & np.isfinite(upper)
        with np.errstate(invalid="ignore"):
            width = np.where(both, upper - lower, 0.0)
        one = np.abs(np.where(np.isfinite(lower), lower, upper))
        scale = np.where(both, width, one)
        return np.where(np.isfinite(scale) & (scale > 0), scale, 1.0)

    def smooth_violations(self, variables: Array, phases: Array, width: float) -> Array:
        """Return (K, R) excess of the smooth rows over their bounds, as shares of their scale.

        Open rows are at −inf; a value that is not a number counts as broken.
        """
        values = self.evaluator.values(variables, phases, width)
        lower, upper = self.smooth_bounds()
        excess = np.maximum(lower - values, values - upper) / self.row_scale()
        return np.nan_to_num(excess, nan=np.inf, posinf=np.inf, neginf=-np.inf)

    def rows(self, phases: Array, mask: Mask, margins: Array | None = None) -> LimitRows:
        """Return the NLP's rows: which limit holds at which phase, with margins if given."""
        lower, upper = self.smooth_bounds(margins)
        used = np.any(mask, axis=1)
        shape = mask.shape
        lower, upper = np.broadcast_to(lower, shape), np.broadcast_to(upper, shape)
        return LimitRows(phases[used], mask[used], lower[used], upper[used])

    def program(self, rows: LimitRows, width: float, level: float, samples: int) -> DesignProgram:
        """Return the NLP with the rows given; the cost is summed over `samples` samples."""
        return DesignProgram(self, self.cost_with(samples), rows, width, level)

    def cost_with(self, samples: int) -> InformationCost:
        """Return the cost over another number of samples of the period."""
        return replace(self.cost, samples=samples)


class DesignProgram:
    """One nonlinear program: `expdesign.solver.ipopt.NonlinearProgram` for a set of rows."""

    def __init__(
        self,
        problem: DesignProblem,
        cost: InformationCost,
        rows: LimitRows,
        width: float,
        level: float,
    ) -> None:
        self._problem, self._cost, self._rows = problem, cost, rows
        self._width, self._level = width, level
        self._scale = np.broadcast_to(problem.row_scale(), rows.mask.shape)[rows.mask]
        row_lower, row_upper = rows.bounds()
        self.row_lower, self.row_upper = row_lower / self._scale, row_upper / self._scale
        self.lower, self.upper = problem.variables.bounds()

    def within(self, center: Array, radius: float | None) -> DesignProgram:
        """Confine the variables to a box about a point; None leaves them free."""
        if radius is not None:
            self.lower = np.maximum(self.lower, center - radius)
            self.upper = np.minimum(self.upper, center + radius)
        return self

    def cost(self, x: Array) -> float:
        """Return the smoothed criterion."""
        return self._cost.value(x, self._width, self._level)

    def cost_derivatives(self, x: Array) -> tuple[float, Array, Array]:
        """Return the smoothed criterion, its gradient and Gauss–Newton Hessian."""
        return self._cost.derivatives(x, self._width, self._level)

    def cost_gradient(self, x: Array) -> tuple[float, Array]:
        """Return the smoothed criterion and its gradient."""
        return self._cost.gradient(x, self._width, self._level)

    def rows(self, x: Array) -> Array:
        """Return the scaled limit rows."""
        values = self._problem.evaluator.values(x, self._rows.phases, self._width)
        return values[self._rows.mask] / self._scale

    def rows_jacobian(self, x: Array) -> tuple[Array, Array]:
        """Return the scaled limit rows and their Jacobian."""
        values, slopes = self._problem.evaluator.jacobian(x, self._rows, self._width)
        return values / self._scale, slopes / self._scale[:, None]


@cache
def _regressor_kernels(terms: tuple[Term, ...]) -> RegressorKernels:
    return RegressorKernels.of(hexapod_graph(terms))


@cache
def _limit_kernels(
    definitions: tuple[LimitDefinition, ...], terms: tuple[Term, ...]
) -> LimitKernels:
    return LimitKernels.of(hexapod_graph(terms), definitions)


def build_problem(
    robot: Robot,
    *,
    harmonics: int,
    frequency: tuple[float, float],
    samples: int,
    covariance: Array,
    criterion: Criterion,
    scaling: Array,
    names: tuple[str, ...],
) -> DesignProblem:
    """State the design problem of a robot.

    Parameters
    ----------
    robot : Robot
        With its limits.
    harmonics : int
        n.
    frequency : (float, float)
        Bounds on the base frequency, Hz.
    samples : int
        Samples of one period over which F is summed.
    covariance : (6, 6)
        Σ, N².
    criterion : Criterion
    scaling : (m,)
        Scale of every parameter: column k of A is multiplied by it.
    names : tuple of str
        Parameters that the criterion judges.
    """
    exact = ExactModel(robot, robot.limits)
    lowest, highest = (2 * np.pi * bound for bound in frequency)
    middle, reach = coordinate_reach(exact)
    variables = DesignVariables(harmonics, reach / 2, middle, (lowest, highest), highest)
    columns = np.array([robot.parameter_names.index(name) for name in names], dtype=np.intp)
    cost = InformationCost(
        _regressor_kernels(robot.terms),
        robot.machine,
        variables,
        covariance,
        columns,
        scaling[columns],
        criterion,
        samples,
    )
    evaluator = LimitEvaluator(
        _limit_kernels(tuple(limit.definition for limit in robot.limits), robot.terms),
        variables,
        robot.machine,
        robot.parameters,
        robot.characteristic_length,
    )
    return DesignProblem(exact, cost, evaluator, names)
