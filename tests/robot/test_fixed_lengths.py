"""Columns of deviations at fixed lengths: the symbolic ones against those of a whole motion."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.configuration.parameters import Drive, Motor
from expdesign.robot import robot_from
from expdesign.robot.deviation import apply_deviations, toleranced_deviations
from expdesign.robot.fixed_lengths import (
    DeviationGroups,
    fixed_length_columns,
    fixed_length_graph,
    group_effects,
)
from expdesign.trajectory import FourierTrajectory

RUN = {"name": "x", "robot": "palida"}
TOLERANCES = {
    "channel_delay": {"forces": "0.5 ms", "lengths": "0.1 ms"},
    "low_pass": {"forces": "2 ms", "lengths": "0.3 ms"},
    "base_joints": "0.1 mm",
    "platform_joints": "0.1 mm",
    "strut_length": "0.1 mm",
    "force_constant": {"common": "0.5 %", "each": "0.5 %"},
    "gravity": "0.1 deg",
    "delay": "0.2 ms",
    "clock": "20 ppm",
    "terms": {"drive_inertia": "20 g", "stribeck": {"std": "0.5 N", "velocity": "0.05 m/s"}},
}


MOTOR = Motor(force_constant=(90.0,) * 6, resistance=tuple(200.0 + 5 * j for j in range(6)))
OF_MOTORS = {key: {"common": "2 %", "each": "1 %"} for key in ("constant", "resistance", "supply")}


@pytest.mark.parametrize("voltages", [False, True])
def test_state_and_motion_agree(voltages):
    run = load_run(RUN | {"tolerances": TOLERANCES | {"motor": OF_MOTORS}})
    drive = Drive(motor=MOTOR)
    robot = robot_from(replace(run.robot, drive=drive, forces_of_voltages=voltages))
    chosen = toleranced_deviations(robot)
    assert voltages == any(one.name.startswith("motor") for one in chosen)
    motion = _motion(robot)
    samples = motion.sample(motion.sample_times(128))
    found = fixed_length_columns(robot, samples, motion.omega, chosen)
    about = DeviationGroups.of(robot, chosen)
    graph, state, columns = fixed_length_graph(about)
    function = ca.Function(
        "columns", [state, graph.machine, graph.parameters, graph.width], [columns]
    )
    table = np.concatenate(
        [samples.pose, samples.rate, samples.acceleration, _rate(samples.acceleration, 2.5)], axis=1
    )
    extended = robot.extended
    effects = group_effects(robot, chosen)
    for k in (3, 40, 77):
        every = np.array(function(table[k], extended.machine, extended.parameters, 1e-9))
        expected = every[:, about.own :] @ effects
        own = found[k] * [one.tolerance for one in chosen]
        scale = np.max(np.abs(expected), axis=0)
        np.testing.assert_allclose(own / scale, expected / scale, rtol=0, atol=1e-6)


def _motion(robot):
    rng = np.random.default_rng(2)
    reach = np.array([0.04, 0.04, 0.03, 0.08, 0.08, 0.2])[:, None]
    return FourierTrajectory.from_displacements(
        2.5, robot.home, *(reach * rng.normal(size=(2, 6, 2)))
    )


def _rate(values, omega):
    lines = np.fft.rfft(values, axis=0)
    return np.fft.irfft(1j * omega * np.arange(len(lines))[:, None] * lines, axis=0)


@pytest.mark.parametrize("key", ["base_joints", "platform_joints", "gravity"])
def test_forces_of_a_deviating_machine_at_the_same_lengths(key):
    """Z θ is the change of the forces where the machine deviates and its lengths do not."""
    robot = robot_from(load_run(RUN | {"tolerances": {key: TOLERANCES[key]}}).robot)
    chosen = toleranced_deviations(robot)
    motion = _motion(robot)
    samples = motion.sample(motion.sample_times(128))
    theta = np.random.default_rng(4).normal(size=len(chosen))
    lengths = robot.inverse_kinematics(samples.pose)

    def forces(share):
        machine = apply_deviations(robot, chosen, share * theta)
        pose = machine.forward_kinematics(lengths, samples.pose)
        rate = _rate(pose, motion.omega)
        return machine.actuator_forces(pose, rate, _rate(rate, motion.omega))

    step = 1e-6
    expected = (forces(step) - forces(-step)) / (2 * step)
    found = fixed_length_columns(robot, samples, motion.omega, chosen) @ theta
    # A reversal of dry friction between the two machines is no derivative.
    jumped = np.abs(expected) > 1e3 * np.median(np.abs(expected))
    assert np.mean(jumped) < 0.01
    size = np.max(np.abs(found))
    np.testing.assert_allclose(found[~jumped] / size, expected[~jumped] / size, atol=1e-5)
