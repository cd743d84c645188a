"""Sensitivity of a design to its limits: the gain of the criterion if a limit were wider.

At an optimum the gradient of the cost is balanced by those of the limits that hold it (Karush,
Kuhn, Tucker): ∇c + Σ λᵢ ∇vᵢ = 0 with multipliers λᵢ ≥ 0, vᵢ the excess over bound i. Each λᵢ is
then the rate of decrease of the best cost with bound i. A finished design is slightly inside its
limits, with a period of a whole number of controller steps: one more solve of the smoothed problem
first moves it to the nearest optimum. There the multipliers are found by nonnegative least squares
over the moments at which limits are reached. The unexplained part of ∇c is stated: a motion far
from an optimum has no multipliers. Without that solve, at the design itself, limits count within a
larger margin: that is quick, with errors of a tenth of the gains.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls

from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.experiment.setup import plan_search
from expdesign.problem.design_problem import DesignProblem
from expdesign.recheck.limit_check import local_worst
from expdesign.robot import LimitModel
from expdesign.solver.phases import finish_phase
from expdesign.solver.starts import SearchPlan, no_report, solve_phase
from expdesign.trajectory import FourierTrajectory

FREQUENCY = "frequency"
"""Key of the bounds on the base frequency, which constrain the motion like limits."""
WIDER = 0.1
"""Relative widening of a limit: of its range, or of its only bound."""

_POINTS = 4000
_NEAR = 5e-3
"""Distance from the bound, as a share of the range, within which a limit is active."""
_NEAR_A_DESIGN = 1e-2
"""The same for a finished design."""
_STEP = 1e-4
EXPLAINED = 0.1
"""Largest unexplained share of the cost's gradient with which gains and costs are stated."""
_RADIUS = 0.3
"""Half-width of the box about the design in which the nearest optimum is sought."""


@dataclass(frozen=True)
class LimitSensitivity:
    """Sensitivity of a design's criterion to its limits."""

    gains: dict[str, float]
    """By limit: relative improvement of the criterion, to first order, if the limit alone were 10 %
    wider: of the D-efficiency for log det F, of the criterion's value otherwise. Zero for inactive
    limits."""
    unexplained: float
    """Unexplained part of the cost's gradient, as a share of its norm; 0 at an exact optimum, 1
    without active limits."""
    reserved: dict[str, float] = field(default_factory=dict)
    """By limit with a reserve: relative loss of the criterion due to this reserve alone, to first
    order."""
    reserve: float = 0.0
    """The same for all reserves together."""

    @property
    def explained(self) -> bool:
        """Whether the limits explain the cost: otherwise the design is not near an optimum."""
        return self.unexplained <= EXPLAINED

    @property
    def costliest(self) -> str | None:
        """Key of the limit whose widening gains most; None where no gain is known."""
        key = max(self.gains, key=self.gains.__getitem__, default="")
        return key if self.explained and self.gains.get(key, 0.0) > 0 else None


def limit_sensitivity(
    configuration: RunConfiguration, trajectory: FourierTrajectory
) -> LimitSensitivity:
    """Return the sensitivity of a design of this run to its limits, at the nearest optimum."""
    plan = plan_search(configuration)
    problem = plan.problem
    phase = replace(finish_phase(problem, plan.widths, plan.iterations), radius=_RADIUS)
    x, _ = solve_phase(problem, phase, problem.variables.pack(trajectory), no_report)
    return _sensitivity(plan, x, _NEAR)


def sensitivity_at_design(plan: SearchPlan, trajectory: FourierTrajectory) -> LimitSensitivity:
    """Return the approximate sensitivity of a finished design, without another solve."""
    return _sensitivity(plan, plan.problem.variables.pack(trajectory), _NEAR_A_DESIGN)


def _sensitivity(plan: SearchPlan, x: Array, near: float) -> LimitSensitivity:
    problem = plan.problem
    width, level = plan.widths[-1], problem.criterion.levels[-1]
    value, slope = problem.cost.gradient(x, width, level)

    def improvement(decrease: float) -> float:
        if problem.criterion.invariant:
            return float(np.exp(decrease))
        now, then = (problem.cost.criterion_value(cost) for cost in (value, value - decrease))
        return then / now if problem.criterion.larger_is_better else now / then

    held = _active_rows(problem, x, width, near)
    multipliers, unexplained = balance_gradients(slope, held.slopes)
    reserves = [limit.key for limit in problem.limits.limits if limit.reserve]
    gains = dict.fromkeys((*problem.limits.keys, FREQUENCY), 0.0)
    costs = dict.fromkeys(reserves, 0.0)
    parts = zip(held.keys, multipliers, held.wider, held.reserved, strict=True)
    for key, multiplier, wider, reserved in parts:
        gains[key] += float(multiplier * wider)
        if key in costs:
            costs[key] += float(multiplier * reserved)
    return LimitSensitivity(
        {key: improvement(gain) - 1 for key, gain in gains.items()},
        unexplained,
        {key: 1 - 1 / improvement(cost) for key, cost in costs.items()},
        1 - 1 / improvement(sum(costs.values())),
    )


def balance_gradients(slope: Array, slopes: Array) -> tuple[Array, float]:
    """Return multipliers λ ≥ 0 that minimise ‖∇c + Σ λᵢ ∇vᵢ‖, and the residual's share of ‖∇c‖.

    `slope`, (z,), is ∇c, the rows of `slopes`, (r, z), are ∇vᵢ.

    Examples
    --------
    >>> import numpy as np
    >>> multipliers, unexplained = balance_gradients(np.array([-2.0, 0.0]), np.array([[1.0, 0.0]]))
    >>> multipliers.tolist(), unexplained
    ([2.0], 0.0)
    """
    size = float(np.linalg.norm(slope))
    if size == 0:
        return np.zeros(len(slopes)), 0.0
    if not len(slopes):
        return np.zeros(0), 1.0
    multipliers, left = nnls(slopes.T, -slope)
    return multipliers, float(left) / size


class _ActiveRows(NamedTuple):
    """Active limits and their moments, r of them."""

    keys: list[str]
    slopes: Array
    """(r, z) gradients of the excess."""
    wider: Array
    reserved: Array
    """Shift of the row's bound in the unit of its excess: for a wider limit, without reserve."""


def _active_rows(problem: DesignProblem, x: Array, width: float, near: float) -> _ActiveRows:
    phases = 2 * np.pi * np.arange(_POINTS) / _POINTS
    excess = problem.smooth_violations(x, phases, width)
    mask = local_worst(excess, periodic=True) & (excess > -near)
    program = problem.program(
        phases, mask, width=width, level=problem.criterion.levels[-1], samples=_POINTS
    )
    rows = program.linear_rows(x)
    _, columns = np.nonzero(mask)
    above = rows.values - program.row_upper > program.row_lower - rows.values
    keys = [problem.limits.keys[column] for column in columns]
    sign = np.where(above, 1.0, -1.0)
    wider, reserved = (
        np.where(above, up[columns], down[columns])
        for down, up in (_widening_shifts(problem), _reserve_shifts(problem))
    )
    bounds = _frequency_rows(problem, x, near)
    return _ActiveRows(
        [*keys, *[FREQUENCY] * len(bounds)],
        np.concatenate([sign[:, None] * rows.jacobian(), bounds]),
        np.concatenate([wider, np.full(len(bounds), WIDER)]),
        np.concatenate([reserved, np.zeros(len(bounds))]),
    )


def _widening_shifts(problem: DesignProblem) -> tuple[Array, Array]:
    """Return the shifts of lower and upper smooth bounds for wider limits, (R,) each."""
    limits = problem.limits
    # Both ends of a range move by half of the widening.
    share = np.where(limits.two_sided, WIDER / 2, WIDER)
    below, above = _bound_shifts(limits, limits.smooth_bounds(-_STEP * share))
    return below / _STEP / limits.scale, above / _STEP / limits.scale


def _reserve_shifts(problem: DesignProblem) -> tuple[Array, Array]:
    limits = problem.limits
    stated = replace(limits, limits=tuple(limit.with_reserve(0.0) for limit in limits.limits))
    below, above = _bound_shifts(limits, stated.smooth_bounds())
    return below / limits.scale, above / limits.scale


def _bound_shifts(limits: LimitModel, bounds: tuple[Array, Array]) -> tuple[Array, Array]:
    """Return the distances of other smooth bounds beyond the limits' own, (R,) each."""
    lower, upper = limits.smooth_bounds()
    with np.errstate(invalid="ignore"):
        below, above = lower - bounds[0], bounds[1] - upper
    return np.nan_to_num(below), np.nan_to_num(above)


def _frequency_rows(problem: DesignProblem, x: Array, near: float) -> Array:
    """Return the gradients of ω's active bounds, relative to the bound."""
    variables = problem.variables
    rows = []
    for bound, sign in zip(variables.omega_bounds, (-1.0, 1.0), strict=True):
        scaled = bound / variables.omega_scale
        if sign * (x[-1] - scaled) / scaled > -near:
            row = np.zeros(x.size)
            row[-1] = sign / scaled
            rows.append(row)
    return np.array(rows).reshape(-1, x.size)
