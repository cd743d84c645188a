"""The design problem of one robot: limits, objective and variables, and its nonlinear programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array, Mask
from expdesign.evaluation.batch import BatchFunction
from expdesign.information.criteria import Criterion
from expdesign.information.marginal import Marginal
from expdesign.problem.objective import DeviationColumns, InformationCost
from expdesign.problem.program import Program
from expdesign.problem.variables import DesignVariables, coordinate_reach
from expdesign.robot import LimitModel, Robot
from expdesign.robot.deviation import Deviation
from expdesign.robot.fixed_lengths import DeviationGroups
from expdesign.trajectory import PhaseBasis


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
    even_scaling: tuple[Array, Array] | None = None
    """Scalings, (M,) and (k,), in which F and the judged information of a typical motion have unit
    diagonals. Criteria that do not depend on the scaling keep more digits in this one."""

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
            scaling, judged = self.even_scaling
            cost = replace(cost, scaling=scaling, judged=judged)
        return replace(self, cost=cost)

    def with_marginal(
        self,
        marginal: Marginal,
        scaling: Array,
        judged: Array,
        columns: NDArray[np.intp],
        deviating: Sequence[Deviation] = (),
    ) -> DesignProblem:
        """Return the same problem for the information on some quantities alone.

        Parameters
        ----------
        marginal : Marginal
            Of the parameters in `columns`, then the unknowns of `group_effects`.
        scaling : (M,)
            Scale of each of these.
        judged : (k,)
            Scale of each quantity of interest.
        columns : (m,)
            Parameters that are unknown.
        deviating : sequence of Deviation
            The deviations among the unknowns.
        """
        robot, cost = self.robot, self.cost
        if deviating:
            groups = DeviationGroups.of(robot, deviating)
            about = robot.extended
            effects = DeviationColumns(groups, about.machine, about.parameters)
            further = len(robot.parameters) + np.arange(len(scaling) - len(columns))
            columns = np.concatenate([columns, further]).astype(np.intp)
            cost = replace(cost, effects=effects)
        cost = replace(cost, columns=columns, scaling=scaling, marginal=marginal, judged=judged)
        return replace(self, cost=cost)

    @property
    def kernels(self) -> list[BatchFunction]:
        """The functions that a search evaluates."""
        return [*self.cost.kernels, *self.limits.kernels]

    def compile(self) -> None:
        """Compile everything that a search evaluates, for all its processes."""
        for made in self.kernels:
            made.compile()

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
