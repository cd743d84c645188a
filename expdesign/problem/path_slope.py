"""How the states along a path follow from its variables, and the rows of a program from those.

The variables of a coordinate move it alone, by the same basis as the other coordinates'; the last
variable (ω of a series, the duration of a ramp) moves all. What is taken through this structure
costs a part of what the dense Jacobian (r, z) would.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array, Mask
from expdesign.mechanism.hexapod import COORDINATES


@dataclass(frozen=True)
class PathSlope:
    """Derivatives of the states at K points to the variables (z,), z = 6 v + 1.

    States are a coordinate's D derivatives in time, beginning with itself, (K, 6 D), six side by
    side.
    """

    basis: Array
    """(K, D, v), derivatives of a coordinate over its scale to its own variables."""
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

    def moved(self, step: Array) -> Array:
        """Return what a step (z,) of the variables changes the states by, (K, 6 D)."""
        table = step[:-1].reshape(COORDINATES, -1) * self.scale[:, None]
        change = self.basis @ table.T + self.drift * step[-1]
        return change.reshape(len(change), change.shape[1] * COORDINATES)

    def carried(self, slopes: Array) -> Array:
        """Carry derivatives (K, q, 6 D) to the states over to the variables: (K, q, z)."""
        return np.asarray(slopes @ self._dense)

    def pulled(self, sensitivities: Array) -> Array:
        """Return what sensitivities to the states, K 6 D of them, are to the variables, (z,)."""
        return np.asarray(sensitivities.ravel() @ self._dense.reshape(-1, self.size))

    def accumulated(self, sensitivities: Array) -> Array:
        """Carry sensitivities over, summed over the points.

        (K, 6 D, q), the states before the quantities, become (z, q): that way nothing is copied.
        """
        quantities, own = sensitivities.shape[2], self.basis.shape[2]
        split = sensitivities.reshape(self.drift.size // COORDINATES, COORDINATES, quantities)
        found = np.zeros((self.size, quantities))
        blocks = found[:-1].reshape(COORDINATES, own, quantities)
        for coordinate, steps in enumerate(self._stacked):
            both = steps @ split[:, coordinate]
            blocks[coordinate] = both[:-1]
            found[-1] += both[-1]
        return found

    @cached_property
    def _dense(self) -> Array:
        """(K, 6 D, z), with the zeros: products with blocks of three rows take far longer."""
        points, derivatives, own = self.basis.shape
        dense = np.zeros((points, derivatives, COORDINATES, self.size))
        for coordinate, scale in enumerate(self.scale):
            columns = slice(coordinate * own, (coordinate + 1) * own)
            np.multiply(self.basis, scale, out=dense[:, :, coordinate, columns])
        dense[..., -1] = self.drift
        return dense.reshape(points, derivatives * COORDINATES, self.size)

    @cached_property
    def _stacked(self) -> Array:
        """(6, v + 1, K D), derivatives to a coordinate's own variables, then to the last one."""
        own = self.basis.reshape(-1, self.basis.shape[2])
        stacked = np.empty((COORDINATES, own.shape[1] + 1, len(own)))
        np.multiply(own.T, self.scale[:, None, None], out=stacked[:, :-1])
        stacked[:, -1] = self.drift.reshape(-1, COORDINATES).T
        return stacked


@dataclass(frozen=True)
class LinearRows:
    """The r rows of a program about a point: their values, and products with their Jacobian J."""

    values: Array
    """(r,)."""
    path: PathSlope
    slopes: Array
    """(K, c, 6 D), derivatives of c quantities to the states at every point; zero where there is no
    row."""
    mask: Mask
    """(K, c), which of them are rows."""

    def jacobian(self) -> Array:
        """Return J, (r, z)."""
        return self.path.carried(self.slopes)[self.mask]

    def moved(self, step: Array) -> Array:
        """Return J s, (r,), of a step (z,)."""
        states = self.path.moved(step)
        return np.asarray((self.slopes @ states[:, :, None])[..., 0][self.mask])

    def pulled(self, weights: Array) -> Array:
        """Return Jᵀ w, (z,), of weights (r,)."""
        return self.path.pulled(self._spread(weights)[:, None] @ self.slopes)

    def curvature(self, weights: Array) -> Array:
        """Return Jᵀ diag(w) J, (z, z), of weights (r,)."""
        weighted = self.slopes * self._spread(weights)[:, :, None]
        by_state = weighted.transpose(0, 2, 1) @ self.slopes
        return self.path.accumulated(self.path.carried(by_state))

    def _spread(self, weights: Array) -> Array:
        """Return weights as (K, c); zero where there is no row."""
        spread = np.zeros(self.mask.shape)
        spread[self.mask] = weights
        return spread
