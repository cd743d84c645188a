"""Slacks, their bounds and multipliers, and the logarithmic barrier at the bounds.

Every function is one compiled loop over all bounded quantities.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.evaluation.compiled import compiled
from expdesign.problem.program import Program

_INSIDE = 1e-2
"""Distance of the first slacks from their bounds, relative to the bound or to the range."""
_ROUNDING = 1e-13
"""Smallest distance of slacks from their bounds, relative to the bound."""
_DECADES = 10
"""Largest deviation of multiplier times distance from μ, in orders of magnitude."""


class Bounds(NamedTuple):
    """Bounds of all bounded quantities, (b,): variables first, then the program's rows."""

    lower: Array
    upper: Array
    lowest: Array
    """(b,), smallest and largest values of slacks: rounding puts none on a bound."""
    highest: Array
    variables: NDArray[np.intp]
    """Indices of the bounded variables."""

    @classmethod
    def of(cls, program: Program) -> Bounds:
        """Return the bounds of a program."""
        bounded = np.flatnonzero(np.isfinite(program.lower) | np.isfinite(program.upper))
        lower = np.concatenate([program.lower[bounded], program.row_lower])
        upper = np.concatenate([program.upper[bounded], program.row_upper])
        # Equal bounds have no interior.
        width = 1e-8 * np.maximum(1.0, np.abs(np.where(np.isfinite(lower), lower, 1.0)))
        room = np.where(upper - lower < width, width, 0.0)
        lower, upper = lower - room, upper + room
        lowest, highest = lower + _ROUNDING * _size(lower), upper - _ROUNDING * _size(upper)
        return cls(lower, upper, lowest, highest, bounded)

    def inside(self, values: Array) -> Array:
        """Return values clipped to the interior of the bounds, with a small margin."""
        width = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, np.inf)
        lower = self.lower + _INSIDE * np.minimum(_size(self.lower), width)
        return np.clip(values, lower, self.upper - _INSIDE * np.minimum(_size(self.upper), width))


def _size(bounds: Array) -> Array:
    """Return the scale of distances from bounds."""
    return np.maximum(1.0, np.abs(np.where(np.isfinite(bounds), bounds, 0.0)))


class Duals(NamedTuple):
    """Multipliers (b,) of the equations slack = value, and of the lower and upper bounds."""

    values: Array
    lower: Array
    upper: Array


class SlackStep(NamedTuple):
    """A step of slacks (b,) and multipliers, with its largest admissible shares."""

    change: Array
    """Of the slacks."""
    duals: Duals
    share: float
    """Largest share of the slacks' step, at most 1."""
    dual_share: float
    """Largest share of the multipliers' step."""
    slope: float
    """Directional derivative of the barrier."""


class SlackTrial(NamedTuple):
    """Slacks (b,) after a step."""

    slacks: Array
    logarithms: float
    """Sum of the logarithms of the distances from the bounds: the barrier is −μ times this."""
    distance: float
    """ℓ₁ norm of the difference between slacks and values."""


@compiled
def barrier_multipliers(bounds: Bounds, slacks: Array, barrier: float) -> Duals:
    """Return the multipliers of the bounds on the central path, μ over the distance."""
    size = len(slacks)
    values, lower, upper = np.zeros(size), np.zeros(size), np.zeros(size)
    for b in range(size):
        if bounds.lower[b] > -np.inf:
            lower[b] = barrier / (slacks[b] - bounds.lower[b])
        if bounds.upper[b] < np.inf:
            upper[b] = barrier / (bounds.upper[b] - slacks[b])
        values[b] = upper[b] - lower[b]
    return Duals(values, lower, upper)


@compiled
def eliminate_slacks(
    bounds: Bounds, values: Array, slacks: Array, duals: Duals, barrier: float
) -> tuple[Array, Array]:
    """Return curvature (b,) and multipliers (b,) of the step's equations without slacks.

    The step x solves (H + Jᵀ diag(curvature) J) x = −(gradient + Jᵀ multipliers).
    """
    size = len(slacks)
    curvature, multipliers = np.zeros(size), np.zeros(size)
    for b in range(size):
        ratio, push = 0.0, 0.0
        if bounds.lower[b] > -np.inf:
            gap = slacks[b] - bounds.lower[b]
            ratio += duals.lower[b] / gap
            push -= barrier / gap
        if bounds.upper[b] < np.inf:
            gap = bounds.upper[b] - slacks[b]
            ratio += duals.upper[b] / gap
            push += barrier / gap
        curvature[b] = ratio
        multipliers[b] = ratio * (values[b] - slacks[b]) + push
    return curvature, multipliers


@compiled
def slack_step(
    bounds: Bounds, slacks: Array, duals: Duals, change: Array, barrier: float, close: float
) -> SlackStep:
    """Return the step of the multipliers for a change (b,) of the slacks.

    No slack covers more than the share `close` of its distance from a bound, and no multiplier
    of a bound decreases by more than that share.
    """
    size = len(slacks)
    values, lower, upper = np.empty(size), np.zeros(size), np.zeros(size)
    share, dual_share, slope = 1.0, 1.0, 0.0
    for b in range(size):
        if bounds.lower[b] > -np.inf:
            gap = slacks[b] - bounds.lower[b]
            push = barrier / gap
            lower[b] = push - duals.lower[b] - duals.lower[b] / gap * change[b]
            slope -= push * change[b]
            if change[b] < 0:
                share = min(share, -close * gap / change[b])
            if lower[b] < 0:
                dual_share = min(dual_share, -close * duals.lower[b] / lower[b])
        if bounds.upper[b] < np.inf:
            gap = bounds.upper[b] - slacks[b]
            push = barrier / gap
            upper[b] = push - duals.upper[b] + duals.upper[b] / gap * change[b]
            slope += push * change[b]
            if change[b] > 0:
                share = min(share, close * gap / change[b])
            if upper[b] < 0:
                dual_share = min(dual_share, -close * duals.upper[b] / upper[b])
        values[b] = duals.upper[b] + upper[b] - duals.lower[b] - lower[b] - duals.values[b]
    return SlackStep(change, Duals(values, lower, upper), share, dual_share, slope)


@compiled
def try_slacks(
    bounds: Bounds, values: Array, slacks: Array, change: Array, close: float, following: bool
) -> SlackTrial:
    """Return slacks after a change (b,), at new values (b,).

    With `following` a slack equals its value, provided that it covers no more than the share
    `close` of the slack's distance from its bounds.
    """
    found, logarithms, distance = np.empty(len(slacks)), 0.0, 0.0
    for b in range(len(slacks)):
        bounded_below, bounded_above = bounds.lower[b] > -np.inf, bounds.upper[b] < np.inf
        slack = min(max(slacks[b] + change[b], bounds.lowest[b]), bounds.highest[b])
        if following:
            stays = True
            if bounded_below:
                gap = slacks[b] - bounds.lower[b]
                stays = values[b] - bounds.lower[b] >= (1 - close) * gap
            if bounded_above:
                gap = bounds.upper[b] - slacks[b]
                stays = stays and bounds.upper[b] - values[b] >= (1 - close) * gap
            if stays:
                slack = values[b]
        if bounded_below:
            logarithms += np.log(slack - bounds.lower[b])
        if bounded_above:
            logarithms += np.log(bounds.upper[b] - slack)
        distance += abs(values[b] - slack)
        found[b] = slack
    return SlackTrial(found, logarithms, distance)


@compiled
def update_multipliers(
    bounds: Bounds, slacks: Array, duals: Duals, step: SlackStep, share: float, barrier: float
) -> Duals:
    """Return the multipliers after a share of a step, at the slacks reached."""
    size, wide = len(slacks), 10.0**_DECADES
    values, lower, upper = np.empty(size), np.zeros(size), np.zeros(size)
    for b in range(size):
        values[b] = duals.values[b] + share * step.duals.values[b]
        if bounds.lower[b] > -np.inf:
            push = barrier / (slacks[b] - bounds.lower[b])
            there = duals.lower[b] + step.dual_share * step.duals.lower[b]
            lower[b] = min(max(there, push / wide), push * wide)
        if bounds.upper[b] < np.inf:
            push = barrier / (bounds.upper[b] - slacks[b])
            there = duals.upper[b] + step.dual_share * step.duals.upper[b]
            upper[b] = min(max(there, push / wide), push * wide)
    return Duals(values, lower, upper)


@compiled
def optimality_error(
    bounds: Bounds, slope: Array, values: Array, slacks: Array, duals: Duals
) -> float:
    """Return the largest violation of the optimality conditions, scaled as in Ipopt.

    `slope` (z,) is the gradient of the Lagrangian. The error is infinite if anything is NaN.
    """
    largest, distance, size, total = 0.0, 0.0, 0.0, 0.0
    for z in range(len(slope)):
        total += abs(slope[z])
        largest = max(largest, abs(slope[z]))
    for b in range(len(slacks)):
        size += abs(duals.values[b]) + duals.lower[b] + duals.upper[b]
        total += abs(values[b] - slacks[b])
        distance = max(distance, abs(values[b] - slacks[b]))
        largest = max(largest, abs(duals.upper[b] - duals.lower[b] - duals.values[b]))
        if bounds.lower[b] > -np.inf:
            largest = max(largest, (slacks[b] - bounds.lower[b]) * duals.lower[b])
        if bounds.upper[b] < np.inf:
            largest = max(largest, (bounds.upper[b] - slacks[b]) * duals.upper[b])
    scale = max(100.0, size / max(1, 2 * len(slacks))) / 100
    # Compiled, max(number, NaN) is the number; a sum is NaN.
    return max(largest / scale, distance) if np.isfinite(size + total) else np.inf
