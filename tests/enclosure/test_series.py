"""Fourier series over cells of time against the same in 60 digits."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from expdesign.enclosure.paths import DERIVATIVES, EnclosedSeries
from expdesign.trajectory import FourierTrajectory
from tests.enclosure.exact import assert_holds, digits


def drawn(rng, harmonics, omega):
    mu, nu = (rng.standard_normal((6, harmonics)) for _ in range(2))
    return FourierTrajectory(omega, rng.standard_normal(6), mu, nu)


def exact(trajectory, time):
    """Return pose, rate, acceleration and jerk at a time, 24 numbers in many digits."""
    omega, found = mpmath.mpf(trajectory.omega), []
    for derivative in range(DERIVATIVES):
        waves = []
        for k in range(1, trajectory.harmonics + 1):
            phase = k * omega * time + derivative * mpmath.pi / 2
            grown = (k * omega) ** (derivative - 1)
            waves.append((grown * mpmath.sin(phase), grown * mpmath.cos(phase)))
        for i in range(6):
            total = mpmath.mpf(trajectory.lambda0[i]) if derivative == 0 else mpmath.mpf(0)
            for mu, nu, (sine, cosine) in zip(
                trajectory.mu[i], trajectory.nu[i], waves, strict=True
            ):
                total += mpmath.mpf(mu) * sine - mpmath.mpf(nu) * cosine
            found.append(total)
    return found


@given(
    seed=st.integers(0, 2**32 - 1),
    harmonics=st.sampled_from([1, 5, 40]),
    omega=st.floats(0.05, 20.0),
    cells=st.sampled_from([3, 64, 10_000, 10**9]),
)
@settings(max_examples=40)
def test_a_series_is_held_at_every_edge_and_in_the_middle(seed, harmonics, omega, cells):
    rng = np.random.default_rng(seed)
    trajectory = drawn(rng, harmonics, omega)
    start = rng.uniform(0, 1, 2) * trajectory.period
    edges = np.stack([start, start + trajectory.period / cells], axis=1)

    models = EnclosedSeries(trajectory).models(edges)

    assert len(models) == DERIVATIVES * 6
    for cell in range(2):
        low, high = (Fraction(float(one)) for one in edges[cell])
        # The cell's own time is that of its polynomials: from the middle as it was computed.
        middle = edges[cell].mean()
        half = float(np.max(np.abs(edges[cell] - middle)) * (1 + 4 * 2.0**-52))
        for share in (Fraction(0), Fraction(1), Fraction(3, 7)):
            time = low + share * (high - low)
            tau = (time - Fraction(float(middle))) / Fraction(half)
            assert abs(tau) <= 1
            for model, value in zip(models, exact(trajectory, digits(time)), strict=True):
                assert_holds(model, cell, tau, value)


def test_the_cells_of_a_period_cover_it():
    for seed in range(200):
        rng = np.random.default_rng(seed)
        trajectory = drawn(rng, 1, float(rng.uniform(0.01, 50)))

        start, end = EnclosedSeries(trajectory).breaks

        assert start == 0
        assert mpmath.mpf(end) >= 2 * mpmath.pi / mpmath.mpf(trajectory.omega)
        assert end == pytest.approx(trajectory.period, rel=1e-14)


def test_a_motion_in_many_cells_is_as_narrow_as_its_rounding():
    trajectory = drawn(np.random.default_rng(3), 5, 2.0)
    edges = np.linspace(0, trajectory.period, 513)

    models = EnclosedSeries(trajectory).models(np.stack([edges[:-1], edges[1:]], axis=1))

    assert max(np.max(model.radius) for model in models) < 1e-7
