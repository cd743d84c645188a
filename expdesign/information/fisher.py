"""Fisher information of the parameters, equations (8) to (11), and what it predicts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array
from expdesign.configuration import ComputationError

EXCITABLE = 1e-12
"""Smallest eigenvalue of the column-scaled F, relative to its largest, that counts as excited."""

SHARE = 0.1
"""From this share (squared component) on, a parameter takes part in a direction."""


@dataclass(frozen=True)
class WeakDirection:
    """A combination of parameters that F does not determine."""

    name: str
    """The parameter with the largest share of it: without it the combination is gone."""
    others: tuple[str, ...] = ()
    """The parameters that it cannot be told from; empty when nothing excites it at all."""

    def __str__(self) -> str:
        """Return it in words: ``"p4 (it cannot be told from p5)"``."""
        if not self.others:
            return self.name
        *first, last = self.others
        others = f"{', '.join(first)} and {last}" if first else last
        return f"{self.name} (it cannot be told from {others})"


def whitening(covariance: Array) -> Array:
    """Return the lower triangular S⁻¹ with Σ = S Sᵀ, (6, 6), N²: S⁻¹ q has unit covariance."""
    factor = np.linalg.cholesky(covariance)
    return sla.solve_triangular(factor, np.eye(len(factor)), lower=True)


def information_matrix(regressors: Array, covariance: Array) -> Array:
    """Return F = Σ_t A_tᵀ Σ⁻¹ A_t, (m, m), of A at every sample, (N, 6, m), and Σ of the forces."""
    white = np.matmul(whitening(covariance), regressors)
    stacked = white.reshape(-1, white.shape[2])
    return stacked.T @ stacked


@dataclass(frozen=True)
class ScaledInformation:
    """F brought to unit diagonal, with the scales taken out: D F̃ D = F, D diagonal."""

    matrix: Array
    """(m, m), F̃, unit diagonal (0 in rows that nothing excites)."""
    scales: Array
    """(m,), D: square roots of F's diagonal."""

    @classmethod
    def of(cls, information: Array) -> ScaledInformation:
        """Scale the columns of F, (m, m), to unit length."""
        scales = np.sqrt(np.maximum(np.diag(information), 0.0))
        divisor = np.where(scales > 0, scales, 1.0)
        return cls(information / np.multiply.outer(divisor, divisor), scales)

    def eigenvalues(self) -> Array:
        """(m,) eigenvalues of F̃, ascending."""
        return np.asarray(np.linalg.eigvalsh(self.matrix), dtype=np.float64)

    def is_singular(self) -> bool:
        """Tell whether F̃ is singular to working precision (see `EXCITABLE`)."""
        values = self.eigenvalues()
        return bool(values[0] <= EXCITABLE * values[-1]) or bool(np.any(self.scales <= 0))

    def weak_directions(self, names: tuple[str, ...]) -> tuple[WeakDirection, ...]:
        """Return the combinations of parameters that F does not determine, in the names' order.

        Parameters are dropped one by one, always the one with the largest share of the weakest
        direction, until what is left is regular; the rest can be estimated together.
        """
        keep = [k for k in range(len(names)) if self.scales[k] > 0]
        found = {k: WeakDirection(names[k]) for k in range(len(names)) if self.scales[k] <= 0}
        while keep:
            values, vectors = np.linalg.eigh(self.matrix[np.ix_(keep, keep)])
            if values[0] > EXCITABLE * values[-1]:
                break
            shares = vectors[:, 0] ** 2
            largest = int(np.argmax(shares))
            others = tuple(names[keep[k]] for k in np.flatnonzero(shares > SHARE) if k != largest)
            found[keep[largest]] = WeakDirection(names[keep[largest]], others)
            keep.pop(largest)
        return tuple(found[k] for k in sorted(found))

    def unexcited(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Name the parameters without which the rest can be estimated together."""
        return tuple(direction.name for direction in self.weak_directions(names))


class SingularInformationError(ComputationError):
    """F is numerically singular: some combinations of parameters are not excited."""

    def __init__(self, directions: tuple[WeakDirection, ...]) -> None:
        self.directions = directions
        super().__init__(
            f"the trajectory does not excite {self.combinations}",
            {
                "unexcited": list(self.unexcited),
                "not_told_from": {one.name: list(one.others) for one in directions},
            },
        )

    @property
    def unexcited(self) -> tuple[str, ...]:
        """Names of the parameters without which the rest can be estimated together."""
        return tuple(direction.name for direction in self.directions)

    @property
    def combinations(self) -> str:
        """All directions in words, each with the parameters that take part."""
        return "; ".join(str(direction) for direction in self.directions)

    def __reduce__(self) -> tuple[type[SingularInformationError], tuple[object, ...]]:
        """Survive the way from a worker process to its parent."""
        return type(self), (self.directions,)


def log_det(information: Array, names: tuple[str, ...]) -> float:
    """Return log det F; the scaling to unit diagonal keeps all digits.

    Raises
    ------
    SingularInformationError
        F is singular to working precision; a logarithm of rounding errors is not reported.
    """
    scaled = _regular(information, names)
    factor = np.linalg.cholesky(scaled.matrix)
    return float(2 * (np.sum(np.log(np.diag(factor))) + np.sum(np.log(scaled.scales))))


def parameter_covariance(information: Array, names: tuple[str, ...]) -> Array:
    """Return F⁻¹, (m, m): the Gauss–Markov estimator's covariance.

    Raises
    ------
    SingularInformationError
        F is singular to working precision.
    """
    scaled = _regular(information, names)
    inverse = sla.cho_solve(sla.cho_factor(scaled.matrix), np.eye(len(scaled.scales)))
    return inverse / np.multiply.outer(scaled.scales, scaled.scales)


def _regular(information: Array, names: tuple[str, ...]) -> ScaledInformation:
    scaled = ScaledInformation.of(information)
    if scaled.is_singular():
        raise SingularInformationError(scaled.weak_directions(names))
    return scaled
