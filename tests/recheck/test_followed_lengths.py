"""The harmonics that tolerances can raise, against machines that follow lengths."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.enclosure.paths import EnclosedSeries
from expdesign.recheck.followed_lengths import (
    FollowedLengths,
    RecordedNoise,
    followed_harmonics,
    raised_harmonics,
)
from expdesign.recheck.followed_path import certify_followed
from expdesign.robot import LimitModel, Robot, robot_from
from expdesign.robot.deviation import apply_deviations, toleranced_deviations
from expdesign.trajectory import TrajectoryFile
from tests.diagnostics.conftest import excitation

DESIGN = Path(__file__).parents[2] / "benchmarks" / "designs" / "palida.json"
MOTION = TrajectoryFile.read(DESIGN).trajectory
NOISE, SAMPLES = 25e-12 * np.eye(6), 2000.0


def robot(**tolerances):
    return robot_from(load_run({"name": "n", "robot": "palida", "tolerances": tolerances}).robot)


def test_harmonics_left_out_show_by_less_than_the_noise_of_one_parameter():
    """Chi-squared of the lengths of each machine without its higher harmonics."""
    about = robot(base_joints="0.1 mm")
    found = raised_harmonics(about, MOTION, RecordedNoise(NOISE, None, SAMPLES, 240))
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
    recorded = RecordedNoise(NOISE, np.eye(6), SAMPLES, 240)
    assert raised_harmonics(robot(**tolerances), MOTION, recorded) == 5


@pytest.mark.parametrize("size", [0.0, 2.0, 3.0])
def test_a_single_machine_has_the_harmonics_that_its_own_motion_shows(size):
    """Deviations of three tolerances raise more than the tolerances do, up to a singular pose."""
    about = robot(base_joints="1 mm")
    chosen = toleranced_deviations(about)
    shifts = size * 1e-3 * np.random.default_rng(1).choice([-1, 1], len(chosen))
    machine = apply_deviations(about, chosen, shifts)
    followed = FollowedLengths(MOTION, about, machine, np.zeros(6))
    recorded = RecordedNoise(NOISE, None, SAMPLES, 1000)
    found = followed_harmonics(followed, MOTION.omega, about.parameters, recorded, 5)
    times = MOTION.sample_times(1000)
    lines = np.fft.rfft(followed.sample(times).pose, axis=0)

    def shown(harmonics):
        rest = lines.copy()
        rest[: harmonics + 1] = 0
        slope = machine.length_jacobian(followed.sample(times).pose)
        off = slope @ np.fft.irfft(rest, len(times), axis=0)[:, :, None]
        return SAMPLES * np.sum(off**2) / NOISE[0, 0] / len(times)

    assert shown(found) <= 3
    assert found == 5 if size == 0 else shown(found - 1) > 3
    assert size < 3 or found > raised_harmonics(about, MOTION, recorded)


def test_a_machine_without_a_pose_has_the_most_harmonics_of_the_samples():
    about = robot(base_joints="1 mm")
    followed = FollowedLengths(MOTION, about, about, np.full(6, 10.0))
    recorded = RecordedNoise(NOISE, None, SAMPLES, 91)
    assert followed_harmonics(followed, MOTION.omega, about.parameters, recorded, 5) == 30
    assert followed_harmonics(followed, MOTION.omega, about.parameters, recorded, 40) == 40


@pytest.mark.parametrize("zeros", [0.0, 0.02])
def test_limits_are_proved_along_a_path_far_from_the_design(zeros):
    """With joints off by up to 20 mm; what is proved is the excess at the samples, and no less."""
    motion, controller, rng = excitation(), robot(), np.random.default_rng(4)
    moved = {
        name: getattr(controller.description, name) + rng.uniform(-0.02, 0.02, (6, 3))
        for name in ("base_joints", "platform_joints")
    }
    machine = Robot(replace(controller.description, **moved))
    followed = FollowedLengths(motion, controller, machine, np.full(6, zeros))
    model = LimitModel.of(machine)
    checks = certify_followed(model, followed, EnclosedSeries(motion))
    states = followed.sample(np.linspace(0, motion.period, 5001))
    values = model.values(np.hstack([states.pose, states.rate, states.acceleration]))
    for limit, columns in zip(model.limits, model.columns, strict=True):
        (check,) = (one for one in checks if one.key == limit.key)
        found, size = values[:, columns], limit.upper - limit.lower
        excess = np.maximum(found - limit.upper, limit.lower - found)
        share = excess / np.where(np.isfinite(size), size, np.abs(check.bound))
        assert np.max(share) <= check.proved + 1e-9, check.key
        assert check.proved == pytest.approx(np.max(share), abs=1e-5), check.key
