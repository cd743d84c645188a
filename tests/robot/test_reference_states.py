"""PaLiDA against an independent multibody computation of all its 19 bodies."""

import json
from pathlib import Path

import numpy as np
import pytest

from expdesign.robot import load_robot

REFERENCE = Path(__file__).parents[1] / "reference" / "palida_states.json"
MOTION = (
    "length",
    "length_rate",
    "length_acceleration",
    "alpha",
    "alpha_rate",
    "beta",
    "beta_rate",
)
TOLERANCE = 1e-9


@pytest.fixture(scope="module")
def reference():
    return json.loads(REFERENCE.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def robot():
    return load_robot("palida")


def _column(reference, name, states=None):
    return np.array([state[name] for state in states or reference["states"]])


def _all_states(reference):
    return tuple(_column(reference, name) for name in ("pose", "rate", "acceleration"))


def test_same_robot(reference, robot):
    about = robot.description
    for given, ours in (
        ("gravity", about.gravity),
        ("base_joints", about.base_joints),
        ("platform_joints", about.platform_joints),
        ("cardan_frames", robot.cardan_frames),
        ("home", robot.home),
        ("parameters", robot.parameters),
    ):
        np.testing.assert_allclose(ours, reference[given], rtol=0, atol=1e-12, err_msg=given)


def test_forces_batched(reference, robot):
    expected = _column(reference, "force_rigid") + _column(reference, "force_friction")
    forces = robot.actuator_forces(*_all_states(reference))
    assert forces.shape == (80, 6)
    np.testing.assert_allclose(forces, expected, rtol=0, atol=TOLERANCE)


def test_rigid_and_friction_apart(reference, robot):
    names = robot.parameter_names
    rigid = np.array([name.startswith("p") for name in names])
    assert np.count_nonzero(rigid) == 10
    states = _all_states(reference)
    for key, share in (("force_rigid", rigid), ("force_friction", ~rigid)):
        forces = robot.actuator_forces(*states, np.where(share, robot.parameters, 0.0))
        np.testing.assert_allclose(
            forces, _column(reference, key), rtol=0, atol=TOLERANCE, err_msg=key
        )


def test_regressor(reference, robot):
    states = [state for state in reference["states"] if "regressor" in state]
    assert len(states) == 20
    rows = (_column(reference, name, states) for name in ("pose", "rate", "acceleration"))
    regressors = robot.regressor(*rows)
    assert regressors.shape == (20, 6, 24)
    expected = _column(reference, "regressor", states)
    np.testing.assert_allclose(regressors, expected, rtol=0, atol=TOLERANCE)


def test_kinematics_batched(reference, robot):
    states = _all_states(reference)
    motion = robot.strut_motion(*states)
    for name in MOTION:
        value = getattr(motion, name)
        assert value.shape == (80, 6)
        expected = _column(reference, name)
        np.testing.assert_allclose(value, expected, rtol=0, atol=TOLERANCE, err_msg=name)
    lengths = robot.inverse_kinematics(states[0])
    np.testing.assert_allclose(lengths, _column(reference, "length"), rtol=0, atol=TOLERANCE)


def test_one_by_one(reference, robot):
    for state in reference["states"]:
        triple = state["pose"], state["rate"], state["acceleration"]
        forces = robot.actuator_forces(*triple)
        assert forces.shape == (6,)
        expected = np.add(state["force_rigid"], state["force_friction"])
        np.testing.assert_allclose(forces, expected, rtol=0, atol=TOLERANCE)
        regressor = robot.regressor(*triple)
        assert regressor.shape == (6, 24)
        np.testing.assert_allclose(regressor @ robot.parameters, forces, rtol=0, atol=TOLERANCE)
        lengths = robot.inverse_kinematics(state["pose"])
        assert lengths.shape == (6,)
        np.testing.assert_allclose(lengths, state["length"], rtol=0, atol=TOLERANCE)
        motion = robot.strut_motion(*triple)
        for name in MOTION:
            value = getattr(motion, name)
            assert value.shape == (6,)
            np.testing.assert_allclose(value, state[name], rtol=0, atol=TOLERANCE, err_msg=name)


def test_a_batch_of_one_keeps_its_shape(reference, robot):
    pose, rate, acceleration = (rows[7:8] for rows in _all_states(reference))
    assert robot.inverse_kinematics(pose).shape == (1, 6)
    assert robot.regressor(pose, rate, acceleration).shape == (1, 6, 24)
    assert robot.actuator_forces(pose, rate, acceleration).shape == (1, 6)
    assert robot.strut_motion(pose, rate, acceleration).alpha_rate.shape == (1, 6)
    assert robot.forward_kinematics(robot.inverse_kinematics(pose)).shape == (1, 6)


def test_a_single_part_stands_for_all_rows(reference, robot):
    pose, rate, _ = _all_states(reference)
    still = robot.actuator_forces(pose, np.zeros(6), np.zeros((1, 6)))
    np.testing.assert_array_equal(still, robot.actuator_forces(pose, 0 * rate, 0 * rate))


def test_forward_kinematics(reference, robot):
    poses = _column(reference, "pose")
    found = robot.forward_kinematics(_column(reference, "length"))
    np.testing.assert_allclose(found, poses, rtol=0, atol=1e-10)
