"""Tests of differences: their level by simulation, and what they must find."""

import numpy as np
import pytest
from scipy import stats

from estimation.uncertainty.intervals import (
    FAMILY_LEVEL,
    difference_test,
    holm,
)

SIZE = 6


@pytest.fixture(scope="module")
def covariance():
    root = np.random.default_rng(4).normal(size=(SIZE, SIZE)) * 10.0 ** np.arange(-3, 3)[:, None]
    return root @ root.T


def test_the_statistic_is_chi_square_and_the_family_keeps_its_level(covariance):
    rng = np.random.default_rng(8)
    root = np.linalg.cholesky(covariance)
    first, count = np.arange(SIZE, dtype=float), 2000
    tests = [
        difference_test(first, first + root @ rng.normal(size=SIZE), covariance)
        for _ in range(count)
    ]
    assert {test.freedom for test in tests} == {SIZE}
    statistics = [test.statistic for test in tests]
    assert stats.kstest(statistics, stats.chi2(SIZE).cdf).pvalue > 1e-3
    wrong = sum(bool(np.any(test.differs)) for test in tests)
    assert wrong <= stats.binom(count, FAMILY_LEVEL).ppf(0.9999)


def test_one_parameter_that_differs_is_named(covariance):
    shift = np.zeros(SIZE)
    shift[2] = 8 * np.sqrt(covariance[2, 2])
    test = difference_test(np.zeros(SIZE), shift, covariance)
    assert list(np.flatnonzero(test.differs)) == [2]
    assert test.z[2] == pytest.approx(8)
    assert test.differ_jointly


def test_what_does_not_vary_is_not_judged(covariance):
    fixed = covariance.copy()
    fixed[0], fixed[:, 0] = 0, 0
    test = difference_test(np.zeros(SIZE), np.ones(SIZE), fixed)
    assert np.isnan(test.z[0])
    assert np.isnan(test.p_values[0])
    assert not test.differs[0]
    assert test.freedom == SIZE - 1
    nothing = difference_test(np.zeros(2), np.ones(2), np.zeros((2, 2)))
    assert nothing.freedom == 0
    assert not nothing.differ_jointly
    assert np.isnan(nothing.p_joint)


def test_a_covariance_without_full_rank_counts_its_rank():
    column = np.array([[1.0], [2.0], [-1.0]])
    test = difference_test(np.zeros(3), 3 * column[:, 0], column @ column.T)
    assert test.freedom == 1
    assert test.statistic == pytest.approx(9)


@pytest.mark.parametrize("k", range(SIZE))
def test_estimates_from_the_same_data_may_differ_by_a_sixth(covariance, k):
    std, same = np.sqrt(np.diag(covariance)), np.zeros(SIZE)
    small, large = (share * std[k] * np.eye(SIZE)[k] for share in (0.15, 1.0))
    random = 1e-6 * covariance

    for_sure = difference_test(same, small, random)
    assert for_sure.differ_jointly
    assert for_sure.differs[k]
    tolerated = difference_test(same, small, random, covariance)
    assert tolerated.std == pytest.approx(std / 6, rel=0.05)
    assert tolerated.freedom == 0
    assert not tolerated.differs[k]
    assert difference_test(same, large, random, covariance).differs[k]


def test_hausman_of_errors_in_the_regressor():
    """A line through points whose abscissae are known, or noisy: only the latter is called."""
    rng = np.random.default_rng(1)
    x, noise = np.linspace(-1, 1, 400), 0.1
    robust_excess = np.array([[4e-5]])

    def efficient(abscissae, ordinates):
        return np.array([abscissae @ ordinates / (abscissae @ abscissae)])

    y = 2 * x + noise * rng.normal(size=x.size)
    truth = np.array([2.0]) + rng.normal() * 5e-3
    assert not difference_test(efficient(x, y), truth, robust_excess).differ_jointly
    disturbed = x + 0.3 * rng.normal(size=x.size)
    found = difference_test(efficient(disturbed, y), truth, robust_excess)
    assert found.differ_jointly
    assert found.difference[0] > 0


def test_holm_against_its_definition():
    p = np.array([0.01, 0.04, 0.03, 0.005])
    assert holm(p) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm(np.array([0.9, 0.8])) == pytest.approx([1.0, 1.0])
    assert holm(np.array([])).size == 0
