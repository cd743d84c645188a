"""Fisher information of the parameters, equations (8) to (11), and what it predicts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array, ComplexArray
from expdesign.configuration import ComputationError
from expdesign.information.identifiable import DEPENDENT, BaseParameters, listed, root_of
from expdesign.noise.spectrum import NoiseSpectrum, lines_of, multiplicity, series_of

EXCITABLE = DEPENDENT**2
"""Smallest eigenvalue of the column-scaled F, relative to its largest, that counts as excited."""


@dataclass(frozen=True)
class WeakDirection:
    """A combination of parameters that F does not determine."""

    name: str
    """The parameter with the largest share of it: without it the combination is gone."""
    others: tuple[str, ...] = ()
    """The parameters that it cannot be told from; empty when nothing excites it at all."""
    shows: tuple[str, ...] = ()
    """The combinations with these that are told, in words: ``"p5 + 0.98 p4"``."""

    def __str__(self) -> str:
        """Return it in words: ``"p4 (it cannot be told from p5)"``."""
        if not self.others:
            return self.name
        return f"{self.name} (it cannot be told from {listed(self.others)})"


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

        Each is told by the parameter that is left out of the base parameters; the rest can be
        estimated together.
        """
        return weak_directions(self.base(names))

    def base(self, names: tuple[str, ...]) -> BaseParameters:
        """Return the base parameters, and what regroups into them, in the units of F."""
        return BaseParameters.of(root_of(self.matrix) * self.scales, names)

    def unexcited(self, names: tuple[str, ...]) -> tuple[str, ...]:
        """Name the parameters without which the rest can be estimated together."""
        return tuple(direction.name for direction in self.weak_directions(names))


def weak_directions(base: BaseParameters) -> tuple[WeakDirection, ...]:
    """Return what is not determined where these are the base parameters, in the names' order."""
    found = []
    for name in base.regrouped:
        partners = base.partners(name)
        found.append(WeakDirection(name, partners, tuple(base.text(one) for one in partners)))
    return tuple(found)


class SingularInformationError(ComputationError):
    """F is numerically singular: some combinations of parameters are not excited.

    Parameters
    ----------
    directions : tuple of WeakDirection
    structural : bool
        No motion within the limits of the machine excites them, not only the one that was tried.
    """

    def __init__(self, directions: tuple[WeakDirection, ...], *, structural: bool = False) -> None:
        self.directions, self.structural = directions, structural
        super().__init__(
            f"the trajectory does not excite {self.combinations}",
            {
                "unexcited": list(self.unexcited),
                "not_told_from": {one.name: list(one.others) for one in directions},
                "shows": list(self.shows),
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

    @property
    def shows(self) -> tuple[str, ...]:
        """The combinations that are told in place of the parameters in them, in words."""
        return tuple(dict.fromkeys(text for one in self.directions for text in one.shows))

    def __reduce__(self) -> tuple[object, ...]:
        """Survive the way from a worker process to its parent."""
        return partial(type(self), structural=self.structural), (self.directions,)


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


@dataclass(frozen=True, eq=False)
class PeriodicNoise:
    """The noise of an experiment, whose samples a motion of any frequency meets."""

    spectrum: NoiseSpectrum
    """Of the forces, N²."""
    sampling: float
    """Hz."""
    periods: float
    """Of the whole record, which decides how narrow a hum is."""

    def information(self, regressors: Array, omega: float) -> Array:
        """Return F of one period, (m, m), of A at n equal phases, (n, 6, m); ω in rad/s."""
        lines = lines_of(regressors)
        matrices, _ = self._at(omega, len(lines))
        white = np.linalg.solve(np.linalg.cholesky(matrices), lines)
        white *= np.sqrt(multiplicity(len(regressors)))[:, None, None]
        flat = white.reshape(-1, white.shape[2])
        stacked = np.concatenate([flat.real, flat.imag])
        return stacked.T @ stacked

    def weighted(self, regressors: Array, omega: float) -> Array:
        """Return what makes F of A: (n, 6, m) with Σ_t A_tᵀ (·)_t = F, and dF as twice as much."""
        lines = lines_of(regressors)
        matrices, _ = self._at(omega, len(lines))
        weighted: ComplexArray = np.linalg.solve(matrices, lines).astype(np.complex128, copy=False)
        return series_of(weighted, len(regressors))

    def spread(self, regressors: Array, omega: float) -> Array:
        """Return the covariance of Σ_t A_tᵀ η_t over one period, (m, m): unweighted sums of noise.

        It is what makes the covariance of least squares.
        """
        lines = lines_of(regressors)
        matrices, _ = self._at(omega, len(lines))
        mixed = np.matmul(matrices, lines) * multiplicity(len(regressors))[:, None, None]
        flat = lines.reshape(-1, lines.shape[2])
        found = (flat.conj().T @ mixed.reshape(flat.shape)).real
        return (found + found.T) / 2

    def slope(self, weighted: Array, omega: float) -> Array:
        """Return ∂F/∂ω, (m, m), of A as it is: the lines move over the spectrum.

        `weighted` is what the method of this name returns.
        """
        lines = lines_of(weighted)
        _, by_omega = self._at(omega, len(lines))
        mixed = np.matmul(by_omega, lines) * multiplicity(len(weighted))[:, None, None]
        flat = lines.reshape(-1, lines.shape[2])
        change = -(flat.conj().T @ mixed.reshape(flat.shape)).real
        return (change + change.T) / 2

    def _at(self, omega: float, count: int) -> tuple[ComplexArray, ComplexArray]:
        """Return S at the multiples 0 … count − 1 of ω, (count, 6, 6), and its derivative to ω."""
        base = omega / (2 * np.pi)
        samples = self.periods * self.sampling / base
        found = self.spectrum.harmonics(base, count, self.sampling, samples)
        slope = found.by_frequency - found.by_samples * (samples / base)
        return found.value, slope / (2 * np.pi)
