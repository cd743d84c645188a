"""Noise of the simulated channels: white, or with the memory that its spectrum tells.

Noise with memory is one stationary series over the whole record: its memory runs through all the
periods, and the first sample is as any other.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.fft import next_fast_len

from constraints.arrays import Array, ComplexArray
from expdesign.configuration import InputError, Problem, RunConfiguration
from expdesign.configuration.sizes import SAMPLES
from expdesign.noise.fourier_lines import multiplicity, series_of
from expdesign.noise.hum import Hum
from expdesign.noise.spectrum import NoiseSpectrum

_BLOCK = 4096
"""Lines whose matrices are in memory at once."""

_MOST_KEPT = 100_000
"""Lines whose factors are kept between draws: 58 MB."""

_RESOLVED = 2e-3
"""By how much the variance on the lines may differ from that of the spectrum."""

_LONGEST = 64
"""Length of the series that is drawn, over that of the record; of the longest records less."""


@dataclass(frozen=True, eq=False)
class NoiseSource:
    """The noise of six channels in a record of T samples."""

    covariance: Array
    """(6, 6), of one sample: N² or m²."""
    spectrum: NoiseSpectrum | None
    """None: white."""
    count: int
    """T."""
    sampling: float
    """Hz."""

    def draws(self, rng: np.random.Generator) -> Array:
        """Draw the noise of a record, (T, 6)."""
        if self.spectrum is None:
            return noise_draws(self.covariance, self.count, rng)
        found = np.zeros((self.count, len(self.covariance)))
        if self._continuous.parts:
            found += self._continuous_draws(rng)
        for part in self.spectrum.parts:
            if isinstance(part, Hum):
                found += hum_draws(part, np.arange(self.count) / self.sampling, rng)
        return found

    @cached_property
    def _continuous(self) -> NoiseSpectrum:
        """What of the spectrum is no hum."""
        parts = () if self.spectrum is None else self.spectrum.parts
        return NoiseSpectrum(tuple(part for part in parts if not isinstance(part, Hum)))

    @cached_property
    def _length(self) -> int:
        """L of the series that is drawn, as long as its spectrum needs; T of it are taken.

        The DFT makes a periodic series of it: twice the record's length, no sample is beside
        another one's repetition. A narrow band needs more, to have lines in it.
        """
        length, longest = 2 * self.count, min(_LONGEST * self.count, 2 * SAMPLES.most)
        wanted = np.diag(self._continuous.covariance)
        while length < longest and self._variance(length, wanted) > _RESOLVED:
            length *= 2
        return int(next_fast_len(length, real=True))

    def _variance(self, length: int, wanted: Array) -> float:
        """Return by which share the variances on the lines of a length are off at most."""
        total = np.zeros(len(wanted))
        for block in _blocks(length // 2 + 1):
            matrices = self._matrices(block, length)
            times = multiplicity(length)[int(block[0]) : int(block[-1]) + 1]
            total += times @ np.einsum("ljj->lj", matrices).real
        return float(np.max(np.abs(total / length / wanted - 1)))

    def _matrices(self, numbers: Array, length: int) -> ComplexArray:
        """Return S at lines of these numbers, (L, 6, 6)."""
        frequencies = numbers * self.sampling / length
        return self._continuous.at(frequencies, self.sampling, float(self.count))

    def _factors(self) -> Iterator[ComplexArray]:
        """Yield R of S = R Rᴴ, block by block of the lines."""
        for block in _blocks(self._length // 2 + 1):
            yield _factor(self._matrices(block, self._length))

    @cached_property
    def _kept(self) -> list[ComplexArray] | None:
        return list(self._factors()) if self._length // 2 < _MOST_KEPT else None

    def _continuous_draws(self, rng: np.random.Generator) -> Array:
        length, channels = self._length, len(self.covariance)
        drawn = rng.standard_normal((length // 2 + 1, 2, channels))
        lines = (drawn[:, 0] + 1j * drawn[:, 1]) / np.sqrt(2)
        # The line of a constant, and the last one of an even number of samples, are real.
        lines[0] = drawn[0, 0]
        if length % 2 == 0:
            lines[-1] = drawn[-1, 0]
        blocks = _blocks(len(lines))
        for block, factor in zip(blocks, self._kept or self._factors(), strict=True):
            place = slice(int(block[0]), int(block[-1]) + 1)
            lines[place] = np.einsum("lij,lj->li", factor, lines[place])
        return np.ascontiguousarray(series_of(lines, length)[: self.count])


def _blocks(count: int) -> Iterator[Array]:
    for start in range(0, count, _BLOCK):
        yield np.arange(start, min(start + _BLOCK, count), dtype=np.float64)


def _factor(matrices: ComplexArray) -> ComplexArray:
    try:
        return np.asarray(np.linalg.cholesky(matrices))
    except np.linalg.LinAlgError:  # a channel without noise at some frequency
        values, vectors = np.linalg.eigh(matrices)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0))[:, None, :])


def hum_draws(hum: Hum, times: Array, rng: np.random.Generator) -> Array:
    """Draw lines of a spectrum at times, (T,), s: sinusoids of their size, (T, 6).

    Their phases are drawn, and run on through the whole record.
    """
    values, vectors = np.linalg.eigh(hum.variances)
    roots = vectors * np.sqrt(2 * np.maximum(values, 0))[:, None, :]
    phases = rng.uniform(0, 2 * np.pi, values.shape)
    found = np.zeros((len(times), values.shape[1]))
    for frequency, root, phase in zip(hum.frequencies, roots, phases, strict=True):
        found += np.sin(2 * np.pi * frequency * times[:, None] + phase) @ root.T
    return found


def noise_sources(
    configuration: RunConfiguration, count: int, sampling: float
) -> tuple[NoiseSource, NoiseSource]:
    """Return the noise of the forces, N, and of the lengths, m, of the true machine.

    Raises
    ------
    InputError
        The noise is not known.
    """
    forces, lengths = noise_covariances(configuration)
    noise = (configuration.truth or configuration.robot).noise
    spectra = (None, None) if noise is None else (noise.force_spectrum, noise.length_spectrum)
    return (
        NoiseSource(forces, spectra[0], count, sampling),
        NoiseSource(lengths, spectra[1], count, sampling),
    )


def noise_covariances(configuration: RunConfiguration) -> tuple[Array, Array]:
    """Return Σ, (6, 6), N², and Δ, (6, 6), m², of the true machine.

    Raises
    ------
    InputError
        They state no noise of the forces, or none of the lengths.
    """
    noise = (configuration.truth or configuration.robot).noise
    given: dict[str, Any] = {
        what: getattr(noise, f"{what}_covariance", None) for what in ("force", "length")
    }
    problems = [
        Problem(
            f"a simulated experiment needs the noise of the {what}s, and neither robot nor "
            "run state it",
            file=configuration.file,
            key="noise",
            allowed=f"{what}_std (six values) or {what}_covariance (6 × 6)",
        )
        for what, covariance in given.items()
        if covariance is None
    ]
    if problems:
        raise InputError(problems)
    return given["force"], given["length"]


def noise_draws(covariance: Array, count: int, rng: np.random.Generator) -> Array:
    """Draw samples, (count, 6), that are independent of each other."""
    factor = np.linalg.cholesky(covariance)
    return rng.standard_normal((count, len(covariance))) @ factor.T
