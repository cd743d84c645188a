"""Channels of recordings without a period, and wrong zeros without a design."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from benchmarks import channels
from estimation.channels.check import ChannelCheck, WrongChannelsError
from estimation.identification import estimate
from estimation.identification.recording import check_recording, fold_measurement
from estimation.kinematics import MotionFitError
from tests.estimation.cases import ROBOT, STEP, measured, run, trajectory

MOTION = trajectory(samples=320, harmonics=3)
ONE_PASS = {"estimators": ["gm"], "differentiation": "spline"}


def recording(seed=0, noise=0.3):
    return measured(MOTION, seed, periods=1.3, force_scale=noise)


def checked(data) -> ChannelCheck:
    case = run(ONE_PASS)
    return check_recording(case, ROBOT, fold_measurement(case, data, None), None)


def test_right_channels_are_right():
    found = checked(recording())
    assert (found.faults, found.silent, found.lag, found.unexplained) == ((), "", "", False)
    assert found.rest < 0.02
    assert STEP < found.least_lag() < 20 * STEP


def test_two_faults_at_once_are_refused_with_the_right_section():
    data, order = recording(1, 0.1), [0, 4, 2, 3, 1, 5]
    home = ROBOT.inverse_kinematics(ROBOT.home)
    wrong = replace(
        data,
        lengths=home + (data.lengths - home) * [1, 1, 1, -1, 1, 1],
        forces=(data.forces * [1, 1, -1, 1, 1, 1])[:, order],
    )
    with pytest.raises(WrongChannelsError) as refused:
        estimate(run(ONE_PASS, data={"offset": "home"}), wrong, refuse_channels=True)
    section = refused.value.details["data"]
    assert section["order"] == {"Q": [1, 5, 3, 4, 2, 6]}
    assert section["sign"] == {"q": [1, 1, 1, -1, 1, 1], "Q": [1, 1, -1, 1, 1, 1]}


def test_a_delay_and_a_silent_force_are_named():
    data, late = recording(2, 0.1), 6
    forces = data.forces[:-late]
    noise = np.random.default_rng(0).normal(size=len(forces))
    forces = np.where(np.arange(6) == 3, noise[:, None], forces)
    moved = replace(data, time=data.time[late:], lengths=data.lengths[late:], forces=forces)
    assert checked(moved).silent.startswith("Q4 does not follow the motion")
    whole = replace(moved, forces=data.forces[:-late])
    found = checked(whole)
    ((place, _),) = found.faults
    assert place == "delay"
    delay = float(found.keys["delay"]["forces"].removesuffix(" ms"))
    assert delay == pytest.approx(1e3 * late * STEP, abs=0.3e3 * STEP)


def test_noise_with_a_memory_is_noise():
    """Splines through the forces follow it, and their scatter is a part of it."""
    data, order = recording(3, 0.1), [0, 4, 2, 3, 1, 5]
    steps = np.random.default_rng(3).normal(size=data.forces.shape)
    noise = signal.lfilter([1.0], [1.0, -0.6], steps, axis=0)
    noise *= 0.15 * np.std(data.forces) / np.std(noise)
    found = checked(replace(data, forces=(data.forces + noise)[:, order]))
    assert found.faults == (("Q2 and Q5", "the forces 2 and 5 are swapped"),)
    assert found.sure
    added = np.sum(np.var(noise, axis=0)) / np.sum(np.var(data.forces + noise, axis=0))
    assert found.noise == pytest.approx(added + checked(data).noise, rel=0.3)


@pytest.mark.parametrize("size", [0.3, 0.6])
def test_an_error_of_the_model_is_no_noise(size):
    data = recording(4, 0.1)
    away = data.lengths - np.mean(data.lengths, axis=0)
    wrong = replace(data, forces=data.forces + size * np.std(data.forces) * (away / 0.05) ** 2)
    found = checked(wrong)
    assert not found.sure
    assert found.rest > 2 * found.noise


def test_a_low_pass_that_began_before_the_recording_is_no_certain_delay():
    data, late, begin = measured(MOTION, 5, periods=4, force_scale=0.1), 20, 320
    share = 1 - np.exp(-1 / late)
    forces = signal.lfilter([share], [1.0, share - 1.0], data.forces, axis=0)
    part = slice(begin, begin + 416)
    shot = replace(data, time=data.time[part], lengths=data.lengths[part], forces=forces[part])
    found = checked(shot)
    assert not (found.sure and "delay" in found.keys)


@pytest.mark.parametrize("rows", [16, 30, 42, 43, 48, 60])
def test_short_recordings_are_not_checked(rows):
    data = recording(0, 1.0)
    short = replace(
        data, time=data.time[:rows], lengths=data.lengths[:rows], forces=data.forces[:rows]
    )
    found = checked(short)
    assert found.unchecked == "fewer than 100 samples are of moving struts"
    assert (found.faults, found.as_given, found.silent) == ((), None, "")


def test_a_machine_at_rest_is_not_checked():
    data, rng = recording(0), np.random.default_rng(6)
    still = data.lengths[0] + 1e-5 * rng.normal(size=data.lengths.shape)
    forces = data.forces[0] + rng.normal(size=data.forces.shape)
    resting = replace(data, lengths=still, forces=forces)
    found = checked(resting)
    assert (found.faults, found.unchecked) == ((), "not all struts move")
    with pytest.raises(MotionFitError, match="hardly moves"):
        estimate(run(ONE_PASS), resting)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "faults", "seed"),
    [
        ("palida", ("sign of a force", "sign of a length"), 0),
        ("irregular", ("two lengths swapped", "delay"), 1),
        ("irregular", ("wrong zero",), 2),
        ("mathworks", ("two forces swapped", "factor 2"), 3),
    ],
)
def test_one_pass_with_ramps_on_other_machines(machine, faults, seed):
    """Odd seeds have noise with a memory."""
    assert channels._draw(machine, faults, seed, with_design=False, shot=True) == "right"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 5))
def test_a_wrong_zero_is_found_without_a_design(seed):
    """Wrong zeros give poses on the other side of a singular one."""
    assert channels._draw("irregular", ("wrong zero",), seed, with_design=False) == "right"
