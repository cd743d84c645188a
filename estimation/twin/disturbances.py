"""Disturbances of a simulated experiment: tracking error, noise, cogging, drift and others.

Each has a separate random stream, independent of the other disturbances. All streams are spawned
from a seed by the key (repetition, purpose). Repetitions count from 1; the key 0 belongs to the
experiment, whose draws all repetitions share.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from scipy.fft import next_fast_len

from constraints.arrays import Array, ComplexArray, Mask
from expdesign.configuration import InputError, Problem, RunConfiguration, experiment
from expdesign.configuration.schema import MOST_SAMPLES
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.noise import Hum as SpectralHum
from expdesign.noise import NoiseSpectrum, multiplicity, series_of
from expdesign.trajectory import FourierTrajectory

_EXPERIMENT = 0


class Shared(IntEnum):
    """Random draws of the experiment, shared by all its repetitions."""

    TRACKING_ERROR = 0
    DRIFT = 1


class Repeated(IntEnum):
    """Random draws of one repetition."""

    FORCE_NOISE = 0
    LENGTH_NOISE = 1
    OUTLIERS = 2
    HUM = 3
    LOST = 4


def experiment_stream(seed: int, purpose: Shared) -> np.random.Generator:
    """Return the stream of a draw that all repetitions share."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(_EXPERIMENT, purpose)))


def repetition_stream(seed: int, repetition: int, purpose: Repeated) -> np.random.Generator:
    """Return a stream of one repetition, counted from 1."""
    if repetition < 1:
        raise ValueError(f"repetitions count from 1; there is no repetition {repetition}")
    # The same child as that of SeedSequence(seed, spawn_key=(repetition,)).spawn().
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(repetition, purpose)))


def execute_design(
    design: FourierTrajectory, error: experiment.TrackingError | None, rng: np.random.Generator
) -> FourierTrajectory:
    """Add the tracking error of a controller to a designed motion.

    The error is periodic as the command: the deviation of each pose coordinate is a Fourier series
    in the harmonics first … last of the same ω. Its amplitudes are drawn from one normal
    distribution and scaled to the given root mean square over one period: `position` for x, y, z
    and `angle` for φ, θ, ψ. Without an error the design is returned.
    """
    if error is None or error.position == error.angle == 0:
        return design
    first, last = error.harmonics
    sizes = np.repeat([error.position, error.angle], COORDINATES // 2)
    drawn = rng.standard_normal((2, COORDINATES, last - first + 1))
    # A series Σ a sin kωt + b cos kωt has the mean square Σ (a² + b²)/2 over a period.
    rms = np.sqrt(np.sum(drawn**2, axis=(0, 2)) / 2)
    sine, cosine = drawn * (sizes / rms)[:, None]
    orders = design.omega * np.arange(first, last + 1)
    more = ((0, 0), (0, max(last - design.harmonics, 0)))
    mu, nu = np.pad(design.mu, more), np.pad(design.nu, more)
    mu[:, first - 1 : last] += sine * orders
    nu[:, first - 1 : last] -= cosine * orders
    return FourierTrajectory(design.omega, design.lambda0, mu, nu)


def cogging_force(lengths: Array, cogging: experiment.Cogging) -> Array:
    """Return the cogging of linear motors in the forces, (T, 6), N.

    It is c(q) = amplitude · sin(2π q/pitch + phase) at the true lengths q, (T, 6), m, with the sign
    of friction in the model: Q = A p + c(q). The attraction between magnets and iron that pulls the
    slider out is therefore −c(q).
    """
    angle = 2 * np.pi * lengths / np.asarray(cogging.pitch) + np.asarray(cogging.phase)
    return np.asarray(cogging.amplitude) * np.sin(angle)


def length_drift(final: Array, time: Array, duration: float) -> Array:
    """Return the drift of the lengths, (T, 6), m, at times from the start, (T,), s.

    It is half a cosine to the final value, (6,), m, as of a machine that warms up.
    """
    return np.multiply.outer((1 - np.cos(np.pi * time / duration)) / 2, final)


def draw_gross_errors(
    outliers: experiment.Outliers, count: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Draw gross errors of lengths (m) and forces (N), (count, 6) each; mostly zeros.

    Every sample of every channel has an error of the given size with the probability `share`,
    independently of the others, positive or negative with equal probability.
    """
    uniform = rng.random((count, 2 * ACTUATORS))
    up, down = uniform < outliers.share / 2, uniform >= 1 - outliers.share / 2
    signs = up.astype(float) - down
    return outliers.length * signs[:, :ACTUATORS], outliers.force * signs[:, ACTUATORS:]


def quantise(values: Array, step: float) -> Array:
    """Round values to the steps of an encoder or converter; a step of 0 leaves them unchanged.

    Examples
    --------
    >>> quantise(np.array([0.26, 0.9]), 0.5).tolist()
    [0.5, 1.0]
    """
    return np.round(values / step) * step if step > 0 else values


def force_gains(error: experiment.ForceConstantError, time: Array, duration: float) -> Array:
    """Return measured over true force, (T, 6), at times from the start, (T,), s."""
    drift = 1 + np.multiply.outer(time / duration, np.asarray(error.drift))
    return (1 + error.common) * (1 + np.asarray(error.each)) * drift


def hum_force(hum: experiment.HumDisturbance, time: Array, rng: np.random.Generator) -> Array:
    """Draw the hum in the measured forces, (T, 6), N, at times (T,), s.

    The phase is continuous over the whole recording, for any period of the motion.
    """
    phases = rng.uniform(0, 2 * np.pi, (len(hum.harmonics), ACTUATORS))
    if hum.phase is not None:
        phases = np.multiply.outer(np.arange(1, len(hum.harmonics) + 1), hum.phase)
    found = np.zeros((len(time), ACTUATORS))
    for order, (share, phase) in enumerate(zip(hum.harmonics, phases, strict=True), start=1):
        angle = 2 * np.pi * order * hum.frequency * time
        found += share * np.asarray(hum.amplitude) * np.sin(angle[:, None] + phase)
    return found


def draw_kept_samples(lost: experiment.Lost, count: int, rng: np.random.Generator) -> Mask:
    """Draw the samples that the recording keeps, (T,)."""
    if lost.share is not None:
        return rng.random(count) >= lost.share
    kept = np.ones(count, dtype=bool)
    kept[np.array(lost.rows or (), dtype=int) - 1] = False
    return kept


_BLOCK = 4096
"""Number of lines in memory at once."""
_MOST_KEPT = 100_000
"""Largest number of lines with stored factors: 58 MB."""
_RESOLVED = 2e-3
"""Largest relative error of the variance on the lines."""
_LONGEST = 64
"""Largest length of the random series, over that of the recording."""


@dataclass(frozen=True, eq=False)
class NoiseSource:
    """Noise of six channels in a recording of T samples."""

    covariance: Array
    """(6, 6), of one sample: N² or m²."""
    spectrum: NoiseSpectrum | None
    """None: white."""
    count: int
    """T."""
    sampling: float
    """Hz."""

    def draw(self, rng: np.random.Generator) -> Array:
        """Draw the noise of a recording, (T, 6)."""
        if self.spectrum is None:
            return draw_noise(self.covariance, self.count, rng)
        found = np.zeros((self.count, len(self.covariance)))
        if self._continuous.parts:
            found += self._draw_continuous(rng)
        for part in self.spectrum.parts:
            if isinstance(part, SpectralHum):
                found += draw_hum(part, np.arange(self.count) / self.sampling, rng)
        return found

    @cached_property
    def _continuous(self) -> NoiseSpectrum:
        """Return the continuous part of the spectrum, without hum."""
        parts = () if self.spectrum is None else self.spectrum.parts
        return NoiseSpectrum(tuple(part for part in parts if not isinstance(part, SpectralHum)))

    @cached_property
    def _length(self) -> int:
        """Return the length L of the random series, of which T samples are used.

        The DFT makes the series periodic: with twice the length no sample is correlated with a
        repetition. A narrow band needs more, to have lines in it.
        """
        length, longest = 2 * self.count, min(_LONGEST * self.count, 2 * MOST_SAMPLES)
        wanted = np.diag(self._continuous.covariance)
        while length < longest:
            total = np.zeros(len(wanted))
            for place, matrices in self._spectral_lines(length):
                total += multiplicity(length)[place] @ np.einsum("ljj->lj", matrices).real
            # NaN, of a channel without noise, ends the loop.
            if not np.max(np.abs(total / length / wanted - 1)) > _RESOLVED:
                break
            length *= 2
        return int(next_fast_len(length, real=True))

    def _spectral_lines(self, length: int) -> Iterator[tuple[slice, ComplexArray]]:
        """Yield the spectrum at the lines of a length, (L, 6, 6), block by block."""
        count = length // 2 + 1
        for start in range(0, count, _BLOCK):
            place = slice(start, min(start + _BLOCK, count))
            numbers = np.arange(place.start, place.stop, dtype=np.float64)
            frequencies = numbers * self.sampling / length
            yield place, self._continuous.at(frequencies, self.sampling, float(self.count))

    def _factors(self) -> Iterator[tuple[slice, ComplexArray]]:
        """Yield R of S = R Rᴴ, block by block of the lines."""
        for place, matrices in self._spectral_lines(self._length):
            yield place, _factor(matrices)

    @cached_property
    def _kept_factors(self) -> list[tuple[slice, ComplexArray]] | None:
        return list(self._factors()) if self._length // 2 < _MOST_KEPT else None

    def _draw_continuous(self, rng: np.random.Generator) -> Array:
        length, channels = self._length, len(self.covariance)
        drawn = rng.standard_normal((length // 2 + 1, 2, channels))
        lines = (drawn[:, 0] + 1j * drawn[:, 1]) / np.sqrt(2)
        # The line of a constant, and the last one of an even number of samples, are real.
        lines[0] = drawn[0, 0]
        if length % 2 == 0:
            lines[-1] = drawn[-1, 0]
        for place, factor in self._kept_factors or self._factors():
            lines[place] = np.einsum("lij,lj->li", factor, lines[place])
        return np.ascontiguousarray(series_of(lines, length)[: self.count])


def _factor(matrices: ComplexArray) -> ComplexArray:
    try:
        return np.asarray(np.linalg.cholesky(matrices))
    except np.linalg.LinAlgError:  # a channel without noise at some frequency
        values, vectors = np.linalg.eigh(matrices)
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0))[:, None, :])


def draw_hum(hum: SpectralHum, times: Array, rng: np.random.Generator) -> Array:
    """Draw lines of a spectrum at times, (T,), s: sinusoids of their size, (T, 6).

    Their phases are drawn, and continuous over the whole recording.
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
    """Return the noise of the true machine: that of the forces, N, and of the lengths, m."""
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
        The noise of forces or lengths is missing.
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


def draw_noise(covariance: Array, count: int, rng: np.random.Generator) -> Array:
    """Draw independent samples, (count, 6)."""
    factor = np.linalg.cholesky(covariance)
    return rng.standard_normal((count, len(covariance))) @ factor.T
