"""Spectra of noise against their covariances, simulated noise, and differences."""

import numpy as np
import pytest
from scipy.signal import lfilter

from expdesign.noise import Autoregressive, Hum, NoiseSpectrum, Tabulated, between

RING = np.array([[0.5 ** min(abs(i - j), 6 - abs(i - j)) for j in range(6)] for i in range(6)])
STD = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
COVARIANCE = RING * np.outer(STD, STD)
COEFFICIENTS = np.array([[0.5, 0.2], [0.6, 0.1], [0.9, -0.3], [0.5, 0.2], [0.4, 0.2], [0.7, 0]])
SAMPLING, SAMPLES = 1000.0, 400


def _lines(samples=SAMPLES, sampling=SAMPLING):
    return np.arange(samples) / samples * sampling


def _table(rng, knots=(0.0, 10.0, 50.0, 200.0, 500.0)):
    density = []
    for knot in knots:
        z = rng.normal(size=(6, 9)) + 1j * rng.normal(size=(6, 9)) * (0 < knot < knots[-1])
        density.append(z @ z.conj().T)
    return Tabulated(np.array(knots), np.array(density))


def _parts():
    rng = np.random.default_rng(1)
    amplitudes = rng.uniform(1, 2, (2, 6))
    return {
        "white": Autoregressive.with_covariance(np.zeros((6, 0)), COVARIANCE),
        "autoregressive": Autoregressive.with_covariance(COEFFICIENTS, COVARIANCE),
        "tabulated": _table(rng),
        "hum": Hum.of(np.array([50.0, 130.0]), amplitudes),
    }


@pytest.mark.parametrize("part", _parts().values(), ids=_parts())
def test_the_mean_over_the_lines_is_the_covariance(part):
    spectrum = NoiseSpectrum((part,))
    # More lines than samples: those of hum are as narrow as the record.
    found = spectrum.at(_lines(20 * SAMPLES), SAMPLING, SAMPLES).mean(axis=0)
    np.testing.assert_allclose(found, spectrum.covariance, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("sampling", [700.0, 300.0])
def test_slower_sampling_folds_and_loses_nothing(sampling):
    spectrum = NoiseSpectrum((_parts()["tabulated"],))
    found = spectrum.at(_lines(20_000, sampling), sampling, SAMPLES).mean(axis=0)
    np.testing.assert_allclose(found, spectrum.covariance, rtol=1e-4, atol=1e-2)
    assert not spectrum.covers(1001.0)
    with pytest.raises(ValueError, match="1000 Hz at most"):
        spectrum.at(np.zeros(1), 1001.0, SAMPLES)


@pytest.mark.parametrize("part", _parts().values(), ids=_parts())
def test_spectra_are_hermitian_and_positive(part):
    found = NoiseSpectrum((part,)).at(_lines(), SAMPLING, SAMPLES)
    np.testing.assert_allclose(found, found.conj().transpose(0, 2, 1), rtol=1e-12)
    assert np.all(np.linalg.eigvalsh(found) > 0)
    # Real noise: conjugate at negative frequencies, and periodic in the sampling.
    np.testing.assert_allclose(found[1:], found[:0:-1].conj(), rtol=1e-9, atol=1e-12)


def test_autoregressive_noise_has_its_spectrum():
    part = _parts()["autoregressive"]
    rng, repetitions = np.random.default_rng(3), 300
    factor = np.linalg.cholesky(part.innovation)
    count = 200 + SAMPLES
    innovations = rng.normal(size=(repetitions, count, 6)) @ factor.T
    noise = np.stack(
        [
            lfilter([1.0], np.append(1.0, -row), innovations[..., i], axis=1)
            for i, row in enumerate(part.coefficients)
        ],
        axis=2,
    )[:, 200:]
    z = np.fft.rfft(noise, axis=1) / np.sqrt(SAMPLES)
    # Means over neighbouring lines, (bands, 6, 6); each of repetitions · 20 products.
    measured = np.einsum("rji,rjk->jik", z, z.conj()) / repetitions
    expected = NoiseSpectrum((part,)).at(_lines()[: len(z[0])], SAMPLING, SAMPLES)
    measured, expected = measured[1:-1], expected[1:-1]
    bands = [slice(k, k + 20) for k in range(0, 180, 20)]
    size = np.sqrt(np.einsum("jii,jkk->jik", expected, expected).real)
    for band in bands:
        error = np.abs(np.mean((measured[band] - expected[band]) / size[band], axis=0))
        assert np.max(error) < 5 / np.sqrt(20 * repetitions)


def test_a_hum_is_a_line_as_high_as_the_record_is_long():
    hum = Hum.of(np.array([50.0]), np.full((1, 6), 2.0))
    at = NoiseSpectrum((hum,)).at(np.array([50.0]), SAMPLING, SAMPLES)
    time = np.arange(SAMPLES) / SAMPLING
    z = np.fft.rfft(2.0 * np.cos(2 * np.pi * 50 * time + 0.3))[20] / np.sqrt(SAMPLES)
    np.testing.assert_allclose(at[0, 0, 0].real, abs(z) ** 2, rtol=1e-3)


@pytest.mark.parametrize("part", _parts().values(), ids=_parts())
def test_derivatives_against_differences(part):
    spectrum, frequencies = NoiseSpectrum((part,)), np.array([3.1, 49.6, 77.0, -20.0, 333.3])
    found, step = spectrum.values(frequencies, 900.0, SAMPLES), 1e-5
    ahead, behind = (spectrum.at(frequencies + d, 900.0, SAMPLES) for d in (step, -step))
    size = np.max(np.abs(found.value))
    difference = (ahead - behind) / (2 * step)
    np.testing.assert_allclose(found.by_frequency, difference, rtol=1e-6, atol=1e-8 * size)
    ahead, behind = (spectrum.at(frequencies, 900.0, SAMPLES + d) for d in (0.1, -0.1))
    difference = (ahead - behind) / 0.2
    np.testing.assert_allclose(found.by_samples, difference, rtol=1e-5, atol=1e-10 * size)


def test_harmonics_move_with_their_base():
    spectrum = NoiseSpectrum(tuple(_parts().values()))
    found = spectrum.harmonics(0.37, 60, SAMPLING, SAMPLES)
    ahead, behind = (
        spectrum.harmonics(0.37 + d, 60, SAMPLING, SAMPLES).value for d in (1e-6, -1e-6)
    )
    difference = (ahead - behind) / 2e-6
    np.testing.assert_allclose(found.by_frequency, difference, rtol=1e-5, atol=1e-2)


def test_the_smallest_change_from_one_covariance_to_another():
    rng = np.random.default_rng(5)
    root = rng.normal(size=(6, 9))
    own = root @ root.T
    matrix = between(own, COVARIANCE)
    np.testing.assert_allclose(matrix @ own @ matrix.T, COVARIANCE, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(between(own, own), np.eye(6), atol=1e-9)
    np.testing.assert_allclose(between(RING, COVARIANCE), np.diag(STD), atol=1e-9)


def test_noise_that_grows_or_cannot_be_is_refused():
    with pytest.raises(ValueError, match="without bound"):
        Autoregressive.with_covariance(np.full((6, 1), 1.0), COVARIANCE)
    strong = 0.999 * np.ones((6, 6)) + 0.001 * np.eye(6)
    alike = np.full((6, 1), 0.9)
    assert Autoregressive.with_covariance(alike, strong) is not None
    with pytest.raises(ValueError, match="differently"):
        Autoregressive.with_covariance(np.vstack([alike[:3], -alike[:3]]), strong)
