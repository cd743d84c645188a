"""The forward dynamics against the inverse one, energy, and the order of the integration."""

import json
from functools import cache
from itertools import pairwise

import numpy as np
import pytest

from estimation.feedforward.closed_loop import ForwardDynamics, Model
from estimation.twin.disturbances import cogging_force
from expdesign.configuration import load_run
from expdesign.configuration.experiment import Cogging
from expdesign.configuration.robot import load_robot_description
from expdesign.library import robot_files
from expdesign.mechanism.terms import DEFAULT
from expdesign.robot import load_robot, robot_from
from tests.feedforward.energy import energy

SHARP = 1e-14
"""m/s, width at which every sign is exact."""


@cache
def robot_of(name):
    """Return a robot that ships, or PaLiDA with all terms of a linear drive."""
    if name in robot_files():
        return load_robot(name)
    about = json.loads(load_robot_description("palida").description.model_dump_json())
    about["terms"] = [
        *DEFAULT,
        "force_offset",
        {"stribeck": {"velocity": 0.05}},
        "load_friction",
        {"cable": {"rest_length": 0.7}},
        {"force_saturation": {"force": 150}},
        *("passive_viscous_friction", {"platform_spring": {"z": -0.6}}, "platform_drag"),
    ]
    rng = np.random.default_rng(2)
    for letter, size in (("o", 4.0), ("s", 3.0), ("mu", 0.2), ("sat", 0.02), ("k", 40.0)):
        for j in range(1, 7):
            about["parameters"][f"{letter}{j}"] = size * rng.uniform(0.5, 1)
    about["parameters"] |= {"v_base": 0.07, "v_platform": 0.04, "k_y": 25.0, "d_x": 0.6}
    return robot_from(load_run({"name": "n", "robot": about}).robot)


def states_of(robot, count, seed=0):
    rng = np.random.default_rng(seed)
    length = robot.characteristic_length
    sizes = np.array([length] * 3 + [1.0] * 3)
    pose = robot.home + 0.1 * sizes * rng.normal(size=(count, 6))
    return pose, *(size * sizes * rng.normal(size=(count, 6)) for size in (1.0, 10.0))


@pytest.mark.parametrize("name", [*robot_files(), "all terms"])
def test_forces_of_a_motion_make_that_motion(name):
    robot = robot_of(name)
    pose, rate, acceleration = states_of(robot, 40)
    forces = robot.actuator_forces(pose, rate, acceleration)
    machine = ForwardDynamics(Model(robot, robot.parameters), SHARP)
    found = machine.acceleration(np.hstack([pose, rate]), forces)
    scale = np.abs(acceleration).max(axis=0)
    np.testing.assert_allclose(found / scale, acceleration / scale, rtol=0, atol=1e-8)


def test_parameters_are_those_of_the_model_that_is_given():
    """Also the ones that the load is taken at, of which the robot has others."""
    robot = robot_of("all terms")
    pose, rate, acceleration = states_of(robot, 10)
    values = robot.parameters * np.random.default_rng(3).uniform(0.8, 1.2, len(robot.parameters))
    model = Model(robot, values)
    found = ForwardDynamics(model, SHARP).acceleration(
        np.hstack([pose, rate]), robot.actuator_forces(pose, rate, acceleration, values)
    )
    np.testing.assert_allclose(found, acceleration, rtol=0, atol=1e-7)


def test_cogging_is_given_beyond_the_models_force():
    robot = robot_of("palida")
    pose, rate, acceleration = states_of(robot, 10)
    cogging = Cogging(amplitude=[9, 0, 3, 4, 5, 6], pitch=[0.03] * 6, phase=[0, 1, 2, 3, 4, 5])
    forces = robot.actuator_forces(pose, rate, acceleration)
    forces = forces + cogging_force(robot.inverse_kinematics(pose), cogging)
    machine = ForwardDynamics(Model(robot, robot.parameters), SHARP, cogging)
    found = machine.acceleration(np.hstack([pose, rate]), forces)
    np.testing.assert_allclose(found, acceleration, rtol=0, atol=1e-8)


def frictionless(robot):
    dry = [name[0] in "rv" for name in robot.parameter_names]
    return np.where(dry, 0.0, robot.parameters)


def test_masses_of_the_struts_are_those_of_the_energy():
    """M of ½ q̇ᵀ M q̇, by second differences of the energy, which is quadratic in the rates."""
    robot = robot_of("palida")
    values = frictionless(robot)
    pose = robot.home + np.array([0.02, -0.05, 0.03, 0.1, -0.05, 0.2])
    to_pose = np.linalg.inv(robot.length_jacobian(pose))

    def kinetic(speeds):
        return energy(robot, values, pose, to_pose @ speeds)

    unit, still = np.eye(6), kinetic(np.zeros(6))
    expected = [[kinetic(a + b) - kinetic(a) - kinetic(b) + still for a in unit] for b in unit]
    found = ForwardDynamics(Model(robot, values), 1e-3).mass_matrix(pose)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)
    assert np.linalg.eigvalsh(found)[0] > 0


def fall(robot, values, start, steps, duration=0.1, forces=0.0, width=1e-3):
    """Return the states at all steps of a motion under constant forces, (steps + 1, 12)."""
    advance = ForwardDynamics(Model(robot, values), width).stepper(duration / steps)
    states = [start[None]]
    for _ in range(steps):
        states.append(advance(states[-1], np.full((1, 6), forces))[0])
    return np.concatenate(states)


START = np.array([0.02, -0.03, -0.66, 0.05, 0.1, -0.2, 0.4, -0.3, 0.2, 0.8, -0.6, 1.0])


def test_a_machine_without_friction_keeps_its_energy():
    robot = robot_of("palida")
    values = frictionless(robot)
    states = fall(robot, values, START, 100)
    energies = [energy(robot, values, state[:6], state[6:]) for state in states[::10]]
    kinetic = energies[0] - energy(robot, values, START[:6], np.zeros(6))
    assert states[-1, 2] < START[2] - 0.01
    np.testing.assert_allclose(energies, energies[0], rtol=0, atol=1e-7 * kinetic)


def test_the_steps_are_of_order_four():
    robot = robot_of("palida")
    ends = [fall(robot, frictionless(robot), START, n)[-1] for n in (20, 40, 80)]
    first, second = (np.abs(a - b).max() for a, b in pairwise(ends))
    assert 12 < first / second < 20


def test_power_is_spent_on_friction():
    robot = robot_of("palida")
    width, forces = 0.05, 30.0
    states = fall(robot, robot.parameters, START, 400, forces=forces, width=width)
    struts = robot.strut_motion(states[:, :6], states[:, 6:], np.zeros((len(states), 6)))
    p = robot.description.parameters
    dry, viscous = (np.array([p[f"{n}{j}"] for j in range(1, 7)]) for n in "rv")
    speed = struts.length_rate
    power = (forces - dry * np.tanh(speed / width) - viscous * speed) * speed
    for name, rate in (("r_alpha", struts.alpha_rate), ("r_beta", struts.beta_rate)):
        power = power - p[name] * np.tanh(rate * struts.length / width) * rate
    power = power.sum(axis=1)
    # Simpson's rule over all steps
    work = 0.1 / 400 / 3 * (power[0] + power[-1] + 4 * power[1::2].sum() + 2 * power[2:-1:2].sum())
    before, after = (
        energy(robot, robot.parameters, state[:6], state[6:]) for state in states[[0, -1]]
    )
    assert abs(work) > 1
    assert after - before == pytest.approx(work, rel=1e-6)


def test_the_longest_step_is_stable_and_a_few_of_them_are_not():
    robot = robot_of("palida")
    machine = ForwardDynamics(Model(robot, robot.parameters), 1e-4)
    longest = machine.longest_step(robot.home[None])
    at_rest = np.concatenate([robot.home, np.zeros(6)])
    holding = robot.actuator_forces(robot.home, np.zeros(6), np.zeros(6))[None]
    ends = []
    for factor in (1.0, 3.0):
        state = at_rest[None] + np.r_[np.zeros(6), np.full(6, 1e-8)]
        advance = machine.stepper(factor * longest)
        for _ in range(60):
            state, _ = advance(state, holding)
        ends.append(np.abs(state[0, 6:]).max())
    assert ends[0] < 1e-8
    assert ends[1] > 1e-6


def test_one_of_many_is_as_one_alone():
    robot = robot_of("palida")
    advance = ForwardDynamics(Model(robot, robot.parameters), 1e-3).stepper(2e-4)
    states = START + 0.01 * np.random.default_rng(1).normal(size=(3, 12))
    forces = np.random.default_rng(2).normal(size=(3, 6)) * 20
    together, lengths = advance(states, forces)
    for k in range(3):
        alone, _ = advance(states[k : k + 1], forces[k : k + 1])
        np.testing.assert_allclose(together[k], alone[0], rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(lengths, robot.inverse_kinematics(together[:, :6]), atol=1e-14)
