"""Everything that a ramp has to keep: the robot's limits and the bound on the struts' jerk."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray

from constraints import LimitDefinition
from constraints.arrays import Array
from expdesign.mechanism.term import Term
from expdesign.motion.jerk import strut_jerk, strut_jerk_kernel
from expdesign.problem.limit_rows import LimitKernels
from expdesign.robot import ExactModel, hexapod_graph

JERK = "strut_jerk"


@cache
def _kernels(definitions: tuple[LimitDefinition, ...], terms: tuple[Term, ...]) -> LimitKernels:
    return LimitKernels.of(hexapod_graph(terms), definitions)


@dataclass(frozen=True, eq=False)
class RampLimits:
    """Rows of one instant: those of the limits in their order, then the jerk of the six struts.

    Every row is divided by the range between its bounds (`scale`).

    Attributes
    ----------
    exact : ExactModel
        Robot and limits by the unsmoothed model.
    jerk : (6,)
        Largest jerk of each strut, m/s³.
    """

    exact: ExactModel
    jerk: Array

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Key of the limit that each row belongs to."""
        keys = [limit.key for limit in self.exact.limits for _ in limit.labels]
        return (*keys, *[JERK] * 6)

    @cached_property
    def count(self) -> int:
        """Rows of one instant."""
        return len(self.names)

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        """(R,) True for rows that depend on more than the pose: speeds, forces, jerk."""
        robot = self.exact.robot
        state = np.concatenate([robot.home, np.zeros(12)])[None, :]
        _, slopes = self.slopes(state, np.zeros((1, 6)), 1.0)
        return np.any(slopes[0, :, 6:] != 0, axis=1)

    @cached_property
    def free_at_ends(self) -> NDArray[np.bool_]:
        """(R,) True for rows that the state at a ramp's end does not determine: the jerk."""
        return np.array([name == JERK for name in self.names])

    @cached_property
    def scale(self) -> Array:
        """(R,) what counts as one in each row."""
        lower, upper = self._natural_bounds(np.zeros(self.count))
        both = np.isfinite(lower) & np.isfinite(upper)
        width = np.subtract(upper, lower, out=np.ones_like(upper), where=both)
        one = np.abs(np.where(np.isfinite(lower), lower, upper))
        scale = np.where(both, width, one)
        return np.where(np.isfinite(scale) & (scale > 0), scale, 1.0)

    def bounds(self, margins: Array) -> tuple[Array, Array]:
        """Return scaled bounds, (…, R) each, drawn in by margins (…, R), shares of the ranges."""
        lower, upper = self._natural_bounds(margins)
        return lower / self.scale, upper / self.scale

    def rows(self, states: Array, third: Array, width: float) -> Array:
        """Return the scaled, smoothed rows, (K, R), at states (K, 18) with their jerk (K, 6)."""
        (smooth,) = self._limit_kernels.value(states, *self._fixed(width))
        jerk = strut_jerk(self.exact.robot.geometry_vector, states, third)
        return np.concatenate([smooth, jerk], axis=1) / self.scale

    def slopes(self, states: Array, third: Array, width: float) -> tuple[Array, Array]:
        """Return the rows and their Jacobians, (K, R, 24), to pose, rate, acceleration, jerk."""
        smooth, by_state = self._limit_kernels.derivative(states, *self._fixed(width))
        moving = np.concatenate([states, third], axis=1)
        jerk, jerk_slope = strut_jerk_kernel()(moving, self.exact.robot.geometry_vector)
        count = smooth.shape[1]
        slopes = np.zeros((len(states), self.count, 24))
        slopes[:, :count, :18] = by_state
        slopes[:, count:] = jerk_slope
        values = np.concatenate([smooth, jerk], axis=1)
        return values / self.scale, slopes / self.scale[:, None]

    def smooth_violations(self, states: Array, third: Array, width: float) -> Array:
        """Return (K, R) excess of the smoothed rows; open rows are at −inf, NaN is broken."""
        values = self.rows(states, third, width)
        lower, upper = self.bounds(np.zeros(self.count))
        excess = np.maximum(lower - values, values - upper)
        return np.nan_to_num(excess, nan=np.inf, posinf=np.inf, neginf=-np.inf)

    def exact_violations(self, states: Array, third: Array) -> Array:
        """Return (K, R) excess of the unsmoothed rows as shares of their ranges."""
        jerk = strut_jerk(self.exact.robot.geometry_vector, states, third)
        beyond = (np.abs(jerk) - self.jerk) / (2 * self.jerk)
        return np.concatenate([self.exact.violations(states), beyond], axis=1)

    @property
    def _limit_kernels(self) -> LimitKernels:
        definitions = tuple(limit.definition for limit in self.exact.limits)
        return _kernels(definitions, self.exact.robot.terms)

    def _fixed(self, width: float) -> tuple[Array, ...]:
        robot = self.exact.robot
        length = np.array([robot.characteristic_length])
        return robot.machine, robot.parameters, length, np.array([width])

    def _natural_bounds(self, margins: Array) -> tuple[Array, Array]:
        parts = [
            limit.smooth_bounds(margins[..., columns])
            for limit, columns in zip(self.exact.limits, self.exact.columns(), strict=True)
        ]
        room = self.jerk * (1 - 2 * margins[..., -6:])
        parts.append((-room, room))
        lower, upper = (np.concatenate(side, axis=-1) for side in zip(*parts, strict=True))
        return lower, upper
