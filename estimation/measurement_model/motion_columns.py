"""Columns of unknowns, the motion ξ among them, and their products without writing them down.

A column of ξ is a slope to the pose and its derivatives times a harmonic of the phase φ. Products
of two of them hold products of harmonics, which are harmonics again,

    e^{−ikφ} e^{ik'φ} = e^{i(k' − k)φ},    e^{ikφ} e^{ik'φ} = e^{i(k + k')φ},

so that all of them follow from Σ_s C(s) e^{imφ(s)}, m = 0 … 2 H, with the products C of the slopes
alone, whatever the times of the samples are. With many harmonics that is a small part of the work.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array, ComplexArray
from estimation.measurement_model.motion import SampledMotion, of_table
from expdesign.mechanism.hexapod import COORDINATES


@dataclass(frozen=True, eq=False)
class MotionColumns:
    """Columns U of k + x unknowns at S samples of six channels, those of ξ last."""

    others: Array
    """(S, 6, k), of what is not the motion."""
    slope: Array
    """(S, 6, 6 n), to the pose and its n − 1 first derivatives."""
    sampled: SampledMotion
    """The motion at the samples."""

    def dense(self) -> Array:
        """Return U, (S, 6, k + x)."""
        return np.concatenate([self.others, self.sampled.chain(self.slope)], axis=2)

    def times(self, steps: Array) -> Array:
        """Return U s, (S, 6, t), of steps of the unknowns, (k + x, t)."""
        own = self.others.shape[2]
        return self.others @ steps[:own] + self.sampled.moved(self.slope, steps[own:])

    def products(self, residuals: Array, weights: Array) -> Array:
        """Return (r, U)ᵀ W (r, U), (1 + k + x, 1 + k + x), with residuals r, (S, 6).

        `weights` are D with W = DᵀD, (6, 6) or (S, 6, 6).
        """
        sampled, width = self.sampled, 1 + self.others.shape[2]
        beside = [residuals[:, :, None], self.others]
        if sampled.motion.free_frequency:
            beside.append(sampled.frequency_column(self.slope))
        white = np.matmul(weights, np.concatenate([*beside, self.slope], axis=2))
        dense, slope = np.split(white, [white.shape[2] - self.slope.shape[2]], axis=2)
        turned = slope.transpose(0, 2, 1)
        rows = dense.reshape(-1, dense.shape[2])
        inner, outer = _table_products(np.matmul(turned, slope), sampled), rows.T @ rows
        crossed = _sums(np.matmul(turned, dense), sampled.waves)
        orders = len(crossed) // COORDINATES
        by_order = crossed.reshape(orders, COORDINATES, *crossed.shape[1:])
        carried = np.sum(by_order * sampled.rates(orders)[:, None, None], axis=0)
        cross = of_table(carried).transpose(1, 0, 2).reshape(len(outer), len(inner))
        # Residuals and other unknowns, the table, ω.
        size = len(outer) + len(inner)
        table = slice(width, width + len(inner))
        others = np.r_[0:width, table.stop : size]
        result = np.empty((size, size))
        result[table, table] = inner
        result[others[:, None], others] = outer
        result[others, table] = cross
        result[table, others] = cross.T
        return result


def _table_products(each: Array, sampled: SampledMotion) -> Array:
    """Return the products of the columns of the table, from those of the slopes, (S, 6 n, 6 n)."""
    h, waves = sampled.motion.harmonics, sampled.waves
    orders = each.shape[1] // COORDINATES
    sums = _sums(each, np.concatenate([waves, waves[:, 1:] * waves[:, -1:]], axis=1))
    sums = np.concatenate([sums[:, :, :0:-1].conj(), sums], axis=2)
    sums = sums.reshape(orders, COORDINATES, orders, COORDINATES, -1)
    harmonics = np.arange(h + 1)
    difference = 2 * h + harmonics - harmonics[:, None]
    total = 2 * h + harmonics + harmonics[:, None]
    rates = sampled.rates(orders)
    size = (COORDINATES, COORDINATES, h + 1, h + 1)
    along, against = np.zeros(size, np.complex128), np.zeros(size, np.complex128)
    for left, of_order in zip(rates, sums, strict=True):
        weights = left[:, None] * rates[:, None]
        opposite = left.conj()[:, None] * rates[:, None]
        along += np.einsum("abckl,bkl->ackl", of_order[..., difference], opposite)
        against += np.einsum("abckl,bkl->ackl", of_order[..., total], weights)
    plus, minus = (along + against) / 2, (along - against) / 2
    result = np.empty((COORDINATES, 2 * h + 1, COORDINATES, 2 * h + 1))
    cos, sin = np.r_[0, h + 1 : 2 * h + 1], slice(1, h + 1)
    tables = result.transpose(0, 2, 1, 3)
    tables[:, :, cos[:, None], cos] = plus.real
    tables[:, :, sin, sin] = minus[:, :, 1:, 1:].real
    tables[:, :, sin, cos] = -minus[:, :, 1:].imag
    tables[:, :, cos, sin] = plus[:, :, :, 1:].imag
    return result.reshape(2 * (COORDINATES * (2 * h + 1),))


def _sums(values: Array, waves: ComplexArray) -> ComplexArray:
    """Return Σ_s v(s) e^{imφ(s)}, (a, b, M), of values (S, a, b) and waves (S, M)."""
    flat = values.reshape(len(values), -1)
    return (flat.T @ waves.view(np.float64)).view(np.complex128).reshape(*values.shape[1:], -1)
