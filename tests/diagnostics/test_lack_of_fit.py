import copy
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from estimation.diagnostics.linearisation import PhaseCells
from estimation.diagnostics.residuals import lack_of_fit

KINDS = ("ls", "gm", "ml", "held out")
DRAWS = 250


def test_shares_are_the_trace_of_the_hat_matrix(twin):
    """ν_j: trace of actuator j's part of U J⁻¹ Uᵀ W over parameters and motion."""
    drawn = twin.draw(np.random.default_rng(0), "ml")
    test = lack_of_fit(drawn, twin.law("ml"))
    sigma, delta = twin.lab.noise.forces.covariance, twin.lab.noise.lengths.covariance
    white = twin.system(drawn).force_rows.white  # Σ with the loss due to its estimation
    forces, lengths = 2.0 * twin.part.columns, 2.0 * twin.part.length_columns  # of four periods
    k = twin.part.regressors.shape[2]
    lengths = np.pad(lengths, ((0, 0), (0, 0), (k, 0)))
    rows = [part.reshape(-1, part.shape[2]) for part in (forces, lengths)]
    weights = [
        np.kron(np.eye(len(part)), inverse)
        for part, inverse in ((forces, white.T @ white), (lengths, np.linalg.inv(delta)))
    ]
    information = sum(u.T @ w @ u for u, w in zip(rows, weights, strict=True))
    hat = rows[0] @ np.linalg.solve(information, rows[0].T)
    shares = [np.trace(hat[j::6, j::6]) / sigma[j, j] for j in range(6)]
    np.testing.assert_allclose(test.fitted_freedom, shares, rtol=1e-6)


def test_statistic_is_the_formula(twin):
    drawn = twin.draw(np.random.default_rng(1), "gm")
    test = lack_of_fit(drawn, twin.law("gm"))
    expected = 4 * np.sum(drawn.forces**2, axis=0) / (len(drawn.forces) - test.fitted_freedom)
    np.testing.assert_allclose(test.mean_square, expected, rtol=1e-12)
    np.testing.assert_allclose(test.added_variance, 0, atol=1e-12)
    np.testing.assert_allclose(
        test.statistic, expected / np.diag(drawn.force_scatter.covariance), rtol=1e-12
    )
    assert test.pure_error_freedom == 3 * len(drawn.forces)


def test_held_out_data_have_no_fitted_freedom_and_more_variance(twin):
    test = lack_of_fit(twin.draw(np.random.default_rng(2), "held out"), twin.law("held out"))
    np.testing.assert_array_equal(test.fitted_freedom, 0)
    assert np.all(test.added_variance > 0)


@pytest.mark.parametrize("kind", KINDS)
def test_law_is_the_covariance_of_the_residuals(twin, kind):
    rng = np.random.default_rng(3)
    law = twin.law(kind)
    drawn = np.array([twin.draw(rng, kind).forces for _ in range(DRAWS)]) * 2.0
    variance = np.diag(twin.lab.noise.forces.covariance)
    for j in range(6):
        weights = law.weights(j)
        trace, square = np.sum(weights), np.sum(weights**2)
        sums = np.sum(drawn[:, :, j] ** 2, axis=1) / variance[j]
        # The mean of Σ e² and its variance are those of the law.
        assert abs(sums.mean() - trace) < 4 * np.sqrt(2 * square / DRAWS)
        assert sums.var() == pytest.approx(2 * square, rel=0.35)
        ahead = np.sum(drawn[:, :-1, j] * drawn[:, 1:, j], axis=1) / variance[j]
        assert abs(ahead.mean() - law.lagged_covariance(j, 1)) < 4 * ahead.std() / np.sqrt(DRAWS)


@pytest.mark.parametrize("kind", KINDS)
def test_level(twin, kind):
    rng = np.random.default_rng(14)
    law = twin.law(kind)
    tests = [lack_of_fit(twin.draw(rng, kind), law, level=0.05) for _ in range(DRAWS)]
    rejected = sum(bool(np.any(test.failed)) for test in tests)
    assert stats.binom.cdf(rejected, DRAWS, 0.05) > 0.002
    assert stats.binom.sf(rejected - 1, DRAWS, 0.05) > 0.002
    pooled = np.mean([test.p_values < 0.1 for test in tests])
    assert pooled == pytest.approx(0.1, abs=0.025)


def test_level_with_badly_known_parameters(twin):
    """What Cov(p̂) adds: without it a sound prediction fails, with it the level holds."""
    poor = copy.copy(twin)
    gm = twin.estimates["gm"]
    poor.estimates = twin.estimates | {"gm": replace(gm, covariance=30 * gm.covariance)}
    rng = np.random.default_rng(5)
    held = [poor.draw(rng, "held out") for _ in range(DRAWS)]
    rejected = [
        sum(bool(np.any(lack_of_fit(d, law, level=0.05).failed)) for d in held)
        for law in (poor.law("held out"), twin.law("gm"))
    ]
    assert stats.binom.cdf(rejected[0], DRAWS, 0.05) > 0.002
    assert stats.binom.sf(rejected[0] - 1, DRAWS, 0.05) > 0.002
    assert rejected[1] > 0.5 * DRAWS


def test_a_bias_is_found_in_its_actuator(twin):
    rng = np.random.default_rng(6)
    drawn = twin.draw(rng, "held out")
    forces = drawn.forces.copy()
    forces[:, 2] += 20 * np.sin(np.arange(len(forces)))
    test = lack_of_fit(replace(drawn, forces=forces), twin.law("held out"))
    assert np.flatnonzero(test.failed).tolist() == [2]


def test_refused_without_pure_error(twin):
    drawn = twin.draw(np.random.default_rng(7), "gm")
    alone = lack_of_fit(replace(drawn, force_scatter=None), twin.law("gm"))
    assert "second period" in alone.refused
    assert not np.any(alone.failed)
    law = twin.law("gm")
    own = replace(law, noise=replace(law.noise, source="residuals"))
    circular = lack_of_fit(drawn, own)
    assert "includes the error of the model" in circular.refused
    assert np.all(np.isnan(circular.statistic))


def test_cells_gather_equal_phases():
    step, period = 0.01, 0.4567
    times = np.arange(500) * step
    rng = np.random.default_rng(8)
    weights = rng.uniform(0.5, 1, 500)
    cells = PhaseCells.of(times, weights, period, step)
    assert len(cells.totals) == 46
    assert cells.totals.sum() == pytest.approx(weights.sum())
    values = rng.standard_normal((500, 6))
    means = cells.mean(values)
    rows = cells.index == 7
    np.testing.assert_allclose(means[7], np.average(values[rows], axis=0, weights=weights[rows]))
    phases = np.mod(times[rows] / period, 1)
    assert np.ptp(phases) <= step / period
    scatter = cells.scatter(values)
    np.testing.assert_allclose(np.diag(scatter.covariance), 1, atol=0.25)
    assert scatter.freedom == pytest.approx((weights**2).sum() - 46)


def test_level_of_records_that_cannot_be_averaged(laboratory):
    """Whole pipeline with 200.37 samples per period: no actuator is blamed."""
    data = laboratory.measure(9, samples=200.37)
    experiment = laboratory.experiment(data)
    assert not experiment.recording.averaged
    from estimation.diagnostics.diagnosis import diagnose

    estimate = laboratory.estimate([experiment])
    result = diagnose(laboratory.robot, [experiment], laboratory.knowledge, estimate)
    test = result.recordings[0].tests.lack_of_fit
    assert not test.refused
    assert not np.any(test.failed)
    assert test.pure_error_freedom == pytest.approx(len(data) - test.samples, abs=1)
    np.testing.assert_allclose(
        test.pure_error, np.diag(laboratory.noise.forces.covariance), rtol=0.25
    )
