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

    def products(self, residuals: Array, weights: Array) -> Array:
        """Return (r, U)ᵀ W (r, U), (1 + k + x, 1 + k + x), with residuals r, (S, 6).

        `weights` are D with W = DᵀD, (6, 6) or (S, 6, 6).
        """
        sampled, own = self.sampled, 1 + self.others.shape[2]
        frequency = [sampled.frequency_column(self.slope)] if sampled.motion.free_frequency else []
        beside = [residuals[:, :, None], self.others, *frequency]
        white = np.matmul(weights, np.concatenate([*beside, self.slope], axis=2))
        depth, width = self.slope.shape[2], white.shape[2] - self.slope.shape[2]
        rows = white[:, :, :width].reshape(-1, width)
        each = np.matmul(white[:, :, width:].transpose(0, 2, 1), white)
        crossed = _sums(each[:, :, :width], sampled.waves)
        orders = depth // COORDINATES
        carried = np.einsum(
            "dk,dcqk->cqk",
            sampled.rates(orders),
            crossed.reshape(orders, COORDINATES, width, -1),
        )
        motion = _table_products(each[:, :, width:], sampled)
        cross = of_table(carried).transpose(0, 2, 1).reshape(len(motion), width)
        outer = rows.T @ rows
        return np.block(
            [
                [outer[:own, :own], cross[:, :own].T, outer[:own, own:]],
                [cross[:, :own], motion, cross[:, own:]],
                [outer[own:, :own], cross[:, own:].T, outer[own:, own:]],
            ]
        )


def _table_products(each: Array, sampled: SampledMotion) -> Array:
    """Return the products of the columns of the table, from those of the slopes, (S, 6 n, 6 n)."""
    h, waves = sampled.motion.harmonics, sampled.waves
    orders = each.shape[1] // COORDINATES
    further = np.concatenate([waves, waves[:, 1:] * waves[:, -1:]], axis=1)
    by_order = each.reshape(-1, orders, COORDINATES, orders, COORDINATES)
    rates, harmonics = sampled.rates(orders), np.arange(h + 1)
    difference = 2 * h + harmonics - harmonics[:, None]
    total = 2 * h + harmonics + harmonics[:, None]
    size = (COORDINATES, COORDINATES, h + 1, h + 1)
    along, against = np.zeros(size, np.complex128), np.zeros(size, np.complex128)
    for first in range(orders):
        for second in range(first, orders):
            sums = _sums(by_order[:, first, :, second], further)
            sums = np.concatenate([sums[:, :, :0:-1].conj(), sums], axis=2)
            left, right = rates[first][:, None], rates[second]
            one, other = (
                left.conj() * right * sums[:, :, difference],
                left * right * sums[:, :, total],
            )
            along += one
            against += other
            if first != second:
                along += one.conj().transpose(1, 0, 3, 2)
                against += other.transpose(1, 0, 3, 2)
    plus, minus = (along + against) / 2, (along - against) / 2
    result = np.empty((COORDINATES, 2 * h + 1, COORDINATES, 2 * h + 1))
    cos, sin = np.r_[0, h + 1 : 2 * h + 1], slice(1, h + 1)
    whole = result.transpose(0, 2, 1, 3)
    whole[:, :, cos[:, None], cos] = plus.real
    whole[:, :, sin, sin] = minus[:, :, 1:, 1:].real
    whole[:, :, sin, cos] = -minus[:, :, 1:].imag
    whole[:, :, cos, sin] = plus[:, :, :, 1:].imag
    return result.reshape(2 * (COORDINATES * (2 * h + 1),))


def _sums(values: Array, waves: ComplexArray) -> ComplexArray:
    """Return Σ_s v(s) e^{imφ(s)}, (a, b, M), of values (S, a, b) and waves (S, M)."""
    flat = values.reshape(len(values), -1)
    return (flat.T @ waves.view(np.float64)).view(np.complex128).reshape(*values.shape[1:], -1)
