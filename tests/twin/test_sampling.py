import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimation.twin.experiment import MOST_SAMPLES, SampleGrid
from expdesign.configuration import InputError
from expdesign.configuration.experiment import ExperimentSection


def grid(period, **experiment):
    return SampleGrid.of(period, ExperimentSection(**experiment))


def test_whole_periods():
    found = grid(2.0, periods=3, sampling=100)
    assert (found.count, found.per_period) == (600, 200)
    np.testing.assert_array_equal(found.times, np.arange(600) / 100)
    np.testing.assert_array_equal(found.distinct_times, np.arange(200) / 100)
    np.testing.assert_array_equal(found.period_numbers, np.repeat([1, 2, 3], 200))
    values = np.random.default_rng(0).normal(size=(200, 6))
    np.testing.assert_array_equal(found.repeat(values), np.concatenate([values] * 3))


def test_a_period_that_is_not_a_whole_number_of_samples():
    """The sampling is the controller's; nothing is rounded to a period of 1667 samples."""
    found = grid(1 / 0.6, periods=10, sampling=1000)
    assert (found.count, found.per_period) == (16667, None)
    np.testing.assert_array_equal(found.times, np.arange(16667) / 1000)
    np.testing.assert_array_equal(found.distinct_times, found.times)
    starts = np.searchsorted(found.period_numbers, np.arange(1, 11))
    np.testing.assert_array_equal(starts, np.ceil(np.arange(10) / 0.6 * 1000 - 1e-9))
    assert (found.period_numbers[0], found.period_numbers[-1]) == (1, 10)


def test_three_periods_that_are_whole_together():
    found = grid(5 / 3, periods=3, sampling=1000)
    assert found.count == 5000
    assert grid(5 / 3, periods=4, sampling=1000).period_numbers[5000] == 4


@pytest.mark.parametrize("cycles", range(1000, 1400, 7))
def test_rounding_of_the_frequency_costs_no_sample(cycles):
    period = 2 * np.pi / (2 * np.pi / (cycles * 1e-3))
    found = grid(period, periods=13, sampling=1000)
    assert (found.count, found.per_period) == (13 * cycles, cycles)


@given(
    period=st.floats(0.05, 20),
    periods=st.integers(1, 12),
    sampling=st.floats(20, 500),
)
def test_every_sample_lies_within_the_experiment(period, periods, sampling):
    found = grid(period, periods=periods, sampling=sampling)
    step = 1 / sampling
    assert found.times[-1] < found.duration * (1 + 1e-9)
    # All samples before the end, the next one would be at or after it.
    assert found.times[-1] + step > found.duration * (1 - 1e-9) - step * 1e-6
    numbers = found.period_numbers
    assert numbers[0] == 1
    assert numbers[-1] <= periods
    assert np.all(np.isin(np.diff(numbers), (0, 1))) or period * sampling < 1
    inside = found.times / period - (numbers - 1)
    assert np.all((inside > -1e-6) & (inside < 1 + 1e-6))


@pytest.mark.parametrize(
    ("period", "experiment", "key"),
    [
        (1e-3, {"periods": 3, "sampling": 100}, "experiment.sampling"),
        (1000.0, {"periods": 11, "sampling": 1000}, "experiment.periods"),
        (1e300, {"periods": 1, "sampling": 1000}, "experiment.periods"),
    ],
)
def test_impossible_numbers_of_samples(period, experiment, key):
    with pytest.raises(InputError, match="samples") as caught:
        grid(period, **experiment)
    (problem,) = caught.value.problems
    assert problem.key == key


def test_the_largest_experiment():
    assert grid(MOST_SAMPLES / 1e4, periods=10, sampling=1000).count == MOST_SAMPLES
