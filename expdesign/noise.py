"""The spectrum of sampled noise: a covariance of one sample, spread over the frequencies.

With Z_j = rfft(x)/√N of N samples x, (N, 6), at the frequency f_j = j/N of the sampling,
E Z_j Z_jᴴ = S(f_j), Hermitian; the mean of S over all N lines is the covariance of one sample.
White noise has S = Σ at every frequency. The spectrum is that of the samples: analogue noise above
half of the sampling rate is folded into it.

The phase of a hum, such as 50 Hz and its multiples from the mains, is random in every recording and
continuous through it. Its line is as narrow as the recording resolves, with the shape of noise
whose correlation lasts as long as the recording (a Lorentzian, folded at the sampling): height and
content are those of the sinusoid, and there are no zeros at its sides, since no hum keeps its
frequency exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
import scipy

from constraints.arrays import Array, ComplexArray

Hermitian = ComplexArray
"""Complex Hermitian matrices, (L, 6, 6)."""


class SpectralValues(NamedTuple):
    """A spectrum at L frequencies and its derivatives, (L, 6, 6) each."""

    value: Hermitian
    """S, the square of the channels' unit."""
    by_frequency: Hermitian
    """∂S/∂f, per Hz."""
    by_samples: Hermitian
    """∂S/∂n for the number n of samples of the recording, on which lines of a hum depend."""


class SpectralPart(Protocol):
    """A summand of a spectrum; the parts are independent of each other."""

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample."""

    @property
    def highest(self) -> float:
        """Largest sampling frequency for which the part is known, Hz; infinite for most."""
        return np.inf

    def values(self, frequencies: Array, sampling: float, samples: float) -> SpectralValues:
        """Return S and its derivatives; the arguments are those of `NoiseSpectrum.at`."""


@dataclass(frozen=True, eq=False)
class NoiseSpectrum:
    """Spectrum of the noise of six channels: forces in N, or lengths in m."""

    parts: tuple[SpectralPart, ...]

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample: Σ in N², or Δ in m²."""
        return np.sum([part.covariance for part in self.parts], axis=0)

    @property
    def highest(self) -> float:
        """Largest sampling frequency for which the spectrum is known, Hz."""
        return min(part.highest for part in self.parts)

    def covers(self, sampling: float) -> bool:
        """Return whether the spectrum is known up to half of a sampling rate, Hz."""
        return sampling <= self.highest * (1 + 1e-9)

    def at(self, frequencies: Array, sampling: float, samples: float) -> Hermitian:
        """Return S, (L, 6, 6), the square of the channels' unit.

        Frequencies, (L,), Hz, have either sign; the spectrum has to be known up to half of the
        `sampling` rate, Hz. The resolution of a recording of so many `samples` is width and height
        of a hum's line.
        """
        return self.values(frequencies, sampling, samples).value

    def values(self, frequencies: Array, sampling: float, samples: float) -> SpectralValues:
        """Return S and its derivatives, as `at`."""
        if not self.covers(sampling):
            raise ValueError(
                f"the spectrum of the noise is known for a sampling of {self.highest:g} Hz at "
                f"most, not of {sampling:g} Hz"
            )
        found = [part.values(frequencies, sampling, samples) for part in self.parts]
        return SpectralValues(*(np.sum(each, axis=0) for each in zip(*found, strict=True)))

    def harmonics(self, base: float, count: int, sampling: float, samples: float) -> SpectralValues:
        """Return S at the multiples 0 … count − 1 of a base frequency, Hz.

        `by_frequency` is then the derivative with respect to the base frequency at a constant
        number of samples, `by_samples` that with respect to the number.
        """
        orders = np.arange(count, dtype=np.float64)
        found = self.values(orders * base, sampling, samples)
        return found._replace(by_frequency=found.by_frequency * orders[:, None, None])


def lines_of(series: Array) -> ComplexArray:
    """Return the lines Z = rfft(x)/√n of series, (n, …): (n // 2 + 1, …)."""
    return np.fft.rfft(series, axis=0) / np.sqrt(len(series))


def series_of(lines: ComplexArray, samples: int) -> Array:
    """Return the series, (n, …), that have these lines."""
    return np.fft.irfft(lines * np.sqrt(samples), samples, axis=0)


def multiplicity(samples: int) -> Array:
    """Return the multiplicity of each line in a sum over all n lines, (n // 2 + 1,): 1 or 2.

    Examples
    --------
    >>> multiplicity(6).tolist()
    [1.0, 2.0, 2.0, 1.0]
    """
    times = np.full(samples // 2 + 1, 2.0)
    times[0] = 1.0
    if samples % 2 == 0:
        times[-1] = 1.0
    return times


_SMALLEST = 1e-12
"""Smallest eigenvalue of the innovations' correlation that counts as positive."""


@dataclass(frozen=True, eq=False)
class Autoregressive(SpectralPart):
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
            The noise grows without bound; or no innovations give channels with so different
            coefficients this correlation.
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
    """Return whether the autoregression of every channel is stable: coefficients (6, p)."""
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


_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Tabulated(SpectralPart):
    """A density that is linear between tabulated frequencies."""

    frequencies: Array
    """(K,), Hz, increasing, from 0 to half of the sampling rate of the measurement."""
    density: Hermitian
    """(K, 6, 6), one-sided, the square of the channels' unit per Hz, positive definite: its real
    part integrates to the covariance of one sample."""

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample."""
        steps = np.diff(self.frequencies)[:, None, None]
        return np.sum((self.density[1:] + self.density[:-1]).real * steps / 2, axis=0)

    @property
    def highest(self) -> float:
        """Sampling rate of the measurement, Hz; at lower rates the density is folded."""
        return 2 * float(self.frequencies[-1])

    def transformed(self, matrix: Array) -> Tabulated:
        """Return the density of T x for a matrix T, (6, 6)."""
        return replace(self, density=matrix @ self.density @ matrix.T)

    def values(self, frequencies: Array, sampling: float, samples: float) -> SpectralValues:
        """Return S, folded at half of the sampling, and its derivatives."""
        del samples
        shape = (len(frequencies), *self.density.shape[1:])
        value: Hermitian = np.zeros(shape, dtype=np.complex128)
        slope: Hermitian = np.zeros(shape, dtype=np.complex128)
        last = float(self.frequencies[-1])
        if abs(sampling - 2 * last) <= _ROUNDING * sampling:
            last = sampling / 2
        folded = frequencies - sampling * np.round(frequencies / sampling)
        folds = int(np.ceil(last / sampling + 0.5))
        for fold in range(-folds, folds + 1):
            place = folded + fold * sampling
            # Without folding both ends are the same frequency: one of them counts.
            inside = (place >= -last) & (place < last)
            level, rise = self._interpolated(np.abs(place[inside]))
            back = (place[inside] < 0)[:, None, None]
            value[inside] += np.where(back, level.conj(), level)
            slope[inside] += np.where(back, -rise.conj(), rise)
        value *= sampling / 2
        slope *= sampling / 2
        return SpectralValues(value, slope, np.zeros_like(value))

    def _interpolated(self, frequencies: Array) -> tuple[Hermitian, Hermitian]:
        """Return density and its slope, (L, 6, 6) each."""
        knots = self.frequencies
        left = np.clip(np.searchsorted(knots, frequencies, side="right") - 1, 0, len(knots) - 2)
        rise = np.diff(self.density, axis=0) / np.diff(knots)[:, None, None]
        step = (frequencies - knots[left])[:, None, None]
        return self.density[left] + rise[left] * step, rise[left]


def between(own: Array, wanted: Array) -> Array:
    """Return the symmetric positive definite T with T C T = Σ, (6, 6), for two covariances.

    It is the smallest change of the channels: diagonal if a rescaling is enough, the identity for
    equal covariances.
    """
    root = _root(own)
    inverse = np.linalg.inv(root)
    matrix = inverse @ _root(root @ wanted @ root) @ inverse
    return (matrix + matrix.T) / 2


def _root(matrix: Array) -> Array:
    values, vectors = scipy.linalg.eigh((matrix + matrix.T) / 2)
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T


_HALF_MAXIMUM = 2 * np.sqrt(2 * np.log(2))
"""Full width at half maximum of a normal density, over its standard deviation."""
_REACH = 9.0
"""Standard deviations beyond which the density is zero in double precision."""


@dataclass(frozen=True, eq=False)
class Band(SpectralPart):
    """A density with the shape of a normal distribution about a frequency."""

    variance: Array
    """(6, 6), covariance of one sample."""
    frequency: float
    """Frequency of the maximum, Hz."""
    width: float
    """Full width at half maximum, Hz."""

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample."""
        return self.variance

    def values(self, frequencies: Array, sampling: float, samples: float) -> SpectralValues:
        """Return S, folded at half of the sampling, and its derivatives."""
        del samples
        spread = self.width / _HALF_MAXIMUM
        height = sampling / (2 * spread * np.sqrt(2 * np.pi))
        folds = int(np.ceil(_REACH * spread / sampling))
        level, slope = np.zeros(len(frequencies)), np.zeros(len(frequencies))
        for sign in (-1.0, 1.0):
            off = frequencies + sign * self.frequency
            off = off - sampling * np.round(off / sampling)
            for fold in range(-folds, folds + 1):
                far = (off + fold * sampling) / spread
                one = height * np.exp(-(far**2) / 2)
                level, slope = level + one, slope - one * far / spread
        value, rise = (
            np.multiply.outer(each, self.variance).astype(complex) for each in (level, slope)
        )
        return SpectralValues(value, rise, np.zeros_like(value))


@dataclass(frozen=True, eq=False)
class Hum(SpectralPart):
    """Lines at some frequencies."""

    frequencies: Array
    """(K,), Hz."""
    variances: Array
    """(K, 6, 6), covariance of one sample of each line: half of the squared amplitudes on the
    diagonal for independent phases of the channels."""

    @classmethod
    def of(cls, frequencies: Array, amplitudes: Array) -> Hum:
        """Return lines of these amplitudes, (K, 6), with independent phases."""
        return cls(frequencies, np.eye(amplitudes.shape[1]) * amplitudes[:, None, :] ** 2 / 2)

    @property
    def covariance(self) -> Array:
        """(6, 6), of one sample."""
        return np.sum(self.variances, axis=0)

    def transformed(self, matrix: Array) -> Hum:
        """Return the lines of T x for a matrix T, (6, 6)."""
        return replace(self, variances=matrix @ self.variances @ matrix.T)

    def values(self, frequencies: Array, sampling: float, samples: float) -> SpectralValues:
        """Return S and its derivatives."""
        level = by_angle = by_samples = np.zeros((len(frequencies), len(self.frequencies)))
        for sign in (-1.0, 1.0):
            angle = 2 * np.pi * (frequencies[:, None] + sign * self.frequencies) / sampling
            one, angle_slope, samples_slope = _line(angle, samples)
            level, by_angle = level + one / 2, by_angle + angle_slope / 2
            by_samples = by_samples + samples_slope / 2
        weighted = (
            np.tensordot(each, self.variances, axes=(1, 0)).astype(complex)
            for each in (level, by_angle * 2 * np.pi / sampling, by_samples)
        )
        return SpectralValues(*weighted)


def _line(angle: Array, samples: float) -> tuple[Array, Array, Array]:
    """Return Poisson's kernel with r = exp(−2/n), and its derivatives to angle and n.

    Its mean over a turn is one, its height n for a large n.
    """
    r = float(np.exp(-2 / samples))
    content, cosine = -float(np.expm1(-4 / samples)), np.cos(angle)
    below = float(np.expm1(-2 / samples)) ** 2 + 4 * r * np.sin(angle / 2) ** 2
    by_angle = -content * 2 * r * np.sin(angle) / below**2
    by_r = (-2 * r * below + content * 2 * (cosine - r)) / below**2
    return content / below, by_angle, by_r * r * 2 / samples**2
