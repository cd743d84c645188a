import numpy as np
import pytest
from scipy import stats

from estimation.studies.mean_difference import mean_difference


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
