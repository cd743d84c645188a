"""The independent simulator: the model without effects, and every effect as it is stated."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from expdesign.configuration import load_run
from expdesign.recheck.followed_lengths import FollowedLengths
from expdesign.robot import load_robot, robot_from
from expdesign.trajectory import TrajectoryFile
from tests.unknowns.simulator import (
    EFFECTS,
    Machine,
    Motion,
    Sensors,
    changed_parameters,
    follow_lengths,
    simulate,
)

ROOT = Path(__file__).parents[2]
FILES = {
    "palida": ROOT / "expdesign/library/robots/palida.yaml",
    "irregular": Path(__file__).parent / "irregular.yaml",
}
NEUTRAL = {"power_law": 1.0, "base_on_springs": 1e9, "presliding": 1e-9}
SIZES = {"power_law": 0.9, "base_on_springs": 15.0, "presliding": 1e-3, "clock_jitter": 1e-3}
DISSIPATING = {
    "quadratic_friction": 0.1,
    "viscous_joints": 0.1,
    "viscous_balls": 0.1,
    "load_friction": 0.01,
    "slow_stribeck": 0.1,
    "cable_drag": 1.0,
    "base_on_springs": 15.0,
    "direction_friction": 0.1,
    "liquid": 0.5,
    "ball_friction": 0.3,
}


def motion(name):
    home = np.array(yaml.safe_load(FILES[name].read_text())["home"], dtype=float)
    scale = np.array([0.2, 0.2, 0.15, 0.3, 0.3, 0.3])[:, None]
    return Motion(3.7, home, *(scale * np.random.default_rng(1).standard_normal((2, 6, 3))))


def recorded(name, effects=None, count=400, **options):
    moving = motion(name)
    times = np.linspace(0, moving.period, count, endpoint=False)
    rng = np.random.default_rng(2)
    machine = Machine.read(FILES[name])
    return (
        machine,
        moving,
        times,
        simulate(machine, moving, times, effects, rng=rng, **options),
    )


@pytest.mark.parametrize("name", FILES)
def test_without_effects_it_is_the_model(name):
    robot = robot_from(load_run({"name": "check", "robot": str(FILES[name])}).robot)
    _, moving, times, (lengths, forces) = recorded(name)
    state = moving.at(times)
    np.testing.assert_allclose(lengths, robot.inverse_kinematics(state[0]), rtol=0, atol=1e-13)
    np.testing.assert_allclose(forces, robot.actuator_forces(*state), rtol=0, atol=1e-9)


def test_a_controller_that_follows_lengths_moves_as_the_package_says():
    """Newton's method with differences and a Fourier series, against rates by the Jacobian."""
    drawn, rng, zeros = Machine.read(FILES["palida"]), np.random.default_rng(5), np.full(6, 2e-4)
    shift = 5e-4 * rng.standard_normal((6, 3))
    moved = replace(drawn, base_joints=drawn.base_joints + shift)
    path = ROOT / "benchmarks" / "designs" / "palida.json"
    design, robot = TrajectoryFile.read(path).trajectory, load_robot(FILES["palida"])
    joints = (robot.description.base_joints + shift).tolist()
    given = robot.description.description.model_dump(exclude_none=True) | {"base_joints": joints}
    machine = robot_from(load_run({"name": "moved", "robot": given}).robot)
    found = follow_lengths(moved, drawn, Motion.read(json.loads(path.read_text())), zeros)
    times = rng.uniform(0, design.period, 50)
    wanted = FollowedLengths(design, robot, machine, zeros).sample(times)
    for one, other, share in zip(found.at(times), wanted, (1e-11, 1e-10, 1e-8), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=share * np.abs(other).max())


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_of_no_size_changes_nothing(effect):
    *_, plain = recorded("palida")
    *_, found = recorded("palida", {effect: NEUTRAL.get(effect, 0.0)})
    for one, other in zip(found, plain, strict=True):
        # Presliding on a grid has another sign close to a reversal.
        share = np.mean(np.abs(one - other) > 1e-6)
        assert share <= (0.005 if effect == "presliding" else 0)


@pytest.mark.parametrize("effect", EFFECTS)
def test_an_effect_changes_forces_or_lengths_but_not_both(effect):
    *_, plain = recorded("irregular")
    *_, found = recorded("irregular", {effect: SIZES.get(effect, 0.01)})
    lengths, forces = (np.max(np.abs(a - b)) for a, b in zip(found, plain, strict=True))
    if effect == "clock_jitter":
        assert lengths > 1e-5
        assert forces > 0.1
    elif effect == "length_delays":
        assert lengths > 1e-5
        assert forces == 0
    else:
        assert lengths == 0
        assert 1e-4 < forces < 100


@pytest.mark.parametrize("effect", DISSIPATING)
def test_dissipation_takes_power_from_the_actuators(effect):
    size = DISSIPATING[effect]
    machine, moving, times, (_, plain) = recorded("palida", count=2000)
    *_, (_, found) = recorded("palida", {effect: size}, count=2000)
    now = machine.move(moving, times)
    power = np.mean(np.sum((found - plain) * now.length_rates, axis=1))
    assert power > 0
    if effect == "viscous_joints":
        expected = size * np.mean(np.sum(now.alpha_rate**2 + now.beta_rate**2, axis=1))
        np.testing.assert_allclose(power, expected, rtol=1e-9)


def test_stated_sizes():
    machine, moving, times, (lengths, forces) = recorded("palida")
    now = machine.move(moving, times)

    def change(effect, size):
        return recorded("palida", {effect: size})[-1][1] - forces

    np.testing.assert_allclose(
        change("drive_inertia", 0.03), 0.03 * now.length_accelerations, atol=1e-9
    )
    np.testing.assert_allclose(
        change("saturation", 0.01), 0.01 * forces**3 / 200**2, rtol=1e-9, atol=1e-9
    )
    friction = machine.each("r") + machine.each("v") * np.abs(now.length_rates)
    np.testing.assert_allclose(change("direction_friction", 0.02), 0.02 * friction, atol=1e-9)
    late = change("low_pass", 5e-4)
    np.testing.assert_array_equal(late[:, ::2], 0)
    before = machine.forces(machine.move(moving, times - 5e-4))
    # A delay of the same size, except close to the jumps of dry friction.
    off = np.median(np.abs(forces + late - before)[:, 1::2])
    assert off < 0.01 * np.median(np.abs(forces - before))
    sensors = Sensors(zeros=np.full(6, 1e-4), gains=np.full(6, 0.01), delay=5e-4)
    *_, (off_zero, amplified) = recorded("palida", sensors=sensors)
    np.testing.assert_allclose(off_zero - lengths, 1e-4, atol=1e-12)
    np.testing.assert_allclose(amplified, 1.01 * before, rtol=1e-12)


def test_another_platform_has_other_parameters():
    """Of a model with these parameters they are the truth."""
    machine = Machine.read(FILES["irregular"])
    changed = changed_parameters(machine, {"off_centre": 1e-3, "drive_inertia": 0.1})
    moved = {name for name, value in changed.items() if value != machine.parameters[name]}
    assert moved == {"sx", "sy"}
    mass = machine.parameters["p10"]
    assert changed["sx"] - machine.parameters["sx"] == pytest.approx(0.8e-3 * mass)
