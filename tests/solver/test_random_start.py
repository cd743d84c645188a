import dataclasses

import numpy as np
import pytest

from expdesign.robot import LimitModel
from expdesign.solver.feasibility import InfeasibleLimitsError, random_start

POINTS = 40
WIDTH = 0.4


def violations(problem, x):
    phases = 2 * np.pi * np.arange(POINTS) / POINTS
    return problem.smooth_violations(x, phases, WIDTH)


def draw(problem, seed):
    return random_start(problem, np.random.default_rng(seed), POINTS, WIDTH)


@pytest.mark.parametrize("seed", range(8))
def test_it_keeps_the_limits_and_is_no_small_motion(problem, seed):
    x = draw(problem, seed)
    assert x.shape == (problem.variables.size,)
    worst = np.max(violations(problem, x))
    assert worst <= 0
    # Shrunk as far as it must be: half as large again is too large.
    larger = np.append(1.5 * x[:-1], x[-1])
    assert np.max(violations(problem, larger)) > 0


def test_omega_is_within_its_bounds(problem):
    lower, upper = problem.variables.omega_bounds
    for seed in range(8):
        assert lower <= problem.variables.trajectory(draw(problem, seed)).omega <= upper


def test_every_coordinate_moves(problem):
    trajectory = problem.variables.trajectory(draw(problem, 0))
    assert np.all(np.abs(trajectory.mu) > 0)
    assert np.all(np.abs(trajectory.nu) > 0)


def test_the_generator_decides(problem):
    np.testing.assert_array_equal(draw(problem, 3), draw(problem, 3))
    assert np.max(np.abs(draw(problem, 3) - draw(problem, 4))) > 0.01


def test_limits_that_no_motion_keeps_are_named(problem):
    """Struts that may not change their length by more than a nanometre."""
    home = float(problem.robot.inverse_kinematics(problem.robot.home)[0])
    limits = tuple(
        dataclasses.replace(limit, lower=np.full(6, home - 1e-9), upper=np.full(6, home + 1e-9))
        if limit.key == "strut_length"
        else limit
        for limit in problem.limits.limits
    )
    tight = dataclasses.replace(problem, limits=LimitModel(problem.robot, limits))
    with pytest.raises(InfeasibleLimitsError, match="strut_length") as caught:
        draw(tight, 0)
    for other in ("alpha", "tilt", "actuator_force"):
        assert other not in str(caught.value)
