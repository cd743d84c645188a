"""Information under coloured noise: against generalised least squares with the whole covariance."""

import numpy as np
import pytest
import scipy.linalg as sla

from expdesign.information.fisher import PeriodicNoise, information_matrix
from expdesign.noise import Autoregressive, Hum, NoiseSpectrum, Tabulated

SAMPLING, PERIOD = 200.0, 60
OMEGA = 2 * np.pi * SAMPLING / PERIOD
RING = np.array([[0.5 ** min(abs(i - j), 6 - abs(i - j)) for j in range(6)] for i in range(6)])


def _regressors(samples=PERIOD, harmonics=7):
    """Smooth columns, (samples, 6, 4): every number of samples shows the same functions."""
    rng = np.random.default_rng(2)
    phases = 2 * np.pi * np.arange(samples)[:, None] * np.arange(harmonics + 1) / samples
    rows = np.concatenate([np.cos(phases), np.sin(phases)], axis=1)
    return np.einsum("nh,hqk->nqk", rows, rng.normal(size=(2 * harmonics + 2, 6, 4)))


def _noise(part, periods=1.0):
    return PeriodicNoise(NoiseSpectrum((part,)), SAMPLING, periods)


def _gls(regressors, whole):
    """Return Aᵀ R⁻¹ A with the covariance of all samples, (6 T, 6 T)."""
    flat = np.tile(regressors, (len(whole) // 6 // len(regressors), 1, 1)).reshape(len(whole), -1)
    return flat.T @ sla.cho_solve(sla.cho_factor(whole), flat)


def test_white_noise_has_the_information_of_every_sample():
    noise = _noise(Autoregressive.with_covariance(np.zeros((6, 0)), RING))
    for samples in (60, 61):
        regressors = _regressors(samples)
        np.testing.assert_allclose(
            noise.information(regressors, OMEGA), information_matrix(regressors, RING), rtol=1e-11
        )


@pytest.mark.parametrize("rho", [0.5, 0.9])
def test_autoregressive_noise_against_its_whole_covariance(rho):
    noise = _noise(Autoregressive.with_covariance(np.full((6, 1), rho), RING))
    periods = 3
    whole = np.kron(sla.toeplitz(rho ** np.arange(periods * PERIOD)), RING)
    found, expected = noise.information(_regressors(), OMEGA), _gls(_regressors(), whole) / periods
    # The record's ends: noise that remembers 1/(1 − ρ) samples of them all.
    atol = 3 / (1 - rho) / (periods * PERIOD)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        found / np.outer(scale, scale), expected / np.outer(scale, scale), rtol=0, atol=atol
    )
    # It is another information altogether than that of white noise of the same size.
    white = information_matrix(_regressors(), RING)
    assert np.max(np.abs(np.diag(white) / np.diag(expected) - 1)) > 2 * atol


def test_a_hum_on_a_line_costs_what_it_does_and_less_beside_it():
    base = Autoregressive.with_covariance(np.zeros((6, 0)), RING)
    periods, lost = 6, []
    white = _log_det(information_matrix(_regressors(), RING))
    for away in (0.0, 1.0, 2.0, 60.0):
        frequency = (3 + away / periods) * SAMPLING / PERIOD
        hum = Hum.of(np.array([frequency]), np.full((1, 6), 0.5))
        noise = PeriodicNoise(NoiseSpectrum((base, hum)), SAMPLING, periods)
        lost.append(white - _log_det(noise.information(_regressors(), OMEGA)))
    assert np.all(np.diff(lost) < 0)
    assert lost[-1] < 0.03 * lost[0]
    # On the line the phase is that of every period. The whole covariance of a sinusoid that keeps
    # its frequency exactly takes nothing from the other lines; a hum that does not, a little.
    lags = np.arange(periods * PERIOD)
    turns = sla.toeplitz(np.cos(2 * np.pi * 3 * lags / PERIOD) * 0.125)
    whole = np.kron(np.eye(len(lags)), RING) + np.kron(turns, np.eye(6))
    expected = white - _log_det(_gls(_regressors(), whole) / periods)
    assert expected < lost[0] < 1.6 * expected


def _log_det(matrix):
    return float(np.linalg.slogdet(matrix)[1])


def test_spread_of_unweighted_sums_against_the_whole_covariance():
    periods, rho = 3, 0.8
    noise = _noise(Autoregressive.with_covariance(np.full((6, 1), rho), RING))
    whole = np.kron(sla.toeplitz(rho ** np.arange(periods * PERIOD)), RING)
    flat = np.tile(_regressors(), (periods, 1, 1)).reshape(len(whole), -1)
    expected = flat.T @ whole @ flat / periods
    scale = np.sqrt(np.diag(expected))
    found = noise.spread(_regressors(), OMEGA) / np.outer(scale, scale)
    atol = 3 / (1 - rho) / (periods * PERIOD)
    np.testing.assert_allclose(found, expected / np.outer(scale, scale), rtol=0, atol=atol)


def test_information_per_sample_does_not_depend_on_the_grid():
    noise = _noise(Autoregressive.with_covariance(np.full((6, 1), 0.8), RING))
    coarse, fine = (noise.information(_regressors(n), OMEGA) / n for n in (20, 600))
    np.testing.assert_allclose(coarse, fine, rtol=1e-10, atol=1e-12)


def test_weighted_columns_make_the_information():
    rng = np.random.default_rng(4)
    z = (
        rng.normal(size=(3, 6, 9))
        + 1j * rng.normal(size=(3, 6, 9)) * np.array([0, 1, 0])[:, None, None]
    )
    density = z @ z.conj().transpose(0, 2, 1)
    noise = _noise(Tabulated(np.array([0.0, 30.0, 100.0]), density))
    for samples in (PERIOD, PERIOD + 1):
        regressors = _regressors(samples)
        weighted = noise.weighted(regressors, OMEGA)
        np.testing.assert_allclose(
            np.einsum("nqi,nqj->ij", regressors, weighted),
            noise.information(regressors, OMEGA),
            rtol=1e-10,
            atol=1e-9,
        )


def test_the_frequency_moves_the_lines_over_the_spectrum():
    parts = (
        Autoregressive.with_covariance(np.full((6, 1), 0.8), RING),
        Hum.of(np.array([9.0]), np.full((1, 6), 0.5)),
    )
    noise, regressors = PeriodicNoise(NoiseSpectrum(parts), SAMPLING, 5.0), _regressors()
    slope = noise.slope(noise.weighted(regressors, OMEGA), OMEGA)
    ahead, behind = (noise.information(regressors, OMEGA + d) for d in (1e-5, -1e-5))
    np.testing.assert_allclose(slope, (ahead - behind) / 2e-5, rtol=1e-6, atol=1e-6)
