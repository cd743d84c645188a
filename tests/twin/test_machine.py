"""Elastic struts and delays: against the motion that the measured lengths and forces tell."""

import numpy as np
import pytest

from estimation.twin.machine import Machine
from expdesign.configuration import load_run
from expdesign.configuration.experiment import LowPass
from expdesign.robot import Robot, load_robot
from expdesign.trajectory import FourierTrajectory
from tests.twin.examples import motion

COMPLIANCE = np.array([0.5, 1.0, 2.0, 0.7, 0.0, 1.5]) * 1e-6
"""m/N; ten times that of a good strut."""

SAMPLES = 256


def robot(**parameters):
    """Return PaLiDA with parameters of its own."""
    mapping = load_run("palida").run.robot.model_dump(exclude_none=True)
    mapping["parameters"] |= parameters
    return Robot(load_run({"name": "n", "robot": mapping}).robot)


SMOOTH = robot(r_alpha=0, r_beta=0, **{f"r{j}": 0 for j in range(1, 7)})
FRICTION = np.array([SMOOTH.description.parameters[f"v{j}"] for j in range(1, 7)])


def derivative(values, period):
    """Return the derivative of one period of a smooth series."""
    lines = np.fft.rfft(values, axis=0)
    turns = 2j * np.pi / period * np.arange(len(lines))[:, None]
    return np.fft.irfft(lines * turns, n=len(values), axis=0)


def carried(poses, period):
    """Return the forces of the bodies along sampled poses, without the actuators' friction."""
    rates = derivative(poses, period)
    accelerations = derivative(rates, period)
    speeds = SMOOTH.strut_motion(poses, rates, accelerations).length_rate
    return SMOOTH.actuator_forces(poses, rates, accelerations) - FRICTION * speeds


def test_motion_and_forces_follow_from_what_the_motors_measure():
    """Solved the other way round: from lengths at the motors to the pose that made them."""
    made = motion()
    times = made.sample_times(SAMPLES)
    lengths, forces, positions = Machine(SMOOTH, COMPLIANCE).measure(made, times)
    assert positions is lengths
    poses = SMOOTH.forward_kinematics(lengths)
    first = np.abs(poses - made.sample(times).pose).max()
    for _ in range(6):
        shortened = lengths - COMPLIANCE * carried(poses, made.period)
        poses = SMOOTH.forward_kinematics(shortened, guess=poses)
    np.testing.assert_allclose(poses, made.sample(times).pose, atol=1e-10)
    assert first > 1e-5
    # The force of the motor: what it carries, and friction at its own speed.
    own = forces - carried(poses, made.period)
    np.testing.assert_allclose(own, FRICTION * derivative(lengths, made.period), atol=1e-6)
    platform = FRICTION * SMOOTH.strut_motion(*made.sample(times)).length_rate
    assert np.abs(own - platform).max() > 1e-4


def test_dry_friction_turns_where_the_motor_does():
    """With the strut at rest in its length the motor moves as the force grows."""
    still, turning = robot(r_alpha=0, r_beta=0), motion()
    times = turning.sample_times(2000)
    soft = Machine(still, np.full(6, 2e-5))
    lengths, forces, _ = soft.measure(turning, times)
    dry = np.array([still.description.parameters[f"r{j}"] for j in range(1, 7)])
    joint_signs = np.sign(still.strut_motion(*turning.sample(times)).length_rate)
    motor_signs = np.sign(derivative(lengths, turning.period))
    assert np.count_nonzero(joint_signs != motor_signs) > 3
    smooth, smooth_forces, _ = Machine(SMOOTH, soft.compliance).measure(turning, times)
    np.testing.assert_allclose(smooth, lengths, atol=1e-12)
    np.testing.assert_allclose(forces - smooth_forces, dry * motor_signs, atol=1e-6)


def test_what_acts_beside_the_motor_does_not_bend_the_strut():
    """Offsets, friction and cables change the motor's force and not its position."""
    plain = load_robot("palida")
    mapping = load_run("palida").run.robot.model_dump(exclude_none=True)
    mapping["terms"] = [*(t.name for t in plain.terms), "force_offset"]
    mapping["parameters"] |= {f"o{j}": 50.0 for j in range(1, 7)}
    pushed = Robot(load_run({"name": "n", "robot": mapping}).robot)
    times = motion().sample_times(50)
    (lengths, forces, _), (same, more, _) = (
        Machine(r, COMPLIANCE).measure(motion(), times) for r in (plain, pushed)
    )
    np.testing.assert_array_equal(same, lengths)
    np.testing.assert_allclose(more - forces, 50.0, atol=1e-9)


def test_a_platform_that_hangs_still_is_bent_by_its_weight():
    """By virtual work, without the regressor: the struts bear what the platform weighs."""
    light = robot(**{f"p{k}": 1e-12 for k in range(1, 6)}, p9=0.0, r_alpha=0, r_beta=0)
    still = FourierTrajectory(3.0, light.home, np.zeros((6, 1)), np.zeros((6, 1)))
    lengths, _, _ = Machine(light, COMPLIANCE).measure(still, np.zeros(1))
    jacobian = light.length_jacobian(light.home)
    weight = np.array([0, 0, light.description.parameters["p10"] * 9.81, 0, 0, 0])
    bent = lengths[0] - light.inverse_kinematics(light.home)
    np.testing.assert_allclose(bent, COMPLIANCE * np.linalg.solve(jacobian.T, weight), atol=1e-14)
    # A machine that hangs pulls, which makes the struts longer than their motors tell.
    assert np.all(bent[COMPLIANCE > 0] < 0)


def test_rigid_struts_are_the_robot_itself():
    plain, times = load_robot("palida"), np.linspace(0, 3, 500)
    lengths, forces, _ = Machine(plain, np.zeros(6)).measure(motion(), times)
    states = motion().sample(times)
    np.testing.assert_array_equal(lengths, plain.inverse_kinematics(states.pose))
    np.testing.assert_array_equal(forces, plain.actuator_forces(*states))


@pytest.mark.parametrize("compliance", [np.zeros(6), COMPLIANCE], ids=["rigid", "elastic"])
def test_forces_lag_behind_by_the_delay(compliance):
    machine, times = Machine(SMOOTH, compliance), motion().sample_times(400)
    lengths, forces, positions = machine.measure(motion(), times, delay=7e-4)
    plain, _, _ = machine.measure(motion(), times)
    earlier, driven, _ = machine.measure(motion(), times - 7e-4)
    np.testing.assert_allclose(lengths, plain, atol=1e-14)
    np.testing.assert_array_equal(forces, driven)
    np.testing.assert_array_equal(positions, earlier)


def test_low_passes_are_those_of_a_periodic_motion():
    machine, times = Machine(SMOOTH, np.zeros(6)), motion().sample_times(400)
    slow = LowPass(forces=(3e-3, 0, 0, 1e-3, 0, 0), lengths=(0, 1e-3, 0, 0, 0, 0))
    late = 1e-3
    plain = machine.measure(motion(), times, late)[:2]
    found = machine.measure(motion(), times, late, low_pass=slow)[:2]
    rates = 2 * np.pi * np.fft.rfftfreq(len(times), times[1] - times[0])
    for series, exact, constants in zip(found, plain, (slow.lengths, slow.forces), strict=True):
        lines = np.fft.rfft(exact, axis=0) / (1 + 1j * np.multiply.outer(rates, constants))
        expected = np.fft.irfft(lines, len(times), axis=0)
        np.testing.assert_allclose(series, expected, atol=1e-5 * np.abs(exact).max())
