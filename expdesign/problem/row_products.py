"""Products with the derivatives of rows to the states, compiled: rows stand where limits hold.

Row r is quantity `columns[r]` at a point; those of point k are `first[k]` … `first[k + 1]`. Slopes
(K, q, s) are derivatives of all quantities at all points to the states there, one after the other.
What is no row is not looked at.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.compiled import compiled


@compiled
def along(slopes: Array, first: NDArray[np.intp], columns: NDArray[np.intp], steps: Array) -> Array:
    """Return what steps (K, s) of the states change the rows by, (r,)."""
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
def summed(
    slopes: Array, first: NDArray[np.intp], columns: NDArray[np.intp], weights: Array
) -> Array:
    """Return the sums (K, s) of the rows' derivatives times weights (r,)."""
    found = np.zeros((slopes.shape[0], slopes.shape[2]))
    for k in range(len(slopes)):
        total = found[k]
        for r in range(first[k], first[k + 1]):
            row, weight = slopes[k, columns[r]], weights[r]
            for i in range(len(total)):
                total[i] += weight * row[i]
    return found


@compiled
def squares(
    slopes: Array, first: NDArray[np.intp], columns: NDArray[np.intp], weights: Array
) -> Array:
    """Return the sums (K, s, s) of the rows' derivatives times themselves and weights (r,)."""
    states = slopes.shape[2]
    found = np.zeros((len(slopes), states, states))
    for k in range(len(slopes)):
        total = found[k]
        for r in range(first[k], first[k + 1]):
            row = slopes[k, columns[r]]
            for i in range(states):
                weighted = weights[r] * row[i]
                if weighted != 0.0:  # half of the derivatives are none
                    for j in range(i + 1):
                        total[i, j] += weighted * row[j]
        for i in range(states):
            for j in range(i):
                total[j, i] = total[i, j]
    return found


@compiled
def jacobian(
    slopes: Array,
    first: NDArray[np.intp],
    columns: NDArray[np.intp],
    basis: Array,
    scale: Array,
    drift: Array,
) -> Array:
    """Return the rows' derivatives to a path's variables, (r, z): see `PathSlope`."""
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
