"""States that models are tested at, and the functions that they are tested with."""

import numpy as np
import pytest

from estimation.controlmodel.model import model_functions, random_states, vectors_of
from expdesign.robot import LimitModel, load_robot


def test_states_keep_the_limits(robot):
    states = random_states(robot, 300, 1)
    assert states.shape == (300, 18)
    assert np.max(LimitModel.of(robot).violations(states)) <= 0
    np.testing.assert_array_equal(states[0], [*robot.home, *np.zeros(12)])
    np.testing.assert_array_equal(states, random_states(robot, 300, 1))


def test_a_machine_of_half_a_millimetre_per_second_has_as_many_states():
    assert len(random_states(load_robot("rubin"), 100, 0)) == 100


def test_forces_are_the_robots_and_their_parts_add_up(robot):
    vectors = vectors_of(robot, 0.0, 200, 0)
    pose, rate, acceleration = np.split(vectors.state, 3, axis=1)
    forces = robot.actuator_forces(pose, rate, acceleration)
    np.testing.assert_allclose(vectors.forces, forces, atol=1e-10)
    still = robot.actuator_forces(pose, 0 * rate, 0 * rate)
    np.testing.assert_allclose(vectors.rest, still, atol=1e-10)
    # Without its friction a robot has the rest of the forces; the load of the friction stays.
    friction = [term.is_friction for term in robot.terms for _ in term.parameters]
    free = robot.parameters * ~np.array(friction)
    others = robot.regressor(pose, rate, acceleration) @ free
    np.testing.assert_allclose(vectors.friction, forces - others, atol=1e-10)


@pytest.mark.parametrize("name", ["forces", "rest", "friction"])
def test_the_graphs_functions_give_the_same_forces(robot, name):
    """Elimination on Gᵀ, w and f, in NumPy, against what the robot returns."""
    function = model_functions(robot.terms)[name]
    # At rest friction by load is zero, a saturating force constant is not.
    by_load = "sat1" if name == "rest" else "mu1"
    assert function.loaded == (by_load in robot.parameter_names)
    vectors = vectors_of(robot, 0.0, 50, 0)
    machine = (robot.geometry_vector, robot.description.constants, robot.parameters)
    expected = getattr(vectors, name)
    for state, forces in zip(vectors.state, expected, strict=True):
        parts = np.split(state, 3)[: len(function.inputs)]
        found = None
        for _ in range(1 + function.loaded):  # the load first, which the forces are of
            load = [] if not function.loaded else [np.zeros(6) if found is None else found]
            transposed, *borne = (
                one.full().ravel(order="F") for one in function.function(*parts, *machine, *load)
            )
            wrench, along = borne[:2] if found is None else borne[-2:]
            found = np.linalg.solve(transposed.reshape(6, 6).T, wrench) + along
        np.testing.assert_allclose(found, forces, atol=1e-9)


def test_a_narrow_width_is_nearly_the_sign_and_a_wide_one_is_not(robot):
    exact, narrow, wide = (vectors_of(robot, width, 100, 0) for width in (0.0, 1e-4, 0.5))
    np.testing.assert_allclose(narrow.forces, exact.forces, atol=1e-6)
    assert np.max(np.abs(wide.forces - exact.forces)) > 1
