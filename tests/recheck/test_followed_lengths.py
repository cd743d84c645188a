"""The harmonics that tolerances can raise, against machines that follow lengths."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.recheck.followed_lengths import FollowedLengths, raised_harmonics
from expdesign.robot import robot_from
from expdesign.robot.deviation import apply_deviations, toleranced_deviations
from expdesign.trajectory import TrajectoryFile

DESIGN = Path(__file__).parents[2] / "benchmarks" / "designs" / "palida.json"
MOTION = TrajectoryFile.read(DESIGN).trajectory
NOISE, SAMPLES = 25e-12 * np.eye(6), 2000.0


def robot(**tolerances):
    return robot_from(load_run({"name": "n", "robot": "palida", "tolerances": tolerances}).robot)


def test_harmonics_left_out_show_by_less_than_the_noise_of_one_parameter():
    """Chi-squared of the lengths of each machine without its higher harmonics."""
    about = robot(base_joints="0.1 mm")
    found = raised_harmonics(about, MOTION, NOISE, None, SAMPLES, 240)
    times, shown = np.arange(240) * MOTION.period / 240, {found - 1: 0.0, found: 0.0}
    for one in toleranced_deviations(about):
        machine = apply_deviations(about, [one], np.array([one.tolerance]))
        machine = replace(machine, description=replace(machine.description, tolerances=None))
        pose = FollowedLengths(MOTION, about, machine, np.zeros(6)).sample(times).pose
        for harmonics in shown:
            lines = np.fft.rfft(pose, axis=0)
            lines[harmonics + 1 :] = 0
            fewer = np.fft.irfft(lines, len(times), axis=0)
            off = machine.inverse_kinematics(pose) - machine.inverse_kinematics(fewer)
            shown[harmonics] += SAMPLES * np.sum(off**2) / NOISE[0, 0] / len(times)
    assert MOTION.harmonics < found < 50
    assert shown[found] <= 1 < shown[found - 1]


@pytest.mark.parametrize(
    "tolerances",
    [
        {"channel_delay": {"lengths": "1 ms", "forces": "1 ms"}},
        {"delay": "1 ms", "clock": "1e-4"},
        {"force_constant": {"common": "10 %"}, "gravity": "1 deg"},
    ],
)
def test_errors_of_the_recording_move_no_machine(tolerances):
    noise = np.eye(6)
    assert raised_harmonics(robot(**tolerances), MOTION, NOISE, noise, SAMPLES, 240) == 5
