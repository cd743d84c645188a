"""Fisher information of the parameters, equations (8) to (11), and the predicted covariance.

A periodic motion meets coloured noise at the multiples of its frequency only. With
Ã_j = rfft(A)/√n over n samples of one period, w_j = 2 (1 at j = 0 and n/2) and the spectrum S_j of
the noise at j ω/2π, per sample of the experiment,

    F = Σ_j w_j Re(Ã_jᴴ S_j⁻¹ Ã_j)

is the information of one period (Pintelon and Schoukens, *System Identification*, 2012, chapter 9);
for S_j = Σ it is Σ_t A_tᵀ Σ⁻¹ A_t. The Fourier coefficients of A do not depend on n: F grows with n
as for white noise, and n may differ from the experiment's N samples per period. n F / N is the same
for every n that resolves A.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array, ComplexArray
from expdesign.configuration import ComputationError
from expdesign.information.identifiable import DEPENDENT, BaseParameters, listed, root_of
from expdesign.noise import NoiseSpectrum, lines_of, multiplicity, series_of

EXCITABLE = DEPENDENT**2
"""Smallest eigenvalue of an excited direction in the column-scaled F, relative to the largest."""


@dataclass(frozen=True)
class WeakDirection:
    """A combination of parameters that F does not determine."""

    name: str
    """The parameter with the largest share: without it the others are determined."""
    others: tuple[str, ...] = ()
    """The parameters confounded with it; empty if nothing excites it at all."""
    shows: tuple[str, ...] = ()
    """The determined combinations with these, in words: ``"p5 + 0.98 p4"``."""

    def __str__(self) -> str:
        """Return it in words: ``"p4 (confounded with p5)"``."""
        if not self.others:
            return self.name
        return f"{self.name} (confounded with {listed(self.others)})"


def whitening(covariance: Array) -> Array:
    """Return the lower triangular S⁻¹ with Σ = S Sᵀ, (6, 6), N²: S⁻¹ q has unit covariance.

    Examples
    --------
    >>> import numpy as np
    >>> whitening(np.diag([4.0, 25.0])).tolist()
    [[0.5, 0.0], [0.0, 0.2]]
    """
    factor = np.linalg.cholesky(covariance)
    return sla.solve_triangular(factor, np.eye(len(factor)), lower=True)


def information_matrix(regressors: Array, covariance: Array) -> Array:
    """Return F = Σ_t A_tᵀ Σ⁻¹ A_t, (m, m), of A at every sample, (N, 6, m), and Σ of the forces.

    Examples
    --------
    >>> import numpy as np
    >>> information_matrix(np.ones((10, 6, 1)), 4 * np.eye(6)).tolist()
    [[15.0]]
    """
    white = np.matmul(whitening(covariance), regressors)
    stacked = white.reshape(-1, white.shape[2])
    return stacked.T @ stacked


@dataclass(frozen=True)
class ScaledInformation:
    """F scaled to unit diagonal: D F̃ D = F with diagonal D."""

    matrix: Array
    """(m, m), F̃, unit diagonal (0 in rows without excitation)."""
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
        """Return whether F̃ is singular to working precision (see `EXCITABLE`)."""
        values = self.eigenvalues()
        return bool(values[0] <= EXCITABLE * values[-1]) or bool(np.any(self.scales <= 0))

    def weak_directions(self, names: tuple[str, ...]) -> tuple[WeakDirection, ...]:
        """Return the combinations of parameters that F does not determine, in the names' order.

        Each is named by the parameter that is not a base parameter; the base parameters can be
        estimated together.
        """
        return weak_directions(BaseParameters.of(root_of(self.matrix) * self.scales, names))


def weak_directions(base: BaseParameters) -> tuple[WeakDirection, ...]:
    """Return the undetermined combinations for given base parameters, in the names' order."""
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
        Whether no motion within the limits of the machine excites them.
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
        """Names of the parameters without which the others can be estimated together."""
        return tuple(direction.name for direction in self.directions)

    @property
    def combinations(self) -> str:
        """All directions in words, each with its parameters."""
        return "; ".join(str(direction) for direction in self.directions)

    @property
    def shows(self) -> tuple[str, ...]:
        """The determined combinations of these parameters, in words."""
        return tuple(dict.fromkeys(text for one in self.directions for text in one.shows))

    def __reduce__(self) -> tuple[object, ...]:
        """Keep all attributes when a worker process sends the error to its parent."""
        return partial(type(self), structural=self.structural), (self.directions,)


def log_det(information: Array, names: tuple[str, ...]) -> float:
    """Return log det F; the scaling to unit diagonal retains its accuracy.

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

    Examples
    --------
    >>> parameter_covariance(np.diag([4.0, 16.0]), ("p1", "p2")).tolist()
    [[0.25, 0.0], [0.0, 0.0625]]
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
    """Coloured noise of an experiment with periodic motions of any frequency."""

    spectrum: NoiseSpectrum
    """Of the forces, N²."""
    sampling: float
    """Hz."""
    periods: float
    """Number of periods of the recording, which determines the width of a hum's line."""

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
        """Return the weighted A, (n, 6, m), with Σ_t A_tᵀ (·)_t = F; dF is 2 Σ_t dA_tᵀ (·)_t."""
        lines = lines_of(regressors)
        matrices, _ = self._at(omega, len(lines))
        weighted: ComplexArray = np.linalg.solve(matrices, lines).astype(np.complex128, copy=False)
        return series_of(weighted, len(regressors))

    def spread(self, regressors: Array, omega: float) -> Array:
        """Return the covariance of Σ_t A_tᵀ η_t over one period, (m, m): unweighted sums of noise.

        The covariance of least squares follows from it.
        """
        lines = lines_of(regressors)
        matrices, _ = self._at(omega, len(lines))
        mixed = np.matmul(matrices, lines) * multiplicity(len(regressors))[:, None, None]
        flat = lines.reshape(-1, lines.shape[2])
        found = (flat.conj().T @ mixed.reshape(flat.shape)).real
        return (found + found.T) / 2

    def slope(self, weighted: Array, omega: float) -> Array:
        """Return ∂F/∂ω, (m, m), for constant A: the lines move over the spectrum.

        `weighted` is the result of the method of this name.
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
