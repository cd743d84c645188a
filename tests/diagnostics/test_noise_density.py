"""The spectrum of a recording's noise, and the search for a hum in it."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2, norm

from estimation.diagnostics.finding import FindingOutcome
from estimation.diagnostics.noise_analysis import hum_finding
from estimation.diagnostics.noise_result import NoiseDensity, noise_density
from estimation.processing.hum import HumSearch, find_hum
from estimation.processing.periodic_recording import Channels
from expdesign.configuration import load_run
from expdesign.configuration.noise import read_spectrum_table
from expdesign.runfolder import ArrayTable

STEP, PERIODS, SAMPLES = 2e-3, 8, 497
SIZE = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
RHO = 0.8
KNOWN = 1e9
"""Degrees of freedom of a spectrum that is known."""


def _noise(rng, rho=RHO, samples=SAMPLES):
    innovations = rng.normal(size=(PERIODS * samples + 200, 6)) * np.sqrt(1 - rho**2)
    return (lfilter([1.0], [1.0, -rho], innovations, axis=0)[200:]) * SIZE


def _channels(noise):
    samples = len(noise) // PERIODS
    motion = 100 * np.sin(2 * np.pi * np.arange(samples) / samples)
    periods = noise.reshape(PERIODS, samples, 6) + motion[:, None]
    times = STEP * np.arange(samples)
    return Channels(times, periods.mean(axis=0), np.full(samples, PERIODS), None, periods)


def _hum(frequency, amplitude, samples=SAMPLES):
    time = STEP * np.arange(PERIODS * samples)
    return amplitude * np.cos(2 * np.pi * frequency * time[:, None] + np.arange(6.0))


def test_density_of_autoregressive_noise_and_its_band():
    rng = np.random.default_rng(0)
    inside, densities, widths = [], [], []
    for _ in range(8):
        found, hum = noise_density(_channels(_noise(rng)), STEP)
        frequencies = np.linspace(10, 245, 60)
        turns = np.exp(-2j * np.pi * frequencies * STEP)
        expected = np.multiply.outer(
            2 * STEP * (1 - RHO**2) / np.abs(1 - RHO * turns) ** 2, SIZE**2
        )
        low, density, high = (
            np.stack([np.interp(frequencies, found.frequency, c) for c in values.T], axis=1)
            for values in (found.band()[0], found.density, found.band()[1])
        )
        inside.append(np.mean((low <= expected) & (expected <= high)))
        densities.append(np.log(density))
        widths.append(np.log(high / low) / (2 * norm.isf(0.025)))
        np.testing.assert_allclose(found.white * found.frequency[-1], SIZE**2, rtol=0.25)
        assert not hum.lines
    # The band is that of the smoothed density: what is levelled out comes on top.
    assert np.mean(inside) > 0.7
    scatter = np.sqrt(np.mean(np.var(densities, axis=0, ddof=1)))
    assert 0.7 < scatter / np.mean(widths) < 1.1


def test_white_noise_is_flat():
    found, _ = noise_density(_channels(_noise(np.random.default_rng(1), rho=0.0)), STEP)
    np.testing.assert_allclose(found.density, np.tile(found.white, (len(found.density), 1)))
    np.testing.assert_allclose(found.white, 2 * STEP * SIZE**2, rtol=0.1)


@pytest.mark.parametrize("frequency", [50.02, 100.05])
def test_a_hum_is_found_with_its_amplitude(frequency):
    noise = _noise(np.random.default_rng(2)) + _hum(frequency, SIZE)
    found, hum = noise_density(_channels(noise), STEP)
    (line,) = hum.lines
    assert line.frequency == pytest.approx(frequency, abs=0.5 / (PERIODS * SAMPLES * STEP))
    np.testing.assert_allclose(line.amplitudes, SIZE, rtol=0.15)
    row = int(np.argmin(np.abs(found.frequency - line.frequency)))
    np.testing.assert_allclose(found.amplitude[row], line.amplitudes, rtol=1e-5)
    # It is no part of the density beside it.
    turn = np.exp(-2j * np.pi * frequency * STEP)
    expected = 2 * STEP * (1 - RHO**2) / np.abs(1 - RHO * turn) ** 2 * SIZE**2
    np.testing.assert_allclose(found.density[row], expected, rtol=0.35)
    assert hum_finding({"force": hum, "length": None}).failed


def test_a_hum_that_repeats_in_every_period_is_not_seen_and_said_so():
    noise = _noise(np.random.default_rng(3), samples=500) + _hum(50.0, 10 * SIZE, 500)
    _, hum = noise_density(_channels(noise), STEP)
    assert not hum.lines
    assert 50.0 in hum.hidden
    found = hum_finding({"force": hum})
    assert found.outcome is FindingOutcome.NOT_TESTED
    assert "50" in found.sentence


@pytest.mark.parametrize(
    ("hidden", "outcome"),
    [
        ((), FindingOutcome.HOLDS),
        ((60.0, 120.0), FindingOutcome.NOT_TESTED),
        ((150.0,), FindingOutcome.HOLDS),
    ],
)
def test_no_hum_where_the_mains_cannot_be_seen_is_no_finding(hidden, outcome):
    found = hum_finding({"force": HumSearch((), hidden, 0.6)})
    assert found.outcome is outcome
    assert all(f"{frequency:g}" in found.sentence for frequency in hidden)


def test_a_hum_is_seldom_found_where_there_is_none():
    rng, alarms = np.random.default_rng(4), 0
    spectrum = np.broadcast_to(np.diag(SIZE**2), (SAMPLES // 2 + 1, 6, 6)).astype(complex)
    for _ in range(40):
        noise = rng.normal(size=(PERIODS, SAMPLES, 6)) * SIZE
        alarms += bool(find_hum(noise, STEP, spectrum, KNOWN).lines)
    assert alarms <= 2  # 0.04 expected


def test_significance_of_a_hum_is_that_of_its_power():
    samples = 505  # 50.5 turns of 50 Hz: the mean over two periods has none of them
    spectrum = np.broadcast_to(np.diag(SIZE**2), (samples // 2 + 1, 6, 6)).astype(complex)

    def significance(power):
        hum = _hum(50.0, SIZE * np.sqrt(4 * power / (PERIODS * samples)), samples)
        return find_hum(hum.reshape(PERIODS, samples, 6), STEP, spectrum, KNOWN).p

    smaller, larger = 5.5, 7.7
    expected = np.divide(*chi2.sf([12 * larger, 12 * smaller], 12))
    assert significance(larger) / significance(smaller) == pytest.approx(expected, rel=0.02)


def test_no_hum_is_significant_where_the_sampling_shows_none():
    periods = np.random.default_rng(6).normal(size=(PERIODS, 40, 6))
    found = find_hum(periods, 1 / 80, np.broadcast_to(np.eye(6) + 0j, (21, 6, 6)), KNOWN)
    assert (found.lines, found.p) == ((), 1.0)


def test_the_table_is_a_spectrum_that_a_run_takes(tmp_path):
    noise = _noise(np.random.default_rng(5)) + _hum(49.96, SIZE)
    found, _ = noise_density(_channels(noise), STEP)
    table = ArrayTable("spectrum.csv", "a test", NoiseDensity)
    table.write(tmp_path, found)
    again = table.read(tmp_path)
    np.testing.assert_array_equal(again.density, found.density)
    read = read_spectrum_table(tmp_path / "spectrum.csv")
    np.testing.assert_allclose(read.density, found.density, rtol=1e-12)
    run = {
        "name": "n",
        "robot": "palida",
        "experiment": {"sampling": 1 / STEP},
        "noise": {"force_spectrum": str(tmp_path / "spectrum.csv")},
    }
    spectrum = load_run(run).robot.noise.force_spectrum
    measured = np.diag(np.cov(noise.T))
    np.testing.assert_allclose(np.diag(spectrum.covariance), measured, rtol=0.1)
    near = spectrum.at(np.array([3.0, 40.0]), 1 / STEP, PERIODS * SAMPLES)
    turns = np.exp(-2j * np.pi * np.array([3.0, 40.0]) * STEP)
    expected = np.multiply.outer((1 - RHO**2) / np.abs(1 - RHO * turns) ** 2, SIZE**2)
    np.testing.assert_allclose(np.einsum("kii->ki", near).real, expected, rtol=0.4)


def test_without_periods_to_compare_there_is_no_spectrum():
    single = Channels(np.arange(9.0), np.zeros((9, 6)), np.ones(9), None, None)
    found, hum = noise_density(single, STEP)
    assert hum is None
    assert len(found.frequency) == 0
    assert hum_finding({"force": hum, "length": hum}).p is None
