"""The hand-derived regressor against automatic differentiation of the energies."""

import dataclasses

import numpy as np
import pytest

from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.terms import DEFAULT, terms_named
from expdesign.robot import Robot, load_robot
from tests.robot.energies import COLUMNS, Energies

LARGEST_CONDITION = 30
STATES = 6


@pytest.fixture(scope="module")
def template():
    """A valid description whose numbers are replaced."""
    return load_robot_description("palida")


def _unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _random_robot(rng, template):
    """Random joints, first axes, gravity and parameters, nothing symmetric."""
    size = 10 ** rng.uniform(-1, 0.7)
    base = size * rng.uniform(-1, 1, (6, 3))
    joints = size * rng.uniform(0.3, 0.8) * rng.uniform(-1, 1, (6, 3))
    home = np.concatenate([size * rng.uniform(-1, 1, 3), rng.uniform(-0.5, 0.5, 3)])
    home[:3] += size * 2 * _unit(rng.normal(size=3))
    values = rng.normal(size=29) * 10 ** rng.uniform(-2, 1, 29)
    return Robot(
        dataclasses.replace(
            template,
            home=home,
            gravity=rng.uniform(1, 15) * _unit(rng.normal(size=3)),
            base_joints=base,
            platform_joints=joints,
            alpha_axes=_unit(rng.normal(size=(6, 3))),
            terms=terms_named(DEFAULT, general=True),
            parameters=dict(zip(COLUMNS, values, strict=True)),
            limits={},
            characteristic_length=float(np.sqrt(np.mean(np.sum(joints**2, axis=1)))),
        )
    )


def _energies(robot):
    d = robot.description
    return Energies(d.base_joints, d.platform_joints, d.alpha_axes, d.home, d.gravity)


def _random_state(rng, robot):
    size = np.repeat([robot.characteristic_length, 1.0], 3)
    pose = robot.home + size * rng.uniform(-0.6, 0.6, 6)
    return pose, 2 * size * rng.normal(size=6), 10 * size * rng.normal(size=6)


def _condition(robot, pose):
    """Of the inverse Jacobian in twist coordinates, rotations scaled."""
    d = robot.description
    c, s = np.cos(pose[3:]), np.sin(pose[3:])
    R = (
        np.array([[1, 0, 0], [0, c[0], -s[0]], [0, s[0], c[0]]])
        @ np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
        @ np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1]])
    )
    arms = d.platform_joints @ R.T
    u = _unit(pose[:3] + arms - d.base_joints)
    return np.linalg.cond(np.hstack([u, np.cross(arms, u) / d.characteristic_length]))


def _cases(seed, count, template):
    """Yield robots with states whose Jacobian and cardan joints are well conditioned."""
    rng = np.random.default_rng(seed)
    found = 0
    while found < count:
        robot = _random_robot(rng, template)
        states = [_random_state(rng, robot) for _ in range(4 * STATES)]
        motion = robot.strut_motion(*(np.array(part) for part in zip(*states, strict=True)))
        states = [
            state
            for state, beta in zip(states, motion.beta, strict=True)
            if np.max(np.abs(beta)) < 1.4 and _condition(robot, state[0]) <= LARGEST_CONDITION
        ][:STATES]
        if len(states) == STATES:
            found += 1
            yield robot, [np.array(part) for part in zip(*states, strict=True)]


@pytest.mark.parametrize("seed", range(4))
def test_forces_and_motion_of_random_general_hexapods(seed, template):
    for robot, states in _cases(seed, 10, template):
        assert robot.parameter_names == COLUMNS
        energies = _energies(robot)
        forces = robot.actuator_forces(*states)
        regressors = robot.regressor(*states)
        motion = robot.strut_motion(*states)
        for k, state in enumerate(zip(*states, strict=True)):
            expected, slope, (dalpha, dbeta) = energies.at(*state)
            # Column by column: friction included, all 29 of them.
            np.testing.assert_allclose(
                regressors[k] / np.maximum(1, np.abs(expected)),
                expected / np.maximum(1, np.abs(expected)),
                rtol=0,
                atol=1e-9,
            )
            Q = expected @ robot.parameters
            assert np.max(np.abs(forces[k] - Q) / np.maximum(1, np.abs(Q))) < 1e-9
            length, alpha, beta = energies.motion(state[0])
            np.testing.assert_allclose(motion.length[k], length, rtol=1e-12)
            np.testing.assert_allclose(motion.alpha[k], alpha, rtol=0, atol=1e-12)
            np.testing.assert_allclose(motion.beta[k], beta, rtol=0, atol=1e-12)
            np.testing.assert_allclose(motion.length_rate[k], slope @ state[1], rtol=1e-10)
            np.testing.assert_allclose(motion.alpha_rate[k], dalpha, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(motion.beta_rate[k], dbeta, rtol=1e-9, atol=1e-9)
            np.testing.assert_allclose(robot.length_jacobian(state[0]), slope, atol=1e-12)


def test_symmetric_is_general_without_lateral_terms(template):
    extra = np.isin(COLUMNS, ["sx", "sy", "Ixy", "Ixz", "Iyz"])
    for robot, states in _cases(11, 5, template):
        symmetric = Robot(
            dataclasses.replace(robot.description, terms=terms_named(DEFAULT, general=False))
        )
        assert symmetric.parameter_names == tuple(np.array(COLUMNS)[~extra])
        np.testing.assert_allclose(
            symmetric.regressor(*states), robot.regressor(*states)[:, :, ~extra], rtol=1e-12
        )
        values = np.where(extra, 0.0, robot.parameters)
        np.testing.assert_allclose(
            symmetric.actuator_forces(*states),
            robot.actuator_forces(*states, values),
            rtol=1e-11,
            atol=1e-9,
        )


@pytest.mark.parametrize("name", ["palida", "linuxcnc", "rubin", "mathworks", "dehaeze"])
def test_robots_that_ship(name):
    robot = load_robot(name)
    energies = _energies(robot)
    rng = np.random.default_rng(3)
    size = np.repeat([robot.characteristic_length, 1.0], 3)
    symmetric = [k for k, column in enumerate(COLUMNS) if column in robot.parameter_names]
    for _ in range(5):
        state = robot.home + 0.15 * size * rng.normal(size=6), *(size * rng.normal(size=(2, 6)))
        if _condition(robot, state[0]) > LARGEST_CONDITION:
            continue
        expected = energies.at(*state)[0][:, symmetric] @ robot.parameters
        forces = robot.actuator_forces(*state)
        assert np.max(np.abs(forces - expected) / np.maximum(1, np.abs(expected))) < 1e-9


def test_gravity_alone_at_rest(template):
    for robot, (poses, *_) in _cases(5, 3, template):
        energies = _energies(robot)
        for pose in poses:
            expected = energies.at(pose, np.zeros(6), np.zeros(6))[0]
            at_rest = robot.regressor(pose, np.zeros(6), np.zeros(6))
            np.testing.assert_allclose(at_rest, expected, rtol=1e-9, atol=1e-9)
            assert not np.any(at_rest[:, [0, 1, 2, 5, 6, 7, *range(12, 29)]])
