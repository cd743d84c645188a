"""Noise whose every sample remembers the ones before: autoregressive, each channel its own way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array
from expdesign.noise.spectrum import Hermitian, SpectralValues

_SMALLEST = 1e-12
"""Smallest eigenvalue of the innovations' correlation that counts as positive."""


@dataclass(frozen=True, eq=False)
class Autoregressive:
    """x_i(n) = Σ_k a_ik x_i(n − k) + e_i(n), the innovations e white with a full covariance.

    The coefficients hold for the samples of the experiment, whatever their rate.
    """

    coefficients: Array
    """(6, p), a; p = 0 is white noise."""
    innovation: Array
    """(6, 6), covariance of e."""

    @classmethod
    def with_covariance(cls, coefficients: Array, covariance: Array) -> Autoregressive:
        """Choose the innovations so that one sample has this covariance, (6, 6).

        Raises
        ------
        ValueError
            The noise grows without bound; or channels that remember so differently cannot be
            correlated so much.
        """
        if not is_stable(coefficients):
            raise ValueError("the noise grows without bound")
        innovation = covariance / _gains(coefficients)
        scale = np.sqrt(np.diag(innovation))
        correlation = innovation / np.multiply.outer(scale, scale)
        if np.linalg.eigvalsh(correlation)[0] <= _SMALLEST:
            raise ValueError("channels that remember so differently are not correlated so much")
        return cls(coefficients, innovation)

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample."""
        return self.innovation * _gains(self.coefficients)

    @property
    def highest(self) -> float:
        """Every sampling will do."""
        return np.inf

    def values(self, frequencies: Array, sampling: float, samples: float) -> SpectralValues:
        """Return S = H C Hᴴ with the channels' transfer functions H, and its derivatives."""
        del samples
        delays = np.arange(1, self.coefficients.shape[1] + 1)
        turns = np.exp(-2j * np.pi * np.multiply.outer(frequencies / sampling, delays))
        transfer = 1 / (1 - turns @ self.coefficients.T)
        slope = (turns * (-2j * np.pi * delays / sampling)) @ self.coefficients.T * transfer**2
        back = transfer.conj()[:, None, :]
        value: Hermitian = np.asarray(transfer[:, :, None] * self.innovation * back, complex)
        half: Hermitian = np.asarray(slope[:, :, None] * self.innovation * back, complex)
        return SpectralValues(value, half + half.conj().transpose(0, 2, 1), np.zeros_like(value))


def is_stable(coefficients: Array) -> bool:
    """Tell whether every channel forgets: coefficients (6, p)."""
    return all(
        bool(np.all(np.abs(np.linalg.eigvals(_companion(row))) < 1))
        for row in coefficients
        if row.size
    )


def _companion(row: Array) -> Array:
    matrix = np.eye(row.size, k=-1)
    matrix[0] = row
    return matrix


def _gains(coefficients: Array) -> Array:
    """Return Σ_n h_i(n) h_j(n) of the channels' impulse responses, (6, 6).

    It is the first entry of X = A_i X A_jᵀ + e₁ e₁ᵀ with the companion matrices A.
    """
    count, order = coefficients.shape
    if order == 0:
        return np.ones((count, count))
    companions = [_companion(row) for row in coefficients]
    first = np.zeros(order**2)
    first[0] = 1.0
    gains = np.empty((count, count))
    for i in range(count):
        for j in range(i + 1):
            system = np.eye(order**2) - np.kron(companions[i], companions[j])
            gains[i, j] = gains[j, i] = np.linalg.solve(system, first)[0]
    return gains
