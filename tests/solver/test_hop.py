import numpy as np
import pytest

from expdesign.solver.hop import perturbed
from expdesign.solver.random_start import random_start

WIDTH = 0.4


@pytest.fixture(scope="module")
def origin(problem):
    return random_start(problem, np.random.default_rng(0), 40, WIDTH)


@pytest.mark.parametrize("seed", range(6))
def test_a_hop_keeps_the_limits_and_moves(problem, origin, seed):
    x = perturbed(problem, origin, np.random.default_rng(seed), WIDTH)
    assert x.shape == origin.shape
    phases = 2 * np.pi * np.arange(24) / 24
    assert np.max(problem.smooth_violations(x, phases, WIDTH)) <= 0
    assert np.max(np.abs(x - origin)) > 1e-3
    lower, upper = problem.variables.bounds()
    assert lower[-1] <= x[-1] <= upper[-1]
    # It is no new random start: most of the motion is the old one.
    assert np.corrcoef(x[:-1], origin[:-1])[0, 1] > 0.5


def test_the_generator_decides_and_the_origin_stays(problem, origin):
    before = origin.copy()
    first, again, other = (
        perturbed(problem, origin, np.random.default_rng(seed), WIDTH) for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert np.max(np.abs(first - other)) > 1e-3
    np.testing.assert_array_equal(origin, before)


def test_a_fixed_frequency_stays(problem, origin):
    omega = problem.variables.trajectory(origin).omega
    fixed = problem.with_frequency((omega, omega))
    for seed in range(3):
        x = perturbed(fixed, origin, np.random.default_rng(seed), WIDTH)
        assert fixed.variables.trajectory(x).omega == pytest.approx(omega, rel=1e-15)
