"""Derivatives of the ramp's program against differences, without a solver."""

import numpy as np
import pytest

from constraints import Limit
from expdesign.configuration.limits import row_labels
from expdesign.motion.executable import moving_states
from expdesign.motion.planning import STRUT_JERK
from expdesign.motion.ramp import MotionState, RampProblem, RampProgram
from expdesign.robot import LimitModel, load_robot

SHARES = np.linspace(0.0, 1.0, 9)


@pytest.fixture(scope="module")
def problem():
    robot = load_robot("palida")
    labels = row_labels(STRUT_JERK)
    jerk = Limit(STRUT_JERK, np.full(6, -1500.0), np.full(6, 1500.0), labels, "test")
    limits = LimitModel.of(robot, jerk)
    rng = np.random.default_rng(0)
    end = MotionState(
        robot.home + 0.02 * rng.normal(size=6), 0.3 * rng.normal(size=6), rng.normal(size=6)
    )
    scale = np.array([0.1, 0.1, 0.1, 0.3, 0.3, 0.6])
    return RampProblem(limits, MotionState.at_rest(robot.home), end, 6, scale, 0.5)


@pytest.fixture(scope="module")
def point(problem):
    rng = np.random.default_rng(1)
    return np.append(0.05 * rng.normal(size=problem.size - 1), 1.1)


@pytest.fixture(scope="module")
def program(problem):
    count = len(problem.limits.keys)
    mask = np.ones((len(SHARES), count), dtype=bool)
    return RampProgram(problem, SHARES, mask, np.zeros(mask.shape), 0.3, 0.1)


def _differences(function, x, h=1e-6):
    columns = []
    for k in range(x.size):
        step = np.zeros_like(x)
        step[k] = h
        columns.append((function(x + step) - function(x - step)) / (2 * h))
    return np.stack(columns, axis=-1)


def test_jacobian_of_the_rows(program, point):
    rows = program.linear_rows(point)
    np.testing.assert_allclose(rows.values, program.rows(point), atol=1e-12)
    expected = _differences(program.rows, point)
    np.testing.assert_allclose(rows.jacobian(), expected, atol=2e-6 * np.max(np.abs(expected)))


def test_gradient_and_hessian_of_the_cost(program, point):
    value, gradient, hessian = program.cost_derivatives(point)
    assert value == program.cost(point)
    np.testing.assert_allclose(
        gradient, _differences(program.cost, point), atol=1e-6 * np.max(np.abs(gradient))
    )
    by_difference = _differences(lambda x: program.cost_gradient(x)[1], point)
    # Roughness is quadratic in the control points: there Gauss–Newton is exact.
    np.testing.assert_allclose(
        hessian[:-1, :-1], by_difference[:-1, :-1], atol=1e-6 * np.max(np.abs(hessian))
    )
    assert np.min(np.linalg.eigvalsh(hessian)) > -1e-10 * np.max(np.abs(hessian))


def test_strut_jerk_is_the_rate_of_the_struts_acceleration(problem, point):
    robot, ramp = problem.limits.robot, problem.ramp(point, "ramp in")
    times, h = np.linspace(0.05, 0.5, 23), 1e-5

    def acceleration(at):
        motion = ramp.sample(at)
        struts = robot.strut_motion(motion.pose, motion.rate, motion.acceleration)
        return struts.length_acceleration

    jerk = problem.limits.values(moving_states(ramp, times))[:, problem.limits.of_jerk]
    expected = (acceleration(times + h) - acceleration(times - h)) / (2 * h)
    np.testing.assert_allclose(jerk, expected, atol=1e-5 * np.max(np.abs(jerk)))


def test_a_ramp_survives_packing(problem, point):
    again = problem.pack(problem.ramp(point, "ramp in"))
    np.testing.assert_allclose(again, point, atol=1e-14)


def test_rows_that_move_are_told_from_those_that_do_not(problem):
    limits = problem.limits
    moving = {name for name, moves in zip(limits.keys, limits.moving, strict=True) if moves}
    assert moving == {"strut_speed", "strut_acceleration", "actuator_force", "strut_jerk"}
