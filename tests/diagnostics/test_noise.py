from dataclasses import replace

import numpy as np
import pytest
from scipy import signal, stats

from estimation.diagnostics.finding import Assumption, FindingOutcome
from estimation.diagnostics.noise_analysis import analyse_noise
from estimation.diagnostics.noise_tests import drift, noise_tests, normality, whiteness
from estimation.diagnostics.residual_covariance import ResidualCovariance
from estimation.diagnostics.residuals import chi_square
from estimation.processing import NoiseEstimate, NoiseModel, PeriodSource, fold_recording
from estimation.processing.spectrum import contrasts
from estimation.twin.experiment import drop_samples
from tests.estimation.cases import measured, trajectory


def test_contrasts_are_independent_and_have_the_noise_s_variance():
    rng = np.random.default_rng(1)
    repeated = rng.standard_normal((1, 4000, 6)) * 50
    periods = repeated + 3 * rng.standard_normal((4, 4000, 6))
    samples = contrasts(periods)
    assert samples.shape == (3, 4000, 6)
    for j in range(6):
        np.testing.assert_allclose(np.cov(samples[:, :, j]), 9 * np.eye(3), atol=0.8)


def test_without_periods_the_residuals_serve(sound):
    record = sound[0].recording
    forces, lengths = (
        replace(channels, periods=None, repeats=None)
        for channels in (record.forces, record.lengths)
    )
    record = replace(record, forces=forces, lengths=lengths)
    residuals = np.random.default_rng(2).standard_normal((300, 6)) + 5
    noise = NoiseModel(record.forces.scatter, record.lengths.scatter)
    tests = noise_tests(record, noise, residuals, None)
    assert tests.normality.source == "residuals"
    assert tests.normality.lengths is None
    np.testing.assert_allclose(tests.samples.mean(axis=0), 0, atol=1e-12)


@pytest.mark.parametrize("lost", [0, 1, 8])
def test_lost_samples_are_why_periods_are_not_compared(lost):
    data = measured(trajectory(), 1, periods=3)
    kept = np.ones(len(data), dtype=bool)
    kept[20 : 20 + lost] = False
    record = fold_recording(drop_samples(data, kept), trajectory().omega, PeriodSource.DESIGN)
    findings = analyse_noise(record).findings
    named = [each for each in findings if f"{lost} sample" in each.sentence]
    assert len(named) == (3 if lost else 0)
    assert all(each.outcome is FindingOutcome.NOT_TESTED for each in named)


@pytest.mark.parametrize(("series", "length"), [(1, 200), (3, 300)])
def test_level_of_whiteness_in_short_records(series, length):
    rng = np.random.default_rng(3)
    draws = [whiteness(rng.standard_normal((series, length, 6)), level=0.06) for _ in range(500)]
    rejected = np.sum([test.significant for test in draws])
    assert stats.binom.sf(rejected - 1, 3000, 0.01) > 0.002
    assert rejected > 8


def test_filtered_noise_is_not_white_and_the_channel_is_named():
    rng = np.random.default_rng(4)
    values = rng.standard_normal((3, 400, 6))
    values[:, :, 4] = signal.lfilter([1], [1, -0.4], values[:, :, 4], axis=1)
    test = whiteness(values)
    assert np.flatnonzero(test.failed).tolist() == [4]
    assert test.autocorrelation[4, 0] == pytest.approx(0.4, abs=0.1)


def test_whiteness_of_residuals_allows_for_the_fit():
    """Residuals about 25 smooth columns are correlated although the noise is white."""
    rng = np.random.default_rng(5)
    angle = 2 * np.pi * np.multiply.outer(np.arange(200) / 200, np.arange(1, 13))
    basis = np.concatenate([np.ones((200, 1)), np.sin(angle), np.cos(angle)], axis=1)
    basis, _ = np.linalg.qr(basis)

    def expected(_, lag):
        return -float(np.sum(basis[: len(basis) - lag] * basis[lag:]))

    raw, allowed = [], []
    for _ in range(200):
        noise = rng.standard_normal((200, 6))
        rest = (noise - basis @ (basis.T @ noise))[None]
        raw.append(whiteness(rest, level=0.3).significant)
        allowed.append(whiteness(rest, expected, level=0.3).significant)
    assert np.mean(raw) > 0.1
    assert np.mean(allowed) < 0.05 + 4 * np.sqrt(0.05 / 1200)


def test_normal_noise_passes_and_other_noise_does_not():
    rng = np.random.default_rng(6)
    samples = rng.standard_normal((6000, 6))
    samples[:, 1] = rng.uniform(-1, 1, 6000)
    samples[:, 3] = rng.gamma(8.0, size=6000)
    test = normality(samples[None])
    assert np.flatnonzero(test.failed).tolist() == [1, 3]
    assert test.kurtosis[1] == pytest.approx(-1.2, abs=0.1)
    assert test.skewness[3] == pytest.approx(2 / np.sqrt(8), abs=0.1)
    assert not np.any(test.with_outliers[[0, 2, 4, 5]])


def test_what_is_significant_but_small_is_no_failure():
    rng = np.random.default_rng(7)
    samples = stats.t.rvs(40, size=(400_000, 6), random_state=rng)
    test = normality(samples[None])
    assert np.all(test.significant)
    assert not np.any(test.failed)


@pytest.mark.parametrize(
    ("p", "outcome"), [(0.2, FindingOutcome.HOLDS), (1e-30, FindingOutcome.NEGLIGIBLE)]
)
def test_a_negligible_rejection_is_an_outcome_of_its_own(p, outcome):
    assumption = Assumption("the noise is normal", "the noise is not normal", "")
    finding = assumption.decide("", "skewness 0.01", "", p, level=1e-3)
    assert finding.outcome is outcome
    assert not finding.failed


def test_outliers_are_counted():
    rng = np.random.default_rng(8)
    samples = rng.standard_normal((5000, 6)) * [1, 2, 3, 4, 5, 6]
    samples[:10, 2] = 30.0
    test = normality(samples[None])
    assert np.flatnonzero(test.with_outliers).tolist() == [2]
    assert test.outliers[2] == 10
    assert test.outliers_expected == pytest.approx(5000 * 2 * stats.norm.sf(4.5))


def test_an_outlier_is_counted_once():
    periods = np.random.default_rng(11).standard_normal((4, 800, 6))
    periods[0, 5, 0] += 100.0
    periods[2, 9, 0] += 100.0
    test = normality(contrasts(periods))
    assert test.outliers.tolist() == [2, 0, 0, 0, 0, 0]


def test_level_of_drift_and_its_size():
    rng = np.random.default_rng(9)
    block = np.repeat(np.arange(5), 100)

    def draw(change):
        periods = rng.standard_normal((5, 100, 6))
        periods[:, :, 2] += change * np.arange(5)[:, None]
        return drift((periods - periods.mean(axis=0)).reshape(-1, 6), block, 100, 0.06)

    rejected = sum(int(np.sum(draw(0.0).failed)) for _ in range(400))
    assert stats.binom.sf(rejected - 1, 2400, 0.01) > 0.002
    assert stats.binom.cdf(rejected, 2400, 0.01) > 0.002
    moved = draw(0.3)
    assert moved.failed.tolist() == [j == 2 for j in range(6)]
    assert moved.slope[2] == pytest.approx(0.3, abs=0.15)
    assert moved.extent[2] == pytest.approx(1.2, abs=0.5)


def test_one_period_cannot_drift():
    test = drift(np.zeros((50, 6)), np.zeros(50, dtype=np.intp), 50)
    assert "one period" in test.refused
    assert not np.any(test.failed)


@pytest.mark.parametrize("known", [True, False])
def test_level_of_chi_square(known):
    rng = np.random.default_rng(10)
    mixing = rng.standard_normal((6, 6)) + 2 * np.eye(6)
    sigma = mixing @ mixing.T
    columns = rng.standard_normal((60, 6, 5))
    counts = np.full(60, 3.0)
    p_values = []
    for _ in range(400):
        scatter = sigma
        freedom = np.inf
        if not known:
            freedom = 120.0
            scatter = stats.wishart.rvs(120, sigma, random_state=rng) / 120
        noise = rng.standard_normal((60, 6)) @ mixing.T
        inverse = np.linalg.inv(scatter)
        flat = columns.reshape(-1, 5)
        weighted = np.einsum("ij,rjk->rik", inverse, columns).reshape(-1, 5)
        cross = np.linalg.inv(flat.T @ weighted)
        rest = noise - columns @ (cross @ (weighted.T @ noise.ravel()))
        sample = NoiseEstimate(scatter, freedom)
        law = ResidualCovariance.of(sample, columns, np.linalg.cholesky(cross), fitted=True)
        test = chi_square(rest / np.sqrt(3), counts, law)
        assert test.freedom == pytest.approx(355)
        p_values.append(test.p_value)
    assert stats.kstest(p_values, "uniform").pvalue > 0.002


def test_chi_square_of_the_fits_own_noise_is_refused():
    noise, columns = NoiseEstimate(np.eye(6), 30.0, "residuals"), np.zeros((9, 6, 1))
    law = ResidualCovariance.of(noise, columns, np.eye(1), fitted=True)
    test = chi_square(np.ones((9, 6)), np.ones(9), law)
    assert test.refused
    assert np.isnan(test.p_value)
