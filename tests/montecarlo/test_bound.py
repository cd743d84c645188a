"""The Cramér–Rao bound under noise with memory, against the covariance of all samples."""

import numpy as np
import pytest
from scipy.linalg import toeplitz

from estimation.montecarlo.study import Workbench
from tests.montecarlo.examples import DESIGN, small

PERIODS, SAMPLING = 8, 60
STD = np.array([20.0, 19, 30, 19, 23, 31])


def bound(**spectrum):
    """Return the bound's standard deviations where the motion is known as good as exactly."""
    noise = {"force_std": STD.tolist(), "length_std": [1e-9] * 6, **spectrum}
    experiment = {"periods": PERIODS, "sampling": SAMPLING}
    return Workbench.of(small(noise=noise, experiment=experiment), DESIGN).bound()


@pytest.mark.parametrize("ar", [0.5, [0.0, 0.8, -0.5, 0.0, 0.8, -0.5]])
def test_it_is_that_of_all_samples_and_their_covariance(ar):
    """Inverse of ΨᵀC⁻¹Ψ with the 2 880 × 2 880 covariance of every force at every sample."""
    correlation = {"force_correlation": np.eye(6).tolist()}
    found = bound(force_spectrum={"ar": ar}, **correlation)
    bench = Workbench.of(small(experiment={"periods": PERIODS, "sampling": SAMPLING}), DESIGN)
    regressors = bench.robot.regressor(*DESIGN.sample(bench.twin.grid.times))
    information = np.zeros((regressors.shape[2],) * 2)
    for j, rho in enumerate(np.broadcast_to(ar, 6)):
        series = STD[j] ** 2 * toeplitz(rho ** np.arange(len(regressors)))
        information += regressors[:, j].T @ np.linalg.solve(series, regressors[:, j])
    expected = np.sqrt(np.diag(np.linalg.inv(information)))
    # A record has two ends, which the lines of its periods do not know: one in 480 samples.
    np.testing.assert_allclose(np.sqrt(np.diag(found)), expected, rtol=0.02)
    white = np.sqrt(np.diag(bound(**correlation)))
    assert np.max(np.abs(white / expected - 1)) > 0.2


def test_white_noise_said_in_words_is_white():
    np.testing.assert_array_equal(bound(force_spectrum="white"), bound())
    np.testing.assert_allclose(bound(force_spectrum={"ar": 0}), bound(), rtol=1e-9)
