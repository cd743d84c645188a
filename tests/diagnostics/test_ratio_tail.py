import numpy as np
import pytest
from scipy import stats

from estimation.diagnostics.significance import ratio_tail, trace_as_f
from expdesign.mechanism.hexapod import ACTUATORS


@pytest.mark.parametrize("freedom", [600.0, np.inf])
@pytest.mark.parametrize("level", [0.9, 0.5, 0.05, 1e-3, 1e-8])
def test_equal_weights_give_f_and_chi_square(level, freedom):
    count = 115
    if np.isfinite(freedom):
        value = count * stats.f.isf(level, count, freedom)
    else:
        value = stats.chi2.isf(level, count)
    assert ratio_tail(value, np.ones(count), freedom) == pytest.approx(level, rel=0.01)


@pytest.mark.parametrize("weights", [[30.0, 10.0] + [1.0] * 60, [100.0] + [1.0] * 20 + [0.0] * 5])
def test_unequal_weights_against_draws(weights):
    rng = np.random.default_rng(1)
    weights, draws = np.array(weights), 200_000
    total = rng.chisquare(1, (draws, len(weights))) @ weights / (rng.chisquare(90, draws) / 90)
    for level in (0.1, 0.01, 0.001):
        value = float(np.quantile(total, 1 - level))
        assert ratio_tail(value, weights, 90.0) == pytest.approx(
            level, rel=0.03 + 3.5e-3 / level**0.5
        )


def test_no_jump_at_the_mean():
    shares = np.linspace(-0.01, 0.01, 41)
    around = [ratio_tail(60.0 * (1 + d), np.ones(60), 500.0) for d in shares]
    steps = np.diff(around)
    assert np.all(steps < 0)
    assert steps.min() == pytest.approx(steps.max(), rel=0.2)


def test_far_tail_does_not_break():
    assert ratio_tail(1e6, np.ones(1600), 15000.0) < 1e-300
    assert ratio_tail(1.0, np.ones(1600), 15000.0) == pytest.approx(1.0)


@pytest.mark.parametrize(("freedom", "rows"), [(250, 31), (60, 13), (2000, 61)])
def test_a_sum_weighted_with_an_estimated_covariance_keeps_its_level(freedom, rows):
    """Six channels: F with the freedom of one of them would reject 5 % in 0.2 to 3.5 % of cases."""
    rng, count = np.random.default_rng(1), 4000
    scale = np.eye(ACTUATORS) / freedom
    estimated = stats.wishart.rvs(freedom, scale, size=count, random_state=rng)
    values = rng.standard_normal((count, rows, ACTUATORS))
    squares = np.einsum("nri,nrj->nij", values, values)
    sums = np.trace(np.linalg.solve(estimated, squares), axis1=1, axis2=2)
    p = [stats.f.sf(*trace_as_f(each, rows * ACTUATORS, freedom)) for each in sums]
    assert np.mean(np.array(p) < 0.05) == pytest.approx(0.05, abs=0.011)
