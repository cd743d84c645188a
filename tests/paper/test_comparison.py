import numpy as np
import pytest
from scipy import stats

from examples.paper.comparison import compare_determinants, mean_difference


def draws(rng, covariance, count):
    return rng.normal(size=(count, len(covariance))) @ np.linalg.cholesky(covariance).T


def covariance(rng, size):
    factor = rng.normal(size=(size, size))
    return factor @ factor.T + 0.1 * np.eye(size)


def test_the_difference_is_unbiased_and_its_error_is_the_spread():
    """Wishart: 400 pairs of 60 estimates of 8 parameters."""
    rng = np.random.default_rng(5)
    one, two = covariance(rng, 8), covariance(rng, 8)
    true = np.linalg.slogdet(two)[1] - np.linalg.slogdet(one)[1]
    found = [
        compare_determinants(draws(rng, one, 60), draws(rng, two, 60), np.ones(8))
        for _ in range(400)
    ]
    off = np.array([f.difference - true for f in found])
    error = found[0].std_error
    assert abs(off.mean()) < 4 * error / 20
    # The standard deviation of 400 draws is known to 3.5 %.
    assert off.std() / error == pytest.approx(1, abs=0.14)
    level = np.array([f.log_det_first for f in found]) - np.linalg.slogdet(one)[1]
    assert abs(level.mean()) < 4 * level.std() / 20


def test_units_shift_both_and_change_no_difference():
    rng = np.random.default_rng(6)
    one, two = rng.normal(size=(40, 5)), 2 * rng.normal(size=(40, 5))
    plain = compare_determinants(one, two, np.ones(5))
    scaled = compare_determinants(one, two, np.array([1.0, 10.0, 1e-3, 5.0, 7.0]))
    assert scaled.difference == pytest.approx(plain.difference, abs=1e-9)
    assert scaled.difference == pytest.approx(plain.difference)
    assert scaled.std_error == pytest.approx(plain.std_error)


def test_as_the_issue_states_it_is_about_one_at_a_hundred_repetitions_of_24():
    rng = np.random.default_rng(7)
    found = compare_determinants(
        rng.normal(size=(100, 24)), rng.normal(size=(100, 24)), np.ones(24)
    )
    assert 0.9 < found.std_error < 1.15


def test_too_few_estimates_are_refused():
    with pytest.raises(ValueError, match="more than 5"):
        compare_determinants(np.zeros((5, 5)), np.zeros((9, 5)), np.ones(5))


def test_each_parameter_is_welchs_test():
    rng = np.random.default_rng(1)
    one, two = rng.normal(size=(30, 3)), rng.normal(0.3, 2.0, size=(50, 3))
    found = mean_difference(one, two)
    plain = stats.ttest_ind(two, one, equal_var=False)
    np.testing.assert_allclose(found.z, plain.statistic, rtol=1e-12)
    smallest = np.argmin(plain.pvalue)
    assert found.p_values[smallest] == pytest.approx(3 * plain.pvalue[smallest], rel=1e-9)


def test_the_joint_test_keeps_its_level_with_unlike_covariances():
    """600 pairs without a difference: 5 % are called different; six parameters of 20 and 40."""
    rng = np.random.default_rng(2)
    factor = rng.normal(size=(6, 6))
    p = [
        mean_difference(rng.normal(size=(20, 6)), rng.normal(size=(40, 6)) @ factor).p_joint
        for _ in range(600)
    ]
    # One standard error of the share is 0.9 %.
    assert abs(np.mean(np.array(p) < 0.05) - 0.05) < 0.032


def test_a_difference_along_a_correlated_direction_is_seen_jointly():
    rng = np.random.default_rng(3)
    close = np.array([[1.0, 0.999], [0.999, 1.0]])
    factor = np.linalg.cholesky(close).T
    one = rng.normal(size=(80, 2)) @ factor
    two = rng.normal(size=(80, 2)) @ factor + [0.06, -0.06]
    found = mean_difference(one, two)
    assert np.all(found.p_values > 0.05)
    assert found.p_joint < 1e-6
