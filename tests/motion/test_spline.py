import numpy as np
import pytest

from expdesign.motion.ramp import MotionState, SplineRamp, end_coefficients, reversed_in_time

INTERVALS, DURATION = 10, 1.7


@pytest.fixture(scope="module")
def ramp():
    return SplineRamp("ramp in", DURATION, np.random.default_rng(0).normal(size=(15, 6)))


def test_each_derivative_is_the_difference_of_the_one_before(ramp):
    times, h = np.linspace(0.11, 1.6, 57), 1e-5
    ahead, behind, here = (ramp.sample(times + s) for s in (h, -h, 0))
    pairs = [
        (ahead.pose - behind.pose, here.rate),
        (ahead.rate - behind.rate, here.acceleration),
        (ahead.acceleration - behind.acceleration, ramp.jerk(times)),
    ]
    for difference, derivative in pairs:
        scale = np.max(np.abs(derivative))
        np.testing.assert_allclose(difference / (2 * h), derivative, atol=1e-4 * scale)


def test_the_ends_have_the_state_asked_for():
    rng = np.random.default_rng(1)
    start, end = (MotionState(*rng.normal(size=(3, 6))) for _ in range(2))
    inner = rng.normal(size=(9, 6))
    first, _ = end_coefficients(INTERVALS, DURATION, start)
    last, _ = end_coefficients(INTERVALS, DURATION, reversed_in_time(end))
    ramp = SplineRamp("ramp in", DURATION, np.concatenate([first, inner, last[::-1]]))
    for time, state in ((0.0, start), (DURATION, end)):
        found = ramp.sample(np.array([time]))
        np.testing.assert_allclose(found.pose[0], state.pose, atol=1e-12)
        np.testing.assert_allclose(found.rate[0], state.rate, atol=1e-11)
        np.testing.assert_allclose(found.acceleration[0], state.acceleration, atol=1e-10)


def test_one_piece_is_the_polynomial_of_fifth_order():
    start, end = MotionState.at_rest(np.zeros(6)), MotionState.at_rest(np.ones(6))
    first, _ = end_coefficients(1, 2.0, start)
    last, _ = end_coefficients(1, 2.0, reversed_in_time(end))
    ramp = SplineRamp("ramp in", 2.0, np.concatenate([first, last[::-1]]))
    s = np.linspace(0, 1, 11)
    np.testing.assert_allclose(
        ramp.sample(2 * s).pose[:, 0], s**3 * (10 - 15 * s + 6 * s**2), atol=1e-14
    )
