"""The design problem and its nonlinear program: variables, objective and limits, not solved here.

The rows of limits are the same for every program along a motion: ramps have them too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol, Self

import numpy as np
import scipy

from constraints.arrays import Array, Mask
from expdesign.information.criteria import Criterion
from expdesign.information.fisher import PeriodicNoise
from expdesign.information.prior import PriorMachine
from expdesign.problem.cost import InformationCost
from expdesign.problem.path_slope import LinearRows, PathSlope, Rows
from expdesign.problem.variables import DesignVariables, coordinate_reach
from expdesign.robot import LimitModel, Robot
from expdesign.trajectory import PhaseBasis

_FEWER, _LEAST = 3, 16
"""Samples of the cost for one in its Hessian, and how many that has at least. With all of them it
is the dearest part of an iteration, and searches end no better (240 starts of `palida` for `d`; 24
to 48 for the other criteria and for 1 to 12 harmonics)."""


@dataclass(frozen=True)
class DesignProblem:
    """What is to be designed, for one robot."""

    limits: LimitModel
    cost: InformationCost
    """The smoothed objective; its `samples` and ω bounds are the user's."""
    names: tuple[str, ...]
    """Parameters that the criterion judges."""
    even_scaling: Array | None = None
    """As the cost's scaling, gives F of a typical motion a unit diagonal: for criteria that do not
    depend on the scaling, but keep more digits in this one."""

    @property
    def robot(self) -> Robot:
        """The robot."""
        return self.limits.robot

    @property
    def variables(self) -> DesignVariables:
        """The scaled variables."""
        return self.cost.variables

    @property
    def criterion(self) -> Criterion:
        """The criterion of optimality."""
        return self.cost.criterion

    def with_variables(self, **changes: Any) -> DesignProblem:
        """Return the same problem with other fields of its `DesignVariables`."""
        variables = replace(self.variables, **changes)
        return replace(self, cost=replace(self.cost, variables=variables))

    def with_criterion(self, criterion: Criterion) -> DesignProblem:
        """Return the same problem with another criterion, evenly scaled if it may be."""
        cost = replace(self.cost, criterion=criterion)
        if criterion.invariant and self.even_scaling is not None:
            cost = replace(cost, scaling=self.even_scaling)
        return replace(self, cost=cost)

    def with_noise(self, memory: PeriodicNoise | None) -> DesignProblem:
        """Return the same problem under noise that is not white; None: white."""
        return replace(self, cost=replace(self.cost, memory=memory))

    def with_prior(self, prior: PriorMachine | None, scaling: Array) -> DesignProblem:
        """Return the same problem for what its parameters have changed by; None: no prior.

        `scaling`, (m,), is that of all parameters.
        """
        if prior is None:
            return self
        every = np.arange(len(scaling), dtype=np.intp)
        return replace(self, cost=replace(self.cost, columns=every, scaling=scaling, prior=prior))

    def compile(self) -> None:
        """Make the machine code of everything that a search evaluates, for all its processes."""
        self.limits.compile()
        self.cost.compile()

    def states(self, x: Array, phases: Array) -> Array:
        """Return pose, rate and acceleration of scaled variables at phases ωt, (K, 18)."""
        return self.variables.states(x, PhaseBasis.at(phases, self.variables.harmonics))

    def smooth_violations(self, x: Array, phases: Array, width: float) -> Array:
        """Return (K, R) excess of the smooth rows over their bounds at phases; see `LimitModel`."""
        return self.limits.smooth_violations(self.states(x, phases), width)

    def program(
        self,
        phases: Array,
        mask: Mask,
        *,
        width: float,
        level: float,
        samples: int,
        margins: Array | None = None,
    ) -> LimitedProgram:
        """Return the nonlinear program with the rows of a mask, (K, R), at phases ωt, (K,), rad.

        Dry friction is smoothed by `width`, m/s; `level` is the sharpness of the criterion's
        surrogate; `samples` are those of one period in the cost, a third of them in its Hessian.
        The natural bounds are drawn in by `margins`, (K, R), shares of their ranges.
        """
        used = np.any(mask, axis=1)
        basis = PhaseBasis.at(phases[used], self.variables.harmonics)
        margins = None if margins is None else margins[used]
        bounds = self.variables.bounds()
        program = LimitedProgram(
            self.limits, self.variables, basis, mask[used], width, bounds, margins
        )
        cost = replace(self.cost, samples=samples)
        program.cost = partial(cost.value, width=width, level=level)
        program.cost_gradient = partial(cost.gradient, width=width, level=level)
        few = replace(cost, samples=min(samples, max(_LEAST, samples // _FEWER)))

        def derivatives(x: Array) -> tuple[float, Array, Array]:
            _, _, hessian = few.derivatives(x, width, level)
            return *cost.gradient(x, width, level), hessian

        program.cost_derivatives = derivatives
        return program

    def cost_value(self, x: Array, width: float, level: float, samples: int) -> float:
        """Return the smoothed criterion over a number of samples of the period."""
        return replace(self.cost, samples=samples).value(x, width, level)


class Path(Protocol):
    """How a motion follows from its variables; `points` say where on it one looks."""

    def states(self, variables: Array, points: Any) -> Array:
        """Return the states (K, 18), or (K, 24) with the pose's third derivative, at points."""

    def slope(self, variables: Array, points: Any) -> PathSlope:
        """Return the derivatives of those states to the variables (z,)."""


class LimitedProgram:
    """Minimise f(x) subject to lower ≤ x ≤ upper and row_lower ≤ g(x) ≤ row_upper, g the limits.

    Attributes
    ----------
    cost, cost_gradient, cost_derivatives : callable
        x (z,) → f; f and its gradient (z,); both and a positive semidefinite Hessian (z, z).

    Parameters
    ----------
    points
        K points of the path.
    mask : (K, R) of bool
        Which limit holds at which point: the rows that the program contains.
    width : float
        Smoothing of dry friction, m/s.
    bounds : ((z,), (z,))
        Of the variables.
    margins : (K, R), optional
        How far the natural bounds are drawn in, as shares of their ranges.
    """

    cost: Callable[[Array], float]
    cost_gradient: Callable[[Array], tuple[float, Array]]
    cost_derivatives: Callable[[Array], tuple[float, Array, Array]]

    def __init__(
        self,
        limits: LimitModel,
        path: Path,
        points: Any,
        mask: Mask,
        width: float,
        bounds: tuple[Array, Array],
        margins: Array | None = None,
    ) -> None:
        self._limits, self._path, self._points, self._mask = limits, path, points, mask
        self._width = width
        self._rows = Rows.of(mask, limits.scale)
        self.row_lower, self.row_upper = (
            np.broadcast_to(side, mask.shape)[mask] / self._rows.scale
            for side in limits.smooth_bounds(margins)
        )
        self.lower, self.upper = bounds

    def within(self, center: Array, radius: float | None) -> Self:
        """Confine the variables to a box about a point; None leaves them free."""
        if radius is not None:
            self.lower = np.maximum(self.lower, center - radius)
            self.upper = np.minimum(self.upper, center + radius)
        return self

    def rows(self, x: Array) -> Array:
        """Return the scaled limit rows."""
        states = self._path.states(x, self._points)
        return self._limits.smooth_values(states, self._width)[self._mask] / self._rows.scale

    def linear_rows(self, x: Array) -> LinearRows:
        """Return the scaled limit rows with their derivatives."""
        states = self._path.states(x, self._points)
        values, slopes = self._limits.smooth_slopes(states, self._width)
        scaled = values[self._mask] / self._rows.scale
        return LinearRows(scaled, self._path.slope(x, self._points), slopes, self._rows)

    def excess(self, x: Array) -> float:
        """Return how far the rows are broken at most, in the program's own scaling."""
        worst = largest_excess(self.rows(x), self.row_lower, self.row_upper)
        return worst if np.isfinite(worst) else np.inf


def largest_excess(values: Array, lower: Array, upper: Array) -> float:
    """Return how far values are beyond their bounds at most; 0 where none is."""
    return float(np.max(np.maximum(lower - values, values - upper), initial=0.0))


def hidden_by_smoothing(
    limits: LimitModel, states: Array, exact: Array, width: float, reach: int, *, periodic: bool
) -> Array:
    """Return how far smoothed violations are below the unsmoothed, `exact`, at most, (N, R) each.

    Within `reach` states to either side: that covers the jumps of dry friction where a sign
    changes. It is zero for rows that are bounded on one side only.
    """
    smooth = limits.smooth_violations(states, width)
    comparable = limits.two_sided & np.isfinite(exact) & np.isfinite(smooth)
    excess = np.subtract(exact, smooth, out=np.zeros_like(exact), where=comparable)
    mode = "wrap" if periodic else "nearest"
    size = 2 * reach + 1
    hidden: Array = scipy.ndimage.maximum_filter1d(np.maximum(excess, 0), size, axis=0, mode=mode)
    return hidden


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
    """State the design problem of a robot with its limits.

    Parameters
    ----------
    frequency : (float, float)
        Bounds on the base frequency, Hz.
    samples : int
        Samples of one period over which F is summed.
    covariance : (6, 6)
        Σ, N².
    scaling : (m,)
        Scale of every parameter: column k of A is multiplied by it.
    names : tuple of str
        Parameters that the criterion judges.
    """
    limits = LimitModel.of(robot)
    lowest, highest = (2 * np.pi * bound for bound in frequency)
    middle, reach = coordinate_reach(limits)
    variables = DesignVariables(harmonics, reach / 2, middle, (lowest, highest), highest)
    columns = np.array([robot.parameter_names.index(name) for name in names], dtype=np.intp)
    cost = InformationCost(
        robot.terms,
        robot.machine,
        variables,
        covariance,
        columns,
        scaling[columns],
        criterion,
        samples,
    )
    return DesignProblem(limits, cost, names)
