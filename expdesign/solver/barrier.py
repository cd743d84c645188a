"""The bounds of slacks, from below and from above, and the barrier that keeps off them.

An iteration looks at all that is bounded a few times, every time in one compiled loop.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.evaluation.compiled import compiled
from expdesign.problem.design_problem import LimitedProgram

_INSIDE = 1e-2
"""How far the first slacks are from their bounds, of the bound or of the distance of both."""
_ROUNDING = 1e-13
"""How far slacks stay from their bounds at least, of the bound."""
_DECADES = 10
"""The products of multipliers and distances stay within so many orders of magnitude of μ."""


class Bounds(NamedTuple):
    """Bounds of everything that is bounded, (b,): variables first, then the program's rows."""

    lower: Array
    upper: Array
    lowest: Array
    """(b,), of slacks that rounding may have put on a bound."""
    highest: Array
    variables: NDArray[np.intp]
    """Indices of the bounded variables."""

    @classmethod
    def of(cls, program: LimitedProgram) -> Bounds:
        """Return the bounds of a program."""
        bounded = np.flatnonzero(np.isfinite(program.lower) | np.isfinite(program.upper))
        lower = np.concatenate([program.lower[bounded], program.row_lower])
        upper = np.concatenate([program.upper[bounded], program.row_upper])
        # Between bounds that are one there is no inside.
        width = 1e-8 * np.maximum(1.0, np.abs(np.where(np.isfinite(lower), lower, 1.0)))
        room = np.where(upper - lower < width, width, 0.0)
        lower, upper = lower - room, upper + room
        lowest, highest = lower + _ROUNDING * _size(lower), upper - _ROUNDING * _size(upper)
        return cls(lower, upper, lowest, highest, bounded)

    def inside(self, values: Array) -> Array:
        """Return the values that are nearest to given ones, a little within the bounds."""
        width = np.where(np.isfinite(self.upper - self.lower), self.upper - self.lower, np.inf)
        lower = self.lower + _INSIDE * np.minimum(_size(self.lower), width)
        return np.clip(values, lower, self.upper - _INSIDE * np.minimum(_size(self.upper), width))


def _size(bounds: Array) -> Array:
    """Return what distances from bounds are small compared to."""
    return np.maximum(1.0, np.abs(np.where(np.isfinite(bounds), bounds, 0.0)))


class Duals(NamedTuple):
    """Multipliers (b,): of slacks against values, and of the lower and upper bounds."""

    values: Array
    lower: Array
    upper: Array


class SlackStep(NamedTuple):
    """A step of slacks (b,) and multipliers, and how far one may go along it."""

    change: Array
    """Of the slacks."""
    duals: Duals
    share: float
    """Of the slacks' step, 1 at most."""
    dual_share: float
    """Of the multipliers'."""
    slope: float
    """What the barrier changes by along it."""


class Trial(NamedTuple):
    """Slacks (b,) after a step."""

    slacks: Array
    logarithms: float
    """Sum of those of the distances from the bounds: the barrier is −μ times this."""
    apart: float
    """ℓ₁ norm of what they differ from the values by."""


@compiled
def pushes(bounds: Bounds, slacks: Array, barrier: float) -> Duals:
    """Return how the barrier pushes slacks away from their bounds: multipliers to begin with."""
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
def condensed(
    bounds: Bounds, values: Array, slacks: Array, duals: Duals, barrier: float
) -> tuple[Array, Array]:
    """Return what is left of slacks in the equations of a step: curvature (b,), multipliers (b,).

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
    bounds: Bounds, slacks: Array, duals: Duals, moved: Array, barrier: float, close: float
) -> SlackStep:
    """Return the step of slacks that move by (b,), and of their multipliers.

    On the way no slack and no multiplier of a bound uses up more than the share `close` of its
    distance from the bound, or from zero.
    """
    size = len(slacks)
    values, lower, upper = np.empty(size), np.zeros(size), np.zeros(size)
    share, dual_share, slope = 1.0, 1.0, 0.0
    for b in range(size):
        if bounds.lower[b] > -np.inf:
            gap = slacks[b] - bounds.lower[b]
            push = barrier / gap
            lower[b] = push - duals.lower[b] - duals.lower[b] / gap * moved[b]
            slope -= push * moved[b]
            if moved[b] < 0:
                share = min(share, -close * gap / moved[b])
            if lower[b] < 0:
                dual_share = min(dual_share, -close * duals.lower[b] / lower[b])
        if bounds.upper[b] < np.inf:
            gap = bounds.upper[b] - slacks[b]
            push = barrier / gap
            upper[b] = push - duals.upper[b] + duals.upper[b] / gap * moved[b]
            slope += push * moved[b]
            if moved[b] > 0:
                share = min(share, close * gap / moved[b])
            if upper[b] < 0:
                dual_share = min(dual_share, -close * duals.upper[b] / upper[b])
        values[b] = duals.upper[b] + upper[b] - duals.lower[b] - lower[b] - duals.values[b]
    return SlackStep(moved, Duals(values, lower, upper), share, dual_share, slope)


@compiled
def trial(
    bounds: Bounds, values: Array, slacks: Array, change: Array, close: float, following: bool
) -> Trial:
    """Return slacks that have changed by (b,) while their values became others.

    A slack that follows is the value itself, where this uses up no more than the share `close` of
    the slack's distance from its bounds.
    """
    found, logarithms, apart = np.empty(len(slacks)), 0.0, 0.0
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
        apart += abs(values[b] - slack)
        found[b] = slack
    return Trial(found, logarithms, apart)


@compiled
def stepped(
    bounds: Bounds, slacks: Array, duals: Duals, step: SlackStep, share: float, barrier: float
) -> Duals:
    """Return the multipliers at slacks that a share of a step has led to."""
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
def error(bounds: Bounds, slope: Array, values: Array, slacks: Array, duals: Duals) -> float:
    """Return how far the conditions of optimality are broken at most, scaled as Ipopt does.

    `slope` (z,) is the gradient of the objective with the values times their multipliers. Where
    anything is no number they are broken without end.
    """
    largest, apart, size, total = 0.0, 0.0, 0.0, 0.0
    for z in range(len(slope)):
        total += abs(slope[z])
        largest = max(largest, abs(slope[z]))
    for b in range(len(slacks)):
        size += abs(duals.values[b]) + duals.lower[b] + duals.upper[b]
        total += abs(values[b] - slacks[b])
        apart = max(apart, abs(values[b] - slacks[b]))
        largest = max(largest, abs(duals.upper[b] - duals.lower[b] - duals.values[b]))
        if bounds.lower[b] > -np.inf:
            largest = max(largest, (slacks[b] - bounds.lower[b]) * duals.lower[b])
        if bounds.upper[b] < np.inf:
            largest = max(largest, (bounds.upper[b] - slacks[b]) * duals.upper[b])
    scale = max(100.0, size / max(1, 2 * len(slacks))) / 100
    # Compiled, the larger of a number and of none is the number; a sum is none.
    return max(largest / scale, apart) if np.isfinite(size + total) else np.inf
