import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from estimation.data.measurement import Measurement
from estimation.processing import PeriodError, PeriodSource, fold_recording
from estimation.processing.period import (
    omega_error,
    omega_from_column,
    omega_from_data,
    refine_omega,
    whole_samples,
)
from expdesign.trajectory import FourierTrajectory
from tests.estimation.cases import STEP, measured, trajectory


def with_column(data, samples, start=0):
    numbers = (np.arange(len(data)) + start) // samples
    return Measurement(data.time, data.lengths, data.forces, data.step, period=numbers)


@pytest.mark.parametrize("samples", [200, 200 + 1 / 3, 187.4])
def test_the_period_is_found_in_the_data_alone(samples):
    motion = trajectory(samples)
    found = omega_from_data(measured(motion, seed=1))
    # A thousandth of a step per period.
    assert abs(found / motion.omega - 1) < 1e-3 / samples


def test_the_error_of_the_frequency_is_as_large_as_stated():
    motion = trajectory(80)
    draws = [measured(motion, seed=seed, length_scale=5.0) for seed in range(40)]
    found = [refine_omega(data, motion.omega, 1e-3) for data in draws]
    stated = np.median([omega_error(*pair) for pair in zip(draws, found, strict=True)])
    # The scatter of 40 is known to 11 %.
    assert stated == pytest.approx(np.sqrt(np.mean((np.array(found) - motion.omega) ** 2)), rel=0.3)


@pytest.mark.parametrize("strong", [2, 3])
def test_a_strong_higher_harmonic_does_not_divide_the_period(strong):
    """The first harmonic moves a tenth of what the strong one does."""
    plain = trajectory(240, harmonics=3)
    scale = np.full(3, 0.03)
    scale[strong - 1], scale[0] = 1.0, 0.1
    motion = FourierTrajectory.from_displacements(
        plain.omega, plain.lambda0, plain.sine[:, :1] * scale, plain.cosine[:, :1] * scale
    )
    found = omega_from_data(measured(motion, seed=1))
    assert abs(found / motion.omega - 1) < 1e-4


@pytest.mark.parametrize("rate", [0.0, 1e-3, 5e-3])
def test_drift_does_not_multiply_the_period(rate):
    motion = trajectory()
    data = measured(motion, seed=3)
    slope = rate * data.time / data.time[-1]
    drifting = Measurement(data.time, data.lengths + slope[:, None], data.forces, data.step)
    assert abs(omega_from_data(drifting) / motion.omega - 1) < 1e-4


def test_a_clock_that_is_off_is_found():
    motion = trajectory(200)
    data = measured(motion, seed=2)
    slow = Measurement(data.time * 1.007, data.lengths, data.forces, data.step * 1.007)
    found = refine_omega(slow, motion.omega, 0.02)
    assert abs(found * 1.007 / motion.omega - 1) < 1e-5


def test_a_period_column_gives_the_period():
    data = with_column(measured(trajectory(), periods=4), 200, start=60)
    assert omega_from_column(data) == pytest.approx(2 * np.pi, rel=1e-12)


def test_a_period_column_that_jumps_is_refused():
    data = with_column(measured(trajectory()), 200)
    numbers = data.period.copy()
    numbers[500:] += 3
    odd = Measurement(data.time, data.lengths, data.forces, data.step, period=numbers)
    with pytest.raises(PeriodError, match="sample 501"):
        omega_from_column(odd)


def test_a_drift_without_repetition_has_no_period():
    time = np.arange(400) * STEP
    lengths = 0.7 + 0.01 * np.linspace(0, 1, 400)[:, None] * np.ones(6)
    with pytest.raises(PeriodError):
        omega_from_data(Measurement(time, lengths, np.zeros((400, 6)), STEP))


def test_means_and_scatter_equal_plain_loops():
    data = measured(trajectory(), periods=4)
    record = fold_recording(data, 2 * np.pi, PeriodSource.DESIGN)
    total = np.zeros((6, 6))
    for k in range(200):
        rows = [k + 200 * m for m in range(4)]
        mean = sum(data.forces[row] for row in rows) / 4
        np.testing.assert_allclose(record.forces.values[k], mean, rtol=1e-13)
        for row in rows:
            total += np.outer(data.forces[row] - mean, data.forces[row] - mean)
    np.testing.assert_allclose(record.forces.scatter.covariance, total / (3 * 200), rtol=1e-12)
    assert record.forces.scatter.freedom == 600
    assert record.dropped == 0
    assert np.all(record.forces.counts == 4)


def test_incomplete_periods_are_dropped_and_counted():
    data = measured(trajectory(), periods=4.4)
    record = fold_recording(data, 2 * np.pi, PeriodSource.DESIGN)
    assert (record.periods, record.rows, record.dropped) == (4, 800, 80)
    left_out = "80 rows of incomplete periods were left out: a whole one has 200"
    assert record.rows_left_out == left_out
    late = with_column(data, 200, start=60)
    record = fold_recording(late, 2 * np.pi, PeriodSource.COLUMN)
    assert record.forces.times[0] == pytest.approx(140 * STEP)
    assert (record.periods, record.dropped) == (3, 880 - 600)


def test_a_period_that_is_no_whole_number_is_never_rounded():
    motion = trajectory(1666 + 2 / 3, step=1e-3)
    data = measured(motion, periods=6, step=1e-3)
    record = fold_recording(data, motion.omega, PeriodSource.DESIGN)
    assert not record.averaged
    assert record.samples == len(data) == 10_000
    np.testing.assert_array_equal(record.forces.values, data.forces)


def test_less_than_a_period_is_refused():
    data = measured(trajectory(), periods=0.8)
    with pytest.raises(PeriodError, match="160 rows"):
        fold_recording(data, 2 * np.pi, PeriodSource.DESIGN)


@settings(max_examples=200)
@given(
    st.integers(2, 5000),
    st.floats(-0.4, 0.4),
    st.integers(1, 50),
    st.sampled_from([1e-3, 4e-4, 0.01]),
)
def test_whole_means_that_no_sample_moves(samples, off, periods, step):
    omega = 2 * np.pi / ((samples + off) * step)
    found = whole_samples(omega, step, periods)
    if abs(off) * periods < 0.0099:
        assert found == samples
    elif abs(off) * periods > 0.0101:
        assert found is None


@pytest.mark.parametrize("samples", [200.5, 200.4, 200 + 1 / 3, 200])
def test_a_period_column_does_not_round_the_period(samples):
    """Three marks of whole samples look like a whole number; the lengths know better."""
    data = measured(trajectory(samples), periods=3)
    numbers = np.floor(np.arange(len(data)) / samples + 1e-9).astype(int)
    marked = Measurement(data.time, data.lengths, data.forces, data.step, period=numbers)
    found = 2 * np.pi / (omega_from_column(marked) * data.step)
    assert abs(found - samples) < 5e-3
    if samples == 200:
        assert found == pytest.approx(200, rel=1e-12)


def test_a_last_period_without_its_last_fraction_of_a_sample_is_whole():
    motion = trajectory(200.37)
    data = measured(motion, periods=3)
    record = fold_recording(data, motion.omega, PeriodSource.DESIGN)
    assert len(data) == 601
    assert record.periods == 3
