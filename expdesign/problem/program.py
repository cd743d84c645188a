"""Derivatives of the states along a path, and of a program's rows, to the path's variables.

All coordinates have variables of their own with the same basis; the last variable (ω of a series,
the duration of a ramp) moves all coordinates. Products that use this structure cost a fraction of
products with the dense Jacobian (r, z).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from constraints.arrays import Array, Mask
from expdesign.evaluation.compiled import compiled
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.robot import LimitModel


@dataclass(frozen=True)
class PathSlope:
    """Derivatives of the states at K points to the variables (z,), z = 6 v + 1.

    The states (K, 6 D) are the six coordinates, then their first derivatives in time, and so on:
    D orders, from 0.
    """

    basis: Array
    """(K, D, v), derivatives of a coordinate over its scale to its own variables; contiguous."""
    scale: Array
    """(6,), m, rad."""
    drift: Array
    """(K, D, 6), derivatives of the states to the last variable."""

    @property
    def size(self) -> int:
        """Number z of variables."""
        return COORDINATES * self.basis.shape[2] + 1

    def part(self, points: slice | NDArray[np.intp]) -> PathSlope:
        """Return the derivatives at some of the points."""
        return replace(self, basis=self.basis[points], drift=self.drift[points])

    def state_change(self, step: Array) -> Array:
        """Return the change of the states, (K, 6 D), along a step (z,) of the variables."""
        table = step[:-1].reshape(COORDINATES, -1) * self.scale[:, None]
        change = (self._flat @ table.T).reshape(self.drift.shape) + self.drift * step[-1]
        return change.reshape(len(change), change.shape[1] * COORDINATES)

    def transposed_product(self, sensitivities: Array) -> Array:
        """Return sensitivities to the variables, (z,), from those to the states, K 6 D of them."""
        own = self._flat.T @ sensitivities.reshape(-1, COORDINATES)
        last = sensitivities.ravel() @ self.drift.ravel()
        return np.append((own * self.scale).T.ravel(), last)

    def transposed_products(self, sensitivities: Array) -> Array:
        """Return sensitivities of q quantities to the variables, (z, q), summed over the points.

        The sensitivities to the states are (K, 6 D, q): in this layout nothing is copied.
        """
        quantities, own = sensitivities.shape[2], self.basis.shape[2]
        split = sensitivities.reshape(self.drift.size // COORDINATES, COORDINATES, quantities)
        drift = self.drift.reshape(-1, COORDINATES)
        found = np.zeros((self.size, quantities))
        blocks = found[:-1].reshape(COORDINATES, own, quantities)
        for coordinate, scale in enumerate(self.scale):
            steps = np.vstack([scale * self._flat.T, drift[:, coordinate]])
            both = steps @ split[:, coordinate]
            blocks[coordinate] = both[:-1]
            found[-1] += both[-1]
        return found

    def curvature(self, curvature: Array) -> Array:
        """Return the curvature to the variables, (z, z), from that to the states, (K, 6 D, 6 D).

        Both are symmetric: one block per pair of coordinates is computed. Derivatives of the same
        point are multiplied first, then all points are summed at once.
        """
        points, derivatives, own = self.basis.shape
        states, pairs = derivatives * COORDINATES, len(_FIRST)
        entries = curvature.reshape(points, states**2).take(_places(derivatives), axis=1)
        half = entries.reshape(points, derivatives * pairs, derivatives) @ self.basis
        sums = self._flat.T @ half.reshape(points * derivatives, pairs * own)
        blocks = sums.reshape(own, pairs, own).transpose(1, 0, 2)
        blocks = blocks * (self.scale[_FIRST] * self.scale[_SECOND])[:, None, None]
        found = np.empty((self.size, self.size))
        table = found[:-1, :-1].reshape(COORDINATES, own, COORDINATES, own)
        table[_FIRST, :, _SECOND] = blocks
        table[_SECOND, :, _FIRST] = blocks.transpose(0, 2, 1)
        drift = self.drift.reshape(points, states, 1)
        found[-1] = found[:, -1] = self.transposed_product(curvature @ drift)
        return found

    @property
    def _flat(self) -> Array:
        """(K D, v), the basis."""
        return self.basis.reshape(self.drift.size // COORDINATES, self.basis.shape[2])


_FIRST, _SECOND = np.triu_indices(COORDINATES)
"""(21,), every pair of coordinates."""


@cache
def _places(derivatives: int) -> NDArray[np.intp]:
    """Return places of a curvature's entries, by derivative, pair of coordinates, derivative."""
    shape = (derivatives, COORDINATES) * 2
    order = np.arange(np.prod(shape)).reshape(shape)[:, _FIRST, :, _SECOND]
    return order.transpose(1, 0, 2).ravel()


@dataclass(frozen=True)
class RowIndex:
    """Places of the r rows of a program among q quantities at K points, point after point."""

    first: NDArray[np.intp]
    """(K + 1,), number of each point's first row; the last is r."""
    columns: NDArray[np.intp]
    """(r,), quantity of each row."""
    scale: Array
    """(r,), scale of each row."""

    @classmethod
    def of(cls, mask: Mask, scale: Array) -> RowIndex:
        """Return the rows that a mask (K, q) marks, of quantities with scales (q,)."""
        first = np.append(0, np.cumsum(np.count_nonzero(mask, axis=1)))
        columns = np.nonzero(mask)[1]
        return cls(first, columns, scale[columns])

    @property
    def places(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """First rows and columns, the arguments of the compiled products."""
        return self.first, self.columns


@dataclass(frozen=True)
class LinearRows:
    """Values of a program's r rows at a point, and products with their Jacobian J."""

    values: Array
    """(r,)."""
    path: PathSlope
    slopes: Array
    """(K, q, 6 D), derivatives of all quantities to the states at every point; outside the rows
    they may be NaN."""
    rows: RowIndex

    def jacobian(self) -> Array:
        """Return J, (r, z)."""
        path = self.path
        natural = row_jacobian(self.slopes, *self.rows.places, path.basis, path.scale, path.drift)
        return natural / self.rows.scale[:, None]

    def jacobian_product(self, step: Array) -> Array:
        """Return J s, (r,), for a step (z,)."""
        change = row_changes(self.slopes, *self.rows.places, self.path.state_change(step))
        return change / self.rows.scale

    def transposed_product(self, weights: Array) -> Array:
        """Return Jᵀ w, (z,), for weights (r,)."""
        scaled = weights / self.rows.scale
        return self.path.transposed_product(weighted_sums(self.slopes, *self.rows.places, scaled))

    def curvature(self, weights: Array) -> Array:
        """Return Jᵀ diag(w) J, (z, z), for weights (r,)."""
        scaled = weights / self.rows.scale**2
        return self.path.curvature(weighted_squares(self.slopes, *self.rows.places, scaled))


# Compiled products with the rows' derivatives to the states. Row r is quantity `columns[r]` at a
# point; the rows of point k are `first[k]` … `first[k + 1]`. Slopes (K, q, s) are derivatives of
# all quantities to the states of their point; entries outside the rows are not read.


@compiled
def row_changes(
    slopes: Array, first: NDArray[np.intp], columns: NDArray[np.intp], steps: Array
) -> Array:
    """Return the changes of the rows, (r,), along steps (K, s) of the states."""
    found = np.empty(len(columns))
    for k in range(len(slopes)):
        step = steps[k]
        for r in range(first[k], first[k + 1]):
            row, total = slopes[k, columns[r]], 0.0
            for i in range(len(step)):
                total += row[i] * step[i]
            found[r] = total
    return found


@compiled
def weighted_sums(
    slopes: Array, first: NDArray[np.intp], columns: NDArray[np.intp], weights: Array
) -> Array:
    """Return the sums over each point's rows of derivatives times weights (r,), (K, s)."""
    found = np.zeros((slopes.shape[0], slopes.shape[2]))
    for k in range(len(slopes)):
        total = found[k]
        for r in range(first[k], first[k + 1]):
            row, weight = slopes[k, columns[r]], weights[r]
            for i in range(len(total)):
                total[i] += weight * row[i]
    return found


@compiled
def weighted_squares(
    slopes: Array, first: NDArray[np.intp], columns: NDArray[np.intp], weights: Array
) -> Array:
    """Return the sums of the derivatives' outer products times weights (r,), (K, s, s)."""
    states = slopes.shape[2]
    found = np.zeros((len(slopes), states, states))
    for k in range(len(slopes)):
        total = found[k]
        for r in range(first[k], first[k + 1]):
            row = slopes[k, columns[r]]
            for i in range(states):
                weighted = weights[r] * row[i]
                if weighted != 0.0:  # half of the derivatives are zero
                    for j in range(i + 1):
                        total[i, j] += weighted * row[j]
        for i in range(states):
            for j in range(i):
                total[j, i] = total[i, j]
    return found


@compiled
def row_jacobian(
    slopes: Array,
    first: NDArray[np.intp],
    columns: NDArray[np.intp],
    basis: Array,
    scale: Array,
    drift: Array,
) -> Array:
    """Return the rows' derivatives to the path's variables, (r, z); arguments as in `PathSlope`."""
    coordinates, (_, derivatives, own) = len(scale), basis.shape
    found = np.zeros((len(columns), coordinates * own + 1))
    for k in range(len(slopes)):
        for r in range(first[k], first[k + 1]):
            row = found[r]
            for d in range(derivatives):
                for i in range(coordinates):
                    slope = slopes[k, columns[r], d * coordinates + i]
                    row[-1] += slope * drift[k, d, i]
                    scaled = slope * scale[i]
                    for v in range(own):
                        row[i * own + v] += scaled * basis[k, d, v]
    return found


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
