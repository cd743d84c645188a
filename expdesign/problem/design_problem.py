"""The design problem: variables, objective and limits. It states them and solves nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.information.spectral import Criterion
from expdesign.problem.cost import InformationCost
from expdesign.problem.program import LimitedProgram
from expdesign.problem.variables import DesignVariables, coordinate_reach
from expdesign.robot import LimitModel, Robot
from expdesign.trajectory import PhaseBasis


@dataclass(frozen=True)
class DesignProblem:
    """What is to be designed, for one robot.

    Attributes
    ----------
    limits : LimitModel
        Robot and limits.
    cost : InformationCost
        The smoothed objective; its `samples` and ω bounds are the user's.
    names : tuple of str
        Parameters that the criterion judges.
    even_scaling : (k,) or None
        Scaling that gives F of a typical motion a unit diagonal: for criteria that do not depend
        on the scaling, but keep more digits in this one.
    """

    limits: LimitModel
    cost: InformationCost
    names: tuple[str, ...]
    even_scaling: Array | None = None

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
    ) -> DesignProgram:
        """Return the nonlinear program with the rows of a mask.

        Parameters
        ----------
        phases : (K,)
            ωt, rad.
        mask : (K, R) of bool
            Which limit holds at which phase.
        width : float
            Smoothing of dry friction, m/s.
        level : float
            Sharpness of the criterion's surrogate.
        samples : int
            Samples of one period in the cost.
        margins : (K, R), optional
            How far the natural bounds are drawn in, as shares of their ranges.
        """
        used = np.any(mask, axis=1)
        basis = PhaseBasis.at(phases[used], self.variables.harmonics)
        margins = None if margins is None else margins[used]
        return DesignProgram(
            self, basis, mask[used], margins, replace(self.cost, samples=samples), width, level
        )

    def cost_value(self, x: Array, width: float, level: float, samples: int) -> float:
        """Return the smoothed criterion over a number of samples of the period."""
        return replace(self.cost, samples=samples).value(x, width, level)


class DesignProgram(LimitedProgram):
    """One nonlinear program of a design: `expdesign.solver.ipopt.NonlinearProgram`."""

    def __init__(
        self,
        problem: DesignProblem,
        basis: PhaseBasis,
        mask: Mask,
        margins: Array | None,
        cost: InformationCost,
        width: float,
        level: float,
    ) -> None:
        variables = problem.variables
        super().__init__(problem.limits, variables, basis, mask, width, variables.bounds(), margins)
        self._cost, self._level = cost, level

    def cost(self, x: Array) -> float:
        """Return the smoothed criterion."""
        return self._cost.value(x, self._width, self._level)

    def cost_derivatives(self, x: Array) -> tuple[float, Array, Array]:
        """Return the smoothed criterion, its gradient and Gauss–Newton Hessian."""
        return self._cost.derivatives(x, self._width, self._level)

    def cost_gradient(self, x: Array) -> tuple[float, Array]:
        """Return the smoothed criterion and its gradient."""
        return self._cost.gradient(x, self._width, self._level)


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
