"""Designs and predicted standard deviations under noise that is not white."""

from dataclasses import replace

import numpy as np
import pytest

import expdesign
from expdesign.configuration import load_run
from expdesign.experiment import DesignResult
from expdesign.experiment.design import _warnings
from expdesign.experiment.setup import plan_search
from tests.experiment.test_design import regressors_of, std_of

RHO = 0.9
HUM = 30.0
"""Hz; the period that the search finds, 167 steps of 10 ms, has 50.1 turns of it."""


@pytest.fixture(scope="module")
def coloured(tiny, few_limits, cheaper):
    noise = {"force_spectrum": {"ar": RHO, "hum": {"frequency": HUM, "amplitude": 0}}}
    with cheaper():
        return expdesign.design(tiny(robot=few_limits, noise=noise, design={"max_iterations": 3}))


def test_predicted_std_is_that_of_filtered_samples(coloured):
    """An autoregressive filter makes the noise of the whole experiment white."""
    count, periods = round(coloured.trajectory.period * 100), 3
    series = np.tile(regressors_of(coloured, count), (periods, 1, 1))
    covariance = coloured.configuration.robot.noise.force_covariance
    white = series.copy()
    white[1:] = (series[1:] - RHO * series[:-1]) / np.sqrt(1 - RHO**2)
    half = np.linalg.solve(np.linalg.cholesky(covariance), white)
    flat = half.reshape(-1, half.shape[2])
    found = [coloured.experiment.std[name] for name in coloured.parameter_names]
    # The first sample alone is counted otherwise: one of some hundred.
    np.testing.assert_allclose(found, std_of(flat.T @ flat), rtol=0.05)


def test_the_frequency_keeps_away_from_the_hum(coloured, tmp_path):
    (one,) = coloured.hum
    turns = HUM * coloured.trajectory.period
    assert one.lines == pytest.approx(3 * abs(turns - round(turns)), abs=1e-6)
    assert one.lines >= 1 - 1e-9
    assert not any("hum" in warning for warning in coloured.warnings)
    coloured.write(tmp_path)
    assert DesignResult.read(tmp_path).hum == coloured.hum


def test_a_fixed_frequency_at_a_hum_is_a_warning(tiny, coloured):
    noise = {"force_spectrum": {"hum": {"frequency": 20.0, "amplitude": "1 N"}}}
    run = load_run(tiny(noise=noise, trajectory={"frequency": [0.4, 0.4]}))
    at_hum = replace(coloured.trajectory, omega=2 * np.pi * 0.4)
    (warning,) = (w for w in _warnings(run, at_hum, plan_search(run)) if "hum" in w)
    assert "multiple 50" in warning
