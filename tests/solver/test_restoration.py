"""Motions that break limits a little are brought within them by the least change."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from expdesign.recheck.limit_check import grid_points, states_at
from expdesign.solver.feasibility import (
    GRID_MARGIN,
    least_change,
    random_start,
    restore_limits,
    shrink_to_limits,
)

WIDTH = 0.1


def worst(problem, trajectory):
    times = trajectory.sample_times(grid_points(problem.cost.samples))
    return np.max(problem.limits.violations(states_at(trajectory, times)))


@pytest.fixture(scope="module")
def beyond(problem):
    """Scaled variables of a motion that is a twentieth larger than its limits let it be."""
    x = random_start(problem, np.random.default_rng(0), 40, 0.4)
    while worst(problem, problem.variables.trajectory(x)) <= 0:
        x[:-1] *= 1.05
    return x


def test_what_keeps_the_limits_stays(problem, beyond):
    inside = np.append(0.5 * beyond[:-1], beyond[-1])
    kept = restore_limits(problem, inside, GRID_MARGIN, WIDTH)
    motion = problem.variables.trajectory(inside)
    assert kept.kept
    np.testing.assert_array_equal(kept.trajectory.mu, motion.mu)
    np.testing.assert_array_equal(kept.trajectory.lambda0, motion.lambda0)
    assert kept.factor == 1


@pytest.mark.parametrize("margin", [GRID_MARGIN, 1e-3])
def test_the_limits_are_kept_and_more_is_left_than_of_a_shrunk_motion(problem, beyond, margin):
    kept = restore_limits(problem, beyond, margin, WIDTH)
    shrunk = shrink_to_limits(problem, problem.variables.trajectory(beyond), margin)
    np.testing.assert_allclose(kept.before, shrunk.before, rtol=1e-9, atol=1e-9)
    assert kept.kept
    assert worst(problem, kept.trajectory) <= -margin + 1e-9
    assert kept.trajectory.omega == shrunk.trajectory.omega
    changes = [
        np.linalg.norm(problem.variables.pack(one.trajectory) - beyond) for one in (kept, shrunk)
    ]
    assert 0 < changes[0] < 0.5 * changes[1]


class Program:
    """Rows that are linear, lower ≤ J x ≤ upper, and near one bound at most."""

    def __init__(self, jacobian, lower, upper):
        self.matrix, self.row_lower, self.row_upper = jacobian, lower, upper

    def linear_rows(self, x):
        return SimpleNamespace(values=self.matrix @ x, jacobian=lambda: self.matrix)


@given(st.integers(0, 2**32 - 1), st.integers(1, 12))
def test_the_change_is_the_least_that_keeps_linear_rows(seed, rows):
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(rows, 6))
    kept = matrix @ np.append(rng.normal(size=5), 0.0)  # some point keeps all of them
    lower = rng.random(rows) < 0.5
    room = rng.random(rows)
    program = Program(matrix, np.where(lower, kept - room, -1e3), np.where(lower, 1e3, kept + room))
    step = least_change(program, np.zeros(6))
    assert step[-1] == 0
    values = matrix @ step
    assert np.all(values >= program.row_lower - 1e-8)
    assert np.all(values <= program.row_upper + 1e-8)
    other = minimize(
        lambda d: d @ d,
        np.zeros(5),
        jac=lambda d: 2 * d,
        constraints=[
            {"type": "ineq", "fun": lambda d: matrix[:, :-1] @ d - program.row_lower},
            {"type": "ineq", "fun": lambda d: program.row_upper - matrix[:, :-1] @ d},
        ],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert step @ step == pytest.approx(other.fun, rel=1e-4, abs=1e-8)


def test_no_change_keeps_rows_that_contradict_each_other():
    rows = np.array([[1.0, 0.0], [1.0, 0.0]])
    program = Program(rows, np.array([1.0, -3.0]), np.array([2.0, -2.0]))
    assert least_change(program, np.zeros(2)) is None


def test_what_is_not_a_number_has_no_change():
    program = Program(np.array([[np.nan, 0.0]]), np.array([1.0]), np.array([2.0]))
    assert least_change(program, np.zeros(2)) is None
