"""How many harmonics the motion has: what the forces show of it that the lengths do not."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.finding import Status
from estimation.identification import estimate_parameters, prepare_experiment
from estimation.identification.recording import prepare_recording
from estimation.measurement_model import HarmonicMotion
from estimation.twin import Twin
from estimation.twin.machine import draw_machine
from expdesign.robot import robot_from
from expdesign.trajectory import TrajectoryFile
from tests.estimation.cases import ROBOT, measured, run, trajectory

MOTION = trajectory()
HIDDEN = 20
NOISY = {"length_scale": 10.0}
CONFIG = run()
DESIGN = Path(__file__).parents[2] / "benchmarks" / "designs" / "palida.json"


def with_hidden_harmonic():
    """Return the motion with 40 µm in its twentieth harmonic: 0.6 m/s²."""
    motion = HarmonicMotion.of(MOTION).with_harmonics(HIDDEN)
    motion.table[:2, HIDDEN] = 40e-6
    return motion.trajectory


def seen(data, design=MOTION, **changes):
    experiment = prepare_experiment(CONFIG, ROBOT, data, design, **changes)
    return experiment.fit.motion.harmonics, experiment.harmonics


def test_the_forces_show_what_the_lengths_hide():
    disturbed = with_hidden_harmonic()
    found = [seen(measured(disturbed, seed, **NOISY)) for seed in range(3)]
    assert [alone for alone, _ in found] == [2] * 3
    # By chance one more is found in a few of a hundred.
    assert sum(together == HIDDEN for _, together in found) >= 2
    assert all(together >= HIDDEN for _, together in found)


def test_forces_that_are_held_out_say_nothing():
    assert seen(measured(with_hidden_harmonic(), **NOISY), held_out=True) == (2, 2)


def test_without_hidden_harmonics_none_is_found():
    found = [seen(measured(MOTION, seed, **NOISY)) for seed in range(10)]
    assert sum(together > 2 for _, together in found) <= 2


@pytest.mark.slow
def test_ml_covers_with_them_and_says_that_others_do_not():
    disturbed = with_hidden_harmonic()
    pulls = []
    for seed in range(3):
        result = estimate_parameters(CONFIG, measured(disturbed, seed, **NOISY), MOTION)
        assert any("LS and GM" in warning for warning in result.warnings)
        pulls.append((result["ml"].values - ROBOT.parameters) / result["ml"].std)
    for name, status in (("gm", Status.DOUBTFUL), ("ml", Status.ACCEPTED)):
        experiments = [each.experiment for each in result.recordings]
        found = diagnose(result.robot, experiments, result.priors, result[name])
        assert found.verdict.status is status
    # 3 × 24 correlated errors: mean square 1 ± some 0.3.
    assert np.mean(np.square(pulls)) < 2.2


def test_it_is_said_where_ml_estimates_tolerances_with_the_parameters():
    """Its recording is prepared again for the machine as estimated, along the whole motion."""
    data = measured(with_hidden_harmonic(), **NOISY)
    for tolerances in ({}, {"force_constant": {"common": "0.5 %"}}):
        result = estimate_parameters(run(tolerances=tolerances), data, MOTION)
        assert (result["ml"].systematic is not None) is bool(tolerances)
        assert any("LS and GM" in warning for warning in result.warnings)


def test_cogging_is_no_motion():
    """The lengths are too precise to allow the motion that would explain the forces."""
    data = measured(MOTION)
    forces = data.forces + 80.0 * np.sin(2 * np.pi * data.lengths / 0.01)
    assert seen(replace(data, forces=forces)) == (2, 2)


@pytest.mark.parametrize("stated", [1, 5])
def test_without_a_design_many_strong_harmonics_are_found(stated):
    motion = trajectory(harmonics=8)
    config = run({"estimators": ["gm"]}, trajectory={"harmonics": stated})
    result = estimate_parameters(config, measured(motion))
    assert result.recordings[0].harmonics == 8


def test_lengths_that_the_machine_described_cannot_have():
    """Joints off by 1 mm near a singular pose: no motion follows the lengths to their noise."""
    tolerances = {"base_joints": "1 mm", "platform_joints": "1 mm", "strut_length": "0.3 mm"}
    design = TrajectoryFile.read(DESIGN).trajectory
    few = {"periods": 3, "sampling": 250 / design.period, "follows": "platform"}
    known = run(tolerances=tolerances, experiment=few)
    drawn = draw_machine(known, np.random.default_rng([0, 3])).configuration
    data = Twin.of(drawn, design, seed=3).measurement(1)
    recording = prepare_recording(known, robot_from(known.robot), data, design)
    (warning,) = (each for each in recording.warnings if "no motion of the machine" in each)
    wanted, taken = map(int, re.findall(r"\d+", warning))
    assert wanted > taken == recording.experiment.fit.motion.harmonics
