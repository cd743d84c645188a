import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from expdesign.trajectory import FourierTrajectory, PhaseBasis

AMPLITUDES = st.floats(-5, 5, allow_subnormal=False)


@st.composite
def trajectories(draw, most=12):
    n = draw(st.integers(1, most))
    return FourierTrajectory(
        draw(st.floats(0.05, 40)),
        draw(arrays(float, 6, elements=AMPLITUDES)),
        draw(arrays(float, (6, n), elements=AMPLITUDES)),
        draw(arrays(float, (6, n), elements=AMPLITUDES)),
    )


@pytest.fixture
def trajectory():
    rng = np.random.default_rng(0)
    return FourierTrajectory(
        2.3, rng.normal(size=6), rng.normal(size=(6, 4)), rng.normal(size=(6, 4))
    )


def _literally(trajectory, i, t):
    """Equation (13): λ_i(t), and the term-by-term derivatives of it."""
    w = trajectory.omega
    position, rate, acceleration = float(trajectory.lambda0[i]), 0.0, 0.0
    for k in range(1, trajectory.harmonics + 1):
        mu, nu = float(trajectory.mu[i, k - 1]), float(trajectory.nu[i, k - 1])
        sine, cosine = math.sin(k * w * t), math.cos(k * w * t)
        position += mu / (k * w) * sine - nu / (k * w) * cosine
        rate += mu * cosine + nu * sine
        acceleration += -mu * k * w * sine + nu * k * w * cosine
    return position, rate, acceleration


def test_equations_13_and_14(trajectory):
    times = [0.0, 0.17, 1.0, 2.7, -0.4, 11.0]
    samples = trajectory.sample(times)
    for row, t in enumerate(times):
        for i in range(6):
            expected = _literally(trajectory, i, t)
            found = [part[row, i] for part in (samples.pose, samples.rate, samples.acceleration)]
            np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(trajectories(), st.floats(-3, 3))
def test_equations_13_and_14_for_any_trajectory(trajectory, periods):
    t = periods * trajectory.period
    samples = trajectory.sample(t)
    n = trajectory.harmonics
    for i in range(6):
        expected = _literally(trajectory, i, t)
        size = np.sum(np.abs(trajectory.mu[i])) + np.sum(np.abs(trajectory.nu[i]))
        bounds = 1 + abs(trajectory.lambda0[i]) + size * np.array([1 / trajectory.omega, 1, n * 40])
        found = [part[0, i] for part in (samples.pose, samples.rate, samples.acceleration)]
        assert np.all(np.abs(np.subtract(found, expected)) <= 1e-12 * bounds)


def test_rates_and_accelerations_are_derivatives(trajectory):
    times, h = np.linspace(0, trajectory.period, 29), 1e-4
    before, here, after = (trajectory.sample(times + step) for step in (-h, 0, h))
    np.testing.assert_allclose((after.pose - before.pose) / (2 * h), here.rate, atol=1e-5)
    np.testing.assert_allclose((after.rate - before.rate) / (2 * h), here.acceleration, atol=1e-4)


def test_derivatives_of_the_basis_are_those_to_the_phase():
    phases, h = np.linspace(0, 7, 50), 1e-5
    before, here, after = (PhaseBasis.at(phases + step, 5) for step in (-h, 0, h))
    assert here.value.shape == here.first.shape == here.second.shape == (50, 11)
    np.testing.assert_allclose((after.value - before.value) / (2 * h), here.first, atol=1e-7)
    np.testing.assert_allclose((after.first - before.first) / (2 * h), here.second, atol=1e-6)
    np.testing.assert_array_equal(here.value[:, 0], 1)
    np.testing.assert_array_equal(here.first[:, 0], 0)


def test_shapes(trajectory):
    for times, count in ((0.3, 1), ([0.3], 1), (np.linspace(0, 1, 17), 17), ([], 0)):
        samples = trajectory.sample(times)
        assert samples.pose.shape == samples.rate.shape == samples.acceleration.shape == (count, 6)


# --- the vector -----------------------------------------------------------------------------------


def test_order_of_the_vector(trajectory):
    vector = trajectory.vector()
    assert vector.shape == (12 * trajectory.harmonics + 7,)
    assert vector[-1] == trajectory.omega
    table = vector[:-1].reshape(6, 9)
    np.testing.assert_array_equal(table[:, 0], trajectory.lambda0)
    np.testing.assert_array_equal(table[:, 1:5], trajectory.mu)
    np.testing.assert_array_equal(table[:, 5:], trajectory.nu)


@settings(max_examples=40, deadline=None)
@given(trajectories())
def test_displacements_and_back(trajectory):
    again = FourierTrajectory.from_displacements(
        trajectory.omega, trajectory.lambda0, trajectory.sine, trajectory.cosine
    )
    np.testing.assert_allclose(again.mu, trajectory.mu, rtol=1e-14, atol=1e-290)
    np.testing.assert_allclose(again.nu, trajectory.nu, rtol=1e-14, atol=1e-290)


def test_displacements_are_amplitudes():
    sine, cosine = np.zeros((6, 3)), np.zeros((6, 3))
    sine[1, 2], cosine[4, 0] = 0.5, -0.25
    trajectory = FourierTrajectory.from_displacements(3.0, np.zeros(6), sine, cosine)
    t = np.linspace(0, 5, 40)
    pose = trajectory.sample(t).pose
    np.testing.assert_allclose(pose[:, 1], 0.5 * np.sin(9 * t), atol=1e-14)
    np.testing.assert_allclose(pose[:, 4], -0.25 * np.cos(3 * t), atol=1e-14)


# --- time -----------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(trajectories(), st.floats(-2, 2), st.floats(-2, 2))
def test_shift_in_time(trajectory, start, later):
    start, later = start * trajectory.period, later * trajectory.period
    shifted = trajectory.shifted(start).sample(later)
    expected = trajectory.sample(start + later)
    size = 1 + np.max(np.abs(trajectory.mu)) + np.max(np.abs(trajectory.nu))
    n, w = trajectory.harmonics, trajectory.omega
    for name, bound in (("pose", 1 / w), ("rate", 1), ("acceleration", n * w)):
        np.testing.assert_allclose(
            getattr(shifted, name),
            getattr(expected, name),
            rtol=1e-10,
            atol=1e-11 * n * size * max(1, bound),
        )


def test_shifts_add_up_and_come_back(trajectory):
    there = trajectory.shifted(0.3).shifted(0.4)
    at_once = trajectory.shifted(0.7)
    np.testing.assert_allclose(there.vector(), at_once.vector(), rtol=0, atol=1e-13)
    back = trajectory.shifted(0.7).shifted(-0.7)
    np.testing.assert_allclose(back.vector(), trajectory.vector(), rtol=0, atol=1e-13)
    around = trajectory.shifted(trajectory.period)
    np.testing.assert_allclose(around.vector(), trajectory.vector(), rtol=0, atol=1e-13)


def test_a_shift_by_whole_samples_rotates_the_samples(trajectory):
    times = trajectory.sample_times(24)
    poses = trajectory.sample(times).pose
    shifted = trajectory.shifted(times[7]).sample(times).pose
    np.testing.assert_allclose(shifted, np.roll(poses, -7, axis=0), atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(trajectories(), st.integers(-3, 3))
def test_periodic(trajectory, periods):
    times = np.linspace(0, trajectory.period, 5)
    here = trajectory.sample(times)
    later = trajectory.sample(times + periods * trajectory.period)
    size = 1 + np.max(np.abs(trajectory.vector()))
    n, w = trajectory.harmonics, trajectory.omega
    np.testing.assert_allclose(later.pose, here.pose, atol=1e-11 * n * size * (1 + 1 / w))
    np.testing.assert_allclose(later.rate, here.rate, atol=1e-11 * n * size)


def test_sample_times(trajectory):
    times = trajectory.sample_times(200)
    assert times.shape == (200,)
    assert times[0] == 0
    np.testing.assert_allclose(np.diff(times), trajectory.period / 200, rtol=1e-10)
    assert times[-1] < trajectory.period
    assert trajectory.period == pytest.approx(2 * math.pi / 2.3)
    assert trajectory.frequency * trajectory.period == pytest.approx(1)


def test_the_mean_of_a_period_is_its_center(trajectory):
    samples = trajectory.sample(trajectory.sample_times(9))
    np.testing.assert_allclose(samples.pose.mean(axis=0), trajectory.lambda0, atol=1e-14)
    np.testing.assert_allclose(samples.rate.mean(axis=0), 0, atol=1e-14)


# --- refusals -------------------------------------------------------------------------------------


@pytest.mark.parametrize("omega", [0, -1.0, math.nan, math.inf])
def test_refused_frequencies(omega):
    with pytest.raises(ValueError, match="omega"):
        FourierTrajectory(omega, np.zeros(6), np.zeros((6, 2)), np.zeros((6, 2)))


@pytest.mark.parametrize(
    ("lambda0", "mu", "nu", "named"),
    [
        (np.zeros(5), np.zeros((6, 2)), np.zeros((6, 2)), "lambda0"),
        (np.zeros((6, 1)), np.zeros((6, 2)), np.zeros((6, 2)), "lambda0"),
        (np.zeros(6), np.zeros((5, 2)), np.zeros((6, 2)), "mu"),
        (np.zeros(6), np.zeros(6), np.zeros((6, 2)), "mu"),
        (np.zeros(6), np.zeros((6, 2)), np.zeros((6, 3)), "nu"),
        (np.zeros(6), np.zeros((2, 6)), np.zeros((2, 6)), "mu"),
        (np.full(6, np.nan), np.zeros((6, 2)), np.zeros((6, 2)), "lambda0"),
        (np.zeros(6), np.full((6, 2), np.inf), np.zeros((6, 2)), "mu"),
        (np.zeros(6), np.zeros((6, 2)), np.full((6, 2), np.nan), "nu"),
    ],
)
def test_refused_coefficients(lambda0, mu, nu, named):
    with pytest.raises(ValueError, match=named):
        FourierTrajectory(1.0, lambda0, mu, nu)


@pytest.mark.parametrize(
    "make",
    [
        lambda: FourierTrajectory(1.0, np.zeros(6), 0.0, 0.0),
        lambda: FourierTrajectory(1.0, np.zeros(6), np.zeros((6, 0)), np.zeros((6, 0))),
        lambda: FourierTrajectory.from_displacements(1.0, np.zeros(6), np.zeros(6), np.zeros(6)),
        lambda: FourierTrajectory.from_displacements(
            1.0, np.zeros(6), np.zeros((6, 2)), np.zeros((6, 3))
        ),
    ],
    ids=["scalars", "no harmonics", "one dimension", "unequal"],
)
def test_what_is_no_trajectory_is_a_value_error(make):
    with pytest.raises(ValueError, match=r"shape|harmonic|mu|nu|broadcast"):
        make()


def test_frozen(trajectory):
    for name in ("lambda0", "mu", "nu"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(trajectory, name)[0] = 1
    given_array = np.zeros(6)
    trajectory = FourierTrajectory(1.0, given_array, np.ones((6, 1)), np.ones((6, 1)))
    given_array[0] = 7
    assert trajectory.lambda0[0] == 0
