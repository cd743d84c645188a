"""The design problem and its nonlinear program: variables, objective and limits.

`Program` states the limit rows of any motion along a path, the ramps' too. Solvers are elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Protocol

import numpy as np
import scipy

from constraints.arrays import Array, Mask
from expdesign.information.criteria import Criterion
from expdesign.information.fisher import PeriodicNoise
from expdesign.information.prior import PriorMachine
from expdesign.problem.cost import InformationCost
from expdesign.problem.path_slope import LinearRows, PathSlope, RowIndex
from expdesign.problem.variables import DesignVariables, coordinate_reach
from expdesign.robot import LimitModel, Robot
from expdesign.trajectory import PhaseBasis

_FEWER, _LEAST = 3, 16
"""Samples of the cost per sample of its Hessian, and the Hessian's smallest number of samples. With
all samples the Hessian is the most expensive part of an iteration, and searches end no better (240
starts of `palida` for `d`; 24 to 48 for the other criteria and for 1 to 12 harmonics)."""


@dataclass(frozen=True)
class DesignProblem:
    """Limits, smoothed objective and variables of the design for one robot."""

    limits: LimitModel
    cost: InformationCost
    """The smoothed objective; its `samples` and ω bounds are the user's."""
    names: tuple[str, ...]
    """Parameters that the criterion judges."""
    even_scaling: Array | None = None
    """Scaling in which F of a typical motion has a unit diagonal. Criteria that do not depend on
    the scaling keep more digits in this one."""

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
        """Return the same problem with another criterion, evenly scaled if the criterion allows."""
        cost = replace(self.cost, criterion=criterion)
        if criterion.invariant and self.even_scaling is not None:
            cost = replace(cost, scaling=self.even_scaling)
        return replace(self, cost=cost)

    def with_noise(self, memory: PeriodicNoise | None) -> DesignProblem:
        """Return the same problem for coloured noise; None: white."""
        return replace(self, cost=replace(self.cost, memory=memory))

    def with_prior(self, prior: PriorMachine | None, scaling: Array) -> DesignProblem:
        """Return the same problem for the change of its parameters; None: no prior.

        `scaling`, (m,), applies to all parameters.
        """
        if prior is None:
            return self
        every = np.arange(len(scaling), dtype=np.intp)
        return replace(self, cost=replace(self.cost, columns=every, scaling=scaling, prior=prior))

    def compile(self) -> None:
        """Compile everything that a search evaluates, for all its processes."""
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
        box: tuple[Array, float | None] | None = None,
    ) -> Program:
        """Return the nonlinear program with the rows of a mask, (K, R), at phases ωt, (K,), rad.

        Parameters
        ----------
        width : float
            Smoothing of dry friction, m/s.
        level : float
            Sharpness of the criterion's surrogate.
        samples : int
            Samples of one period in the cost; its Hessian has a third of them.
        margins : (K, R), optional
            Reduction of the natural bounds, as shares of their ranges.
        box : ((z,), float or None), optional
            Centre and half-width of a box about the variables; None: no box.
        """
        used = np.any(mask, axis=1)
        basis = PhaseBasis.at(phases[used], self.variables.harmonics)
        margins = None if margins is None else margins[used]
        bounds = self.variables.bounds()
        center, radius = box or (None, None)
        if center is not None and radius is not None:
            bounds = np.maximum(bounds[0], center - radius), np.minimum(bounds[1], center + radius)
        program = Program(self.limits, self.variables, basis, mask[used], width, bounds, margins)
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
    """A motion as a function of its variables, evaluated at points along it."""

    def states(self, variables: Array, points: Any) -> Array:
        """Return the states (K, 18), or (K, 24) with the pose's third derivative, at points."""

    def slope(self, variables: Array, points: Any) -> PathSlope:
        """Return the derivatives of those states to the variables (z,)."""


class Program:
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
        Rows of the program: limits by points.
    width : float
        Smoothing of dry friction, m/s.
    bounds : ((z,), (z,))
        Of the variables.
    margins : (K, R), optional
        Reduction of the natural bounds, as shares of their ranges.
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
        self._rows = RowIndex.of(mask, limits.scale)
        self.row_lower, self.row_upper = (
            np.broadcast_to(side, mask.shape)[mask] / self._rows.scale
            for side in limits.smooth_bounds(margins)
        )
        self.lower, self.upper = bounds

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
        """Return the largest violation of a row, in the program's own scaling."""
        worst = largest_excess(self.rows(x), self.row_lower, self.row_upper)
        return worst if np.isfinite(worst) else np.inf


def largest_excess(values: Array, lower: Array, upper: Array) -> float:
    """Return the largest excess of values over their bounds; 0 within them.

    Examples
    --------
    >>> import numpy as np
    >>> largest_excess(np.array([0.0, 2.5]), np.zeros(2), np.array([1.0, 2.0]))
    0.5
    """
    return float(np.max(np.maximum(lower - values, values - upper), initial=0.0))


def smoothing_gap(
    limits: LimitModel, states: Array, exact: Array, width: float, reach: int, *, periodic: bool
) -> Array:
    """Return the largest excess of the exact violations over the smoothed ones, (N, R).

    The maximum is taken over `reach` states to either side: that covers the jumps of dry friction
    at sign changes. It is zero for rows with a single bound.
    """
    smooth = limits.smooth_violations(states, width)
    comparable = limits.two_sided & np.isfinite(exact) & np.isfinite(smooth)
    excess = np.subtract(exact, smooth, out=np.zeros_like(exact), where=comparable)
    mode = "wrap" if periodic else "nearest"
    size = 2 * reach + 1
    gap: Array = scipy.ndimage.maximum_filter1d(np.maximum(excess, 0), size, axis=0, mode=mode)
    return gap


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
