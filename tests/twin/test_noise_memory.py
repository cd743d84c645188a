"""Noise with a spectrum: what is drawn against what was asked for."""

import numpy as np
import pytest
from scipy import stats

from estimation.twin import Twin
from estimation.twin.disturbances import NoiseSource, draw_noise
from expdesign.configuration import load_run
from expdesign.noise import Autoregressive, Band, Hum, NoiseSpectrum, Tabulated
from tests.twin.examples import motion

LEVEL = 1e-6
RING = np.array([[0.5 ** min(abs(i - j), 6 - abs(i - j)) for j in range(6)] for i in range(6)])
COVARIANCE = RING * np.outer(np.arange(1, 7), np.arange(1, 7))
SAMPLING = 500.0


def white(covariance):
    return Autoregressive.with_covariance(np.zeros((6, 0)), covariance)


def autoregressive(*rows):
    return Autoregressive.with_covariance(np.array(rows), COVARIANCE)


def table():
    rng = np.random.default_rng(4)
    knots = np.array([0.0, 20.0, 90.0, 250.0])
    density = []
    for knot in knots:
        root = rng.normal(size=(6, 9)) + 1j * rng.normal(size=(6, 9)) * (0 < knot < knots[-1])
        density.append(root @ root.conj().T)
    return Tabulated(knots, np.array(density))


SPECTRA = {
    "autoregressive": (autoregressive(*[[0.9]] * 6),),
    "channels of their own": (autoregressive([0.5], [0.6], [0.4], [0.5], [0.3], [0.5]),),
    "second order": (autoregressive(*[[0.5, 0.3]] * 6),),
    "band": (white(0.9 * COVARIANCE), Band(0.1 * COVARIANCE, 30.0, 12.0)),
    "table": (table(),),
}


def source(parts, count, sampling=SAMPLING):
    spectrum = NoiseSpectrum(parts)
    return NoiseSource(spectrum.covariance, spectrum, count, sampling)


@pytest.mark.parametrize("parts", SPECTRA.values(), ids=SPECTRA)
def test_the_spectrum_of_what_is_drawn(parts):
    """Whitened by the analytic spectrum, every line is a complex standard normal vector.

    2 ZᴴS⁻¹Z of a line is then χ² with 12 degrees of freedom; means over bands of lines, and the
    whole matrices, are compared with what that leaves open.
    """
    count = 16_384
    found = source(parts, count).draw(np.random.default_rng(1))
    # A smooth window: what a line leaks does not reach lines of a hundredth of its size.
    window = np.hanning(count)
    lines = np.fft.rfft(found * window[:, None], axis=0) / np.sqrt(np.sum(window**2))
    frequencies = np.arange(len(lines)) * SAMPLING / count
    matrices = NoiseSpectrum(parts).at(frequencies, SAMPLING, count)
    factors = np.linalg.cholesky(matrices)
    white_lines = np.linalg.solve(factors, lines[:, :, None])[:, :, 0]
    # Lines beside each other share the window's width.
    independent = white_lines[8:-8:4]
    for band in np.array_split(independent, 8):
        product = np.einsum("li,lj->ij", band, band.conj()) / len(band)
        assert np.abs(product - np.eye(6)).max() < stats.norm.isf(LEVEL) * np.sqrt(2 / len(band))
    power = 2 * np.sum(np.abs(independent) ** 2)
    freedom = 12 * len(independent)
    assert stats.chi2.ppf(LEVEL, freedom) < power < stats.chi2.isf(LEVEL, freedom)


def test_memory_runs_through_a_record_that_begins_like_any_other():
    """Covariances between all pairs of samples: stationary, and not periodic."""
    count, records, rho = 12, 6000, 0.9
    noise = source((autoregressive(*[[rho]] * 6),), count)
    rng = np.random.default_rng(2)
    drawn = np.array([noise.draw(rng)[:, 0] for _ in range(records)]) / np.sqrt(COVARIANCE[0, 0])
    found = drawn.T @ drawn / records
    apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
    # The DFT makes the series periodic; it is drawn so long that this cannot be seen.
    assert noise._length >= 2 * count
    np.testing.assert_allclose(found, rho**apart, atol=5 * np.sqrt(2 / records))


def test_memory_outlasts_the_periods():
    """Neighbouring samples of two periods are correlated as those inside of one."""
    given = {"force_spectrum": {"ar": 0.9}}
    run = {"name": "n", "robot": "palida", "experiment": {"periods": 300, "sampling": 10}}
    twin = Twin.of(load_run(run | {"noise": given}), motion())
    measured = twin.measurement()
    noise = measured.forces - twin.forces
    starts = np.flatnonzero(np.diff(measured.period)) + 1
    assert len(starts) == 299
    across = np.mean(noise[starts] * noise[starts - 1], axis=0) / np.var(noise, axis=0)
    np.testing.assert_allclose(across, 0.9, atol=0.3)
    # The lengths are white as before.
    lengths = measured.lengths - twin.lengths
    along = np.mean(lengths[1:] * lengths[:-1], axis=0) / np.var(lengths, axis=0)
    assert np.all(np.abs(along) < 5 / np.sqrt(len(lengths)))
    assert twin.truth.force_spectrum == {"ar": ((0.9,),) * 6, "band": (), "hum": ()}
    assert twin.truth.length_spectrum is None


def test_a_line_of_the_spectrum_is_a_sinusoid_of_its_size():
    """Its phases are drawn; amplitudes are those stated, in every record."""
    amplitudes = np.array([[5.0, 4, 3, 2, 1, 0], [1.0, 1, 1, 1, 1, 1]])
    frequencies, count = np.array([50.0, 110.0]), 400
    noise = source((Hum.of(frequencies, amplitudes),), count)
    times = np.arange(count) / SAMPLING
    angles = 2 * np.pi * np.multiply.outer(times, frequencies)
    basis = np.concatenate([np.sin(angles), np.cos(angles)], axis=1)
    for seed in (1, 2):
        drawn = noise.draw(np.random.default_rng(seed))
        found, *_ = np.linalg.lstsq(basis, drawn, rcond=None)
        np.testing.assert_allclose(drawn, basis @ found, atol=1e-9)
        np.testing.assert_allclose(np.hypot(found[:2], found[2:]), amplitudes, atol=1e-9)


def test_a_narrow_band_has_its_variance_in_a_short_record():
    """Lines as far apart as the record's length resolves may miss it: the series is longer."""
    band = Band(COVARIANCE, 30.07, 0.05)
    noise = source((band,), 500)
    rng = np.random.default_rng(3)
    power = np.mean([np.mean(noise.draw(rng) ** 2, axis=0) for _ in range(120)], axis=0)
    # Each record has about two degrees of freedom.
    np.testing.assert_allclose(power / np.diag(COVARIANCE), 1, atol=5 / np.sqrt(120))


def test_draws_do_not_depend_on_what_is_kept(monkeypatch):
    noise = source(SPECTRA["autoregressive"], 300)
    kept = noise.draw(np.random.default_rng(7))
    monkeypatch.setattr("estimation.twin.disturbances._MOST_KEPT", 0)
    monkeypatch.setattr("estimation.twin.disturbances._BLOCK", 64)
    again = source(SPECTRA["autoregressive"], 300).draw(np.random.default_rng(7))
    np.testing.assert_allclose(again, kept, atol=1e-12)


def test_white_noise_is_drawn_as_ever():
    noise = NoiseSource(COVARIANCE, None, 50, SAMPLING)
    np.testing.assert_array_equal(
        noise.draw(np.random.default_rng(5)),
        draw_noise(COVARIANCE, 50, np.random.default_rng(5)),
    )
