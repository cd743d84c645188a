"""The noise has the covariances that are asked for, within the scatter of their estimates."""

import numpy as np
import pytest
from scipy import stats

from estimation.twin.disturbances import draw_noise, noise_covariances
from expdesign.configuration import InputError, load_run
from tests.twin.examples import configuration

SAMPLES = 60_000
LEVEL = 1e-4
NOISE = configuration()


@pytest.fixture(scope="module")
def noise():
    return dict(zip(("forces", "lengths"), noise_covariances(NOISE), strict=True))


def draws(noise, kind, seed=5):
    return noise[kind], draw_noise(noise[kind], SAMPLES, np.random.default_rng(seed))


@pytest.mark.parametrize("kind", ["forces", "lengths"])
def test_every_variance_lies_within_its_chi_square_bounds(noise, kind):
    covariance, values = draws(noise, kind)
    low, high = stats.chi2.ppf([LEVEL / 2, 1 - LEVEL / 2], SAMPLES) / SAMPLES
    ratios = np.mean(values**2, axis=0) / np.diag(covariance)
    assert np.all((ratios > low) & (ratios < high))


@pytest.mark.parametrize("kind", ["forces", "lengths"])
def test_the_whole_covariance_is_that_asked_for(noise, kind):
    """Likelihood-ratio test of Σ = Σ0, mean known: N (tr E − log det E − 6) ~ χ²(21)."""
    covariance, values = draws(noise, kind)
    ratio = np.linalg.solve(covariance, values.T @ values / SAMPLES)
    statistic = SAMPLES * (np.trace(ratio) - np.linalg.slogdet(ratio)[1] - 6)
    assert stats.chi2.ppf(LEVEL / 2, 21) < statistic < stats.chi2.ppf(1 - LEVEL / 2, 21)
    # What the test is worth: without the correlations it would fail by far.
    plain = values / np.sqrt(np.diag(covariance))
    ratio = plain.T @ plain / SAMPLES
    assert SAMPLES * (np.trace(ratio) - np.linalg.slogdet(ratio)[1] - 6) > 1000


@pytest.mark.parametrize("kind", ["forces", "lengths"])
def test_samples_are_normal_and_independent_of_each_other(noise, kind):
    covariance, values = draws(noise, kind)
    white = np.linalg.solve(np.linalg.cholesky(covariance), values.T)
    assert stats.kstest(white.ravel(), "norm").pvalue > LEVEL
    following = np.sum(white[:, 1:] * white[:, :-1], axis=1) / SAMPLES
    assert np.all(np.abs(following) < stats.norm.isf(LEVEL / 12) / np.sqrt(SAMPLES))


@pytest.mark.parametrize(
    ("missing", "named"),
    [
        (("force",), ["force"]),
        (("length",), ["length"]),
        (("force", "length"), ["force", "length"]),
    ],
)
def test_noise_that_is_not_given_is_asked_for(missing, named):
    run = load_run({"name": "n", "robot": "palida"})
    robot = run.run.robot.model_dump(exclude={"noise"})
    noise = {f"{what}_std": [1e-3] * 6 for what in {"force", "length"} - set(missing)}
    bare = load_run({"name": "n", "robot": robot, **({"noise": noise} if noise else {})})
    with pytest.raises(InputError) as caught:
        noise_covariances(bare)
    assert [problem.key for problem in caught.value.problems] == ["noise"] * len(named)
    for problem, what in zip(caught.value.problems, named, strict=True):
        assert f"{what}_std" in problem.allowed
