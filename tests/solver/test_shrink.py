import dataclasses

import numpy as np
import pytest

from expdesign.recheck.limit_check import grid_points, states_at
from expdesign.robot import LimitModel
from expdesign.solver.feasibility import (
    GRID_MARGIN,
    SMALLEST_FACTOR,
    random_start,
    shrink_to_limits,
)
from expdesign.solver.finish import _check


def worst(problem, trajectory):
    times = trajectory.sample_times(grid_points(problem.cost.samples))
    return np.max(problem.limits.violations(states_at(trajectory, times)))


def scaled(trajectory, factor):
    return dataclasses.replace(trajectory, mu=factor * trajectory.mu, nu=factor * trajectory.nu)


@pytest.fixture(scope="module")
def inside(problem):
    """A motion that keeps every limit with room to spare."""
    x = random_start(problem, np.random.default_rng(0), 40, 0.4)
    return scaled(problem.variables.trajectory(x), 0.8)


@pytest.fixture(scope="module")
def too_large(problem, inside):
    """The same motion, made a little larger than the limits let it be."""
    factor = 1.0
    while worst(problem, scaled(inside, factor)) <= 0:
        factor *= 1.05
    return scaled(inside, factor)


def test_a_motion_within_the_limits_stays(problem, inside):
    shrunk = shrink_to_limits(problem, inside)
    assert shrunk.trajectory is inside
    assert (shrunk.factor, shrunk.kept) == (1.0, True)


@pytest.mark.parametrize("margin", [GRID_MARGIN, 5e-3])
def test_a_motion_is_shrunk_no_further_than_it_must(problem, too_large, margin):
    shrunk = shrink_to_limits(problem, too_large, margin)
    assert shrunk.kept
    assert SMALLEST_FACTOR < shrunk.factor < 1
    assert worst(problem, shrunk.trajectory) <= -margin + 1e-9
    larger = scaled(too_large, min(1.0, shrunk.factor * 1.0005))
    assert worst(problem, larger) > -margin


@pytest.mark.parametrize("factor", [0.5, 1.0, 2.0])
def test_what_was_looked_at_comes_back(factor, problem, too_large):
    """Violations before the shrinking, limited quantities after it: a round goes on from both."""
    motion = scaled(too_large, factor)
    shrunk = shrink_to_limits(problem, motion)
    times = motion.sample_times(grid_points(problem.cost.samples))
    before = problem.limits.violations(states_at(motion, times))
    np.testing.assert_array_equal(shrunk.before, before)
    after = problem.limits.values(states_at(shrunk.trajectory, times))
    np.testing.assert_array_equal(shrunk.values, after)
    assert (shrunk.trajectory is motion) == (factor == 0.5)


@pytest.mark.parametrize("proving", [False, True])
def test_what_is_checked_comes_with_what_it_broke(proving, plan, problem, too_large):
    x = problem.variables.pack(too_large)
    points = grid_points(problem.cost.samples)
    checked, exact = _check(problem, plan.evaluator, x, 0.1, proving=proving)
    states = problem.states(x, 2 * np.pi * np.arange(points) / points)
    np.testing.assert_allclose(exact, problem.limits.violations(states), rtol=1e-6, atol=1e-6)
    assert np.max(exact) > 0
    assert checked.check.passed
    assert checked.check.worst == pytest.approx(worst(problem, checked.trajectory), abs=1e-4)


def test_centre_and_frequency_stay(problem, too_large):
    shrunk = shrink_to_limits(problem, too_large)
    assert shrunk.trajectory.omega == too_large.omega
    np.testing.assert_array_equal(shrunk.trajectory.lambda0, too_large.lambda0)
    np.testing.assert_allclose(shrunk.trajectory.mu, shrunk.factor * too_large.mu)
    np.testing.assert_allclose(shrunk.trajectory.nu, shrunk.factor * too_large.nu)


def test_a_motion_far_outside_is_given_up(problem, too_large):
    shrunk = shrink_to_limits(problem, scaled(too_large, 2.0))
    assert not shrunk.kept
    assert shrunk.factor == SMALLEST_FACTOR
    assert worst(problem, shrunk.trajectory) > 0


def test_what_is_not_a_number_is_not_kept(problem, too_large, monkeypatch):
    """The limits of the decisive rows alone, as they are shrunk by, have no value."""

    def unknown(model, states):
        return np.full((len(states), len(model.keys)), np.nan)

    among = LimitModel.among

    def without_values(model, mask):
        monkeypatch.setattr(LimitModel, "violations", unknown)
        return among(model, mask)

    monkeypatch.setattr(LimitModel, "among", without_values)
    assert not shrink_to_limits(problem, too_large).kept
