"""A call for one instant gives what the same instant gives among others, also to many threads."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple

import casadi as ca
import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.evaluation.batch import BatchFunction, Graph
from expdesign.library import robot_files
from expdesign.mechanism.terms import DEFAULT
from expdesign.robot import load_robot, robot_from

COUNT = 8


@pytest.fixture(scope="module")
def loaded():
    """Return PaLiDA with terms of which one depends on the load of the actuators."""
    palida = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    compensation = {"base_x": 0.1, "base_y": 0, "base_z": -1.3, "length": 0.7}
    terms = [
        *(*DEFAULT, "force_offset", {"cogging": {"pitch": 0.024}}, "cogging_second"),
        *({"gravity_compensation": compensation}, {"payload": {"x": 0.05}}, "load_friction"),
        *("asymmetric_friction", "quadratic_friction", "cubic_friction"),
        *("passive_viscous_friction", "platform_wrench", "platform_spring", "platform_drag"),
    ]
    return robot_from(load_run({"name": "n", "robot": palida | {"terms": terms}}).robot)


def motion(robot, seed=0):
    rng = np.random.default_rng(seed)
    size = np.repeat([0.05, 0.1], 3) * np.linalg.norm(robot.home[:3])
    pose = robot.home + size * rng.normal(size=(COUNT, 6))
    return pose, rng.normal(size=(COUNT, 6)), 3 * rng.normal(size=(COUNT, 6))


def close(found, expected):
    size = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize("name", robot_files())
def test_robots_that_ship(name):
    robot = load_robot(name)
    pose, rate, acceleration = motion(robot)
    parameters = robot.parameters * 1.3 + 0.1
    forces = robot.actuator_forces(pose, rate, acceleration)
    others = robot.actuator_forces(pose, rate, acceleration, parameters)
    struts = astuple(robot.strut_motion(pose, rate, acceleration))
    for k in range(COUNT):
        one = pose[k], rate[k], acceleration[k]
        close(robot.actuator_forces(*one), forces[k])
        close(robot.actuator_forces(*one, parameters), others[k])
        for found, expected in zip(astuple(robot.strut_motion(*one)), struts, strict=True):
            np.testing.assert_array_equal(found, expected[k])
    for function, arguments in (
        (robot.inverse_kinematics, (pose,)),
        (robot.length_jacobian, (pose,)),
        (robot.regressor, (pose, rate, acceleration)),
    ):
        expected = function(*arguments)
        for k in range(COUNT):
            # Lists are vectors too, and an array of one row stays one.
            one = [argument[k].tolist() for argument in arguments]
            np.testing.assert_array_equal(function(*one), expected[k])
            np.testing.assert_array_equal(
                function(*(np.array([each]) for each in one))[0], expected[k]
            )


def test_terms_take_the_load_at_the_parameters_that_are_given(loaded):
    pose, rate, acceleration = motion(loaded)
    parameters = loaded.parameters + 0.5
    for robot in (loaded, loaded.with_load_at(1.5 * loaded.parameters)):
        for given in ((), (parameters,)):
            forces = robot.actuator_forces(pose, rate, acceleration, *given)
            for k in range(COUNT):
                one = robot.actuator_forces(pose[k], rate[k], acceleration[k], *given)
                close(one, forces[k])


def test_results_are_memory_of_their_own():
    robot = load_robot("palida")
    pose, rate, acceleration = motion(robot)
    first = robot.actuator_forces(pose[0], rate[0], acceleration[0])
    kept = first.copy()
    robot.actuator_forces(pose[1], rate[1], acceleration[1])
    np.testing.assert_array_equal(first, kept)
    first[:] = 0
    again = robot.actuator_forces(pose[0], rate[0], acceleration[0])
    np.testing.assert_array_equal(again, kept)


def test_threads_share_a_robot():
    robot = load_robot("palida")
    pose, rate, acceleration = motion(robot)
    forces = robot.actuator_forces(pose, rate, acceleration)

    def often(k):
        return [robot.actuator_forces(pose[k], rate[k], acceleration[k]) for _ in range(200)]

    with ThreadPoolExecutor(COUNT) as threads:
        for k, found in enumerate(threads.map(often, range(COUNT))):
            close(np.array(found), np.broadcast_to(forces[k], (200, 6)))


def test_robots_go_to_other_processes_after_a_call():
    robot = load_robot("palida")
    pose, rate, acceleration = motion(robot)
    one = pose[0], rate[0], acceleration[0]
    forces, lengths = robot.actuator_forces(*one), robot.inverse_kinematics(pose[0])
    struts, regressor = robot.strut_motion(*one), robot.regressor(*one)
    for other in (pickle.loads(pickle.dumps(robot)), copy.deepcopy(robot)):
        np.testing.assert_array_equal(other.actuator_forces(*one), forces)
        np.testing.assert_array_equal(other.inverse_kinematics(pose[0]), lengths)
        np.testing.assert_array_equal(other.strut_motion(*one).length, struts.length)
        np.testing.assert_array_equal(other.regressor(*one), regressor)


def test_entries_that_are_zero_by_structure():
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    sparse = ca.SX(2, 3)
    sparse[0, 2], sparse[1, 0] = x[0] * p, x[1]
    function = BatchFunction(Graph("sparse", [x], [p], [sparse, x]))
    matrix, column = function.at(np.array([2.0, 3.0]), np.array([5.0]))
    np.testing.assert_array_equal(matrix, [[0, 0, 10], [3, 0, 0]])
    np.testing.assert_array_equal(column, [2, 3])
    with pytest.raises(ValueError, match="input 0: 3 values, not 2"):
        function.at(np.ones(3), np.ones(1))
