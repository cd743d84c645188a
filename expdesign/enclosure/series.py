"""Taylor models of a finite Fourier series over cells of time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.enclosure.taylor_model import EPS, TERMS, TaylorModel
from expdesign.trajectory import FourierTrajectory

DERIVATIVES = 4
"""Pose, rate, acceleration and jerk."""


@dataclass(frozen=True)
class EnclosedSeries:
    """One period of a Fourier series over cells of time."""

    trajectory: FourierTrajectory

    @property
    def breaks(self) -> Array:
        """(2,) beginning and end of the period, s; the end is rounded up."""
        return np.array([0.0, self.trajectory.period * (1 + 4 * EPS)])

    def models(self, edges: Array) -> list[TaylorModel]:
        """Return the models of pose, rate, acceleration and jerk, 24, over cells (N, 2), s."""
        return fourier_models(self.trajectory, edges)


def fourier_models(trajectory: FourierTrajectory, edges: Array) -> list[TaylorModel]:
    """Return the models of pose, rate, acceleration and jerk, 24, over cells of time.

    The derivatives of a series are known in closed form, and no derivative of a harmonic is larger
    than its amplitude times the power of its frequency.

    Parameters
    ----------
    edges : (N, 2)
        When each cell begins and ends, s; every instant between the two is in the cell.
    """
    middle = edges.mean(axis=1)
    half = np.max(np.abs(edges - middle[:, None]), axis=1) * (1 + 4 * EPS)
    orders = trajectory.omega * np.arange(1, trajectory.harmonics + 1)
    phases = np.multiply.outer(middle, orders)
    basis = np.sin(phases), np.cos(phases)
    amplitude = np.abs(trajectory.sine) + np.abs(trajectory.cosine)
    # (n, N), how wrong a sine may be whose phase was rounded, in a sum of 2 n of them
    rounding = (16 + 2 * trajectory.harmonics + 4 * np.abs(phases.T)) * EPS
    signs = ((1, 0), (1, 1), (-1, 0), (-1, 1))
    found = []
    for derivative in range(DERIVATIVES):
        coefficients = np.zeros((TERMS, 6, len(middle)))
        radius = np.zeros((6, len(middle)))
        for k in range(TERMS):
            step = half**k / math.factorial(k)
            grown = orders ** (derivative + k)
            (sign_a, which_a), (sign_b, which_b) = (
                signs[(derivative + k + shift) % 4] for shift in (0, 1)
            )
            values = basis[which_a] @ (sign_a * grown * trajectory.sine).T
            values += basis[which_b] @ (sign_b * grown * trajectory.cosine).T
            coefficients[k] = (values * step[:, None]).T
            radius += (amplitude * grown) @ rounding * step
        if derivative == 0:
            coefficients[0] += trajectory.lambda0[:, None]
            radius += 2 * EPS * np.abs(trajectory.lambda0[:, None])
        beyond = amplitude @ (orders ** (derivative + TERMS))
        radius += beyond[:, None] * half**TERMS / math.factorial(TERMS)
        radius *= 1 + 2.0**-40
        found += [
            TaylorModel(np.ascontiguousarray(coefficients[:, i]), radius[i]) for i in range(6)
        ]
    return found
