"""Uniform time, jitter, stamps, gaps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimation.data.measurement import Measurement, find_gaps, fit_grid

STEPS = st.floats(1e-5, 10)
STARTS = st.floats(-1e4, 1e4)


@given(count=st.integers(2, 500), step=STEPS, begin=STARTS)
def test_a_uniform_grid_is_found_again(count, step, begin):
    exact = begin + step * np.arange(count)
    fit = fit_grid(exact)
    digits = np.spacing(np.abs(exact).max())
    assert fit.step == pytest.approx(step, abs=10 * digits)
    assert np.abs(fit.time - exact).max() <= 10 * digits + 1e-12 * step
    assert fit.jitter <= 20 * digits / step + 1e-9


@given(seed=st.integers(0, 1000))
def test_the_fit_is_that_of_least_squares(seed):
    rng = np.random.default_rng(seed)
    stamps = 5 + 0.01 * (np.arange(100) + 0.2 * rng.uniform(-1, 1, 100))
    slope, offset = np.polyfit(np.arange(100), stamps, 1)
    fit = fit_grid(stamps)
    line = offset + slope * np.arange(100)
    assert fit.step == pytest.approx(slope, rel=1e-10)
    assert fit.time == pytest.approx(line, abs=1e-12)
    assert fit.jitter == pytest.approx(np.abs(stamps - line).max() / slope, rel=1e-6)
    assert abs(stamps - line)[fit.worst] == np.abs(stamps - line).max()


def test_stamps_since_1970_keep_their_digits():
    stamps = 1.7e9 + 1e-3 * np.arange(20_000)
    fit = fit_grid(stamps)
    assert fit.step == pytest.approx(1e-3, rel=1e-9)
    assert fit.jitter < 1e-3


def test_stamps_stay_as_they_are():
    rng = np.random.default_rng(0)
    stamps = 0.01 * (np.arange(200) + 0.3 * rng.uniform(-1, 1, 200))
    found = Measurement(stamps, np.ones((200, 6)), np.zeros((200, 6)), stamped=True)
    assert np.array_equal(found.time, stamps)
    assert found.step == pytest.approx((stamps[-1] - stamps[0]) / 199)
    assert 0.2 < found.jitter < 0.35


@given(
    seed=st.integers(0, 1000),
    jitter=st.floats(0, 0.1),
    lost=st.lists(st.integers(20, 180), min_size=1, max_size=3, unique=True),
)
def test_missing_samples_are_found_under_jitter(seed, jitter, lost):
    rng = np.random.default_rng(seed)
    stamps = 0.01 * (np.arange(200) + jitter * rng.uniform(-1, 1, 200))
    stamps = np.delete(stamps, lost)
    assert sum(missing for _, missing in find_gaps(stamps)) == len(lost)


@given(seed=st.integers(0, 1000), jitter=st.floats(0, 0.35))
def test_jitter_is_no_gap(seed, jitter):
    rng = np.random.default_rng(seed)
    assert find_gaps(0.01 * (np.arange(200) + jitter * rng.uniform(-1, 1, 200))) == []


def test_a_late_stamp_is_no_gap():
    stamps = np.arange(100.0)
    stamps[50] += 0.9
    assert find_gaps(stamps) == []
    burst = np.arange(100.0)
    burst[50:53] = [52.4, 52.5, 52.6]
    assert find_gaps(burst) == []


def test_a_long_gap_is_counted():
    assert find_gaps(np.delete(np.arange(200.0), range(50, 150))) == [(50, 100)]


def test_stamps_rounded_to_a_coarse_clock_have_no_gaps():
    assert find_gaps(np.floor(1.5 * np.arange(200))) == []
