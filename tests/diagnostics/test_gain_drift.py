from dataclasses import replace

import numpy as np
import pytest
from scipy import signal, stats

from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.gain_drift import gain_drift
from estimation.diagnostics.linearisation import linearise
from estimation.diagnostics.significance import GAIN_DRIFT
from estimation.processing.spectrum import scaling_filter
from tests.diagnostics.conftest import Laboratory

PERIODS = 6
DRAWS = 200


@pytest.fixture(scope="module")
def lab():
    return Laboratory(samples=100, periods=PERIODS)


@pytest.fixture(scope="module")
def sample(lab):
    experiment = lab.experiment(lab.measure(1), lab.noise)
    estimate = lab.estimate([experiment])
    motion = experiment.fit.motion
    part = linearise(lab.robot, experiment, estimate.values, lab.knowledge.free, motion)
    return experiment, part


def _drawn(lab, sample, rng, *, drift=0.0, memory=0.0):
    """Return the experiment with other noise, and gains that change by `drift` in all."""
    experiment, part = sample
    predicted = experiment.forces - part.force_rows
    rows = PERIODS * lab.samples
    noise = rng.standard_normal((rows + 200, 6))
    noise = signal.lfilter([np.sqrt(1 - memory**2)], [1, -memory], noise, axis=0)[200:]
    noise = (noise @ np.linalg.cholesky(lab.noise.forces.covariance).T).reshape(PERIODS, -1, 6)
    time = np.linspace(-0.5, 0.5, PERIODS)[:, None, None]
    periods = predicted * (1 + drift * time) + noise
    forces = replace(experiment.recording.forces, periods=periods, values=periods.mean(axis=0))
    record = replace(experiment.recording, forces=forces)
    rest = periods.mean(axis=0) - predicted
    return replace(experiment, recording=record), replace(part, force_rows=rest)


@pytest.mark.parametrize("memory", [0.0, 0.9])
def test_level(lab, sample, memory):
    """With memory that the stated Σ knows nothing of, too."""
    rng = np.random.default_rng(3)
    tests = [gain_drift(*_drawn(lab, sample, rng, memory=memory), 0.05) for _ in range(DRAWS)]
    rejected = sum(bool(test.found) for test in tests)
    assert stats.binom.sf(rejected - 1, DRAWS, 0.05) > 0.001
    scales = np.mean([test.scale for test in tests])
    assert (scales > 5) if memory else (abs(scales - 1) < 0.06)


def test_means_over_periods_with_lost_samples_show_no_single_period(lab, sample):
    experiment, part = sample
    forces = replace(experiment.recording.forces, periods=None)
    lost = replace(experiment, recording=replace(experiment.recording, forces=forces))
    assert gain_drift(lost, part, 0.05).refused


def test_drifts_are_found_where_they_are(lab, sample):
    rng = np.random.default_rng(4)
    planted = np.array([0.0, 0.0, -0.5, 0.6, 0.0, 0.0])
    tests = [gain_drift(*_drawn(lab, sample, rng, drift=planted), GAIN_DRIFT) for _ in range(30)]
    right = [test for test in tests if {each.actuator for each in test.found} == {2, 3}]
    assert len(right) >= 27
    for actuator in (2, 3):
        own = [each for test in right for each in test.found if each.actuator == actuator]
        errors = [(each.change - planted[actuator]) / each.std for each in own]
        assert abs(np.mean(errors)) < 4 / np.sqrt(len(errors))
        assert 0.6 < np.std(errors) < 1.5


def test_one_drift_of_all_gains_is_one_cause(lab, sample):
    rng = np.random.default_rng(5)
    tests = [gain_drift(*_drawn(lab, sample, rng, drift=-0.3), GAIN_DRIFT) for _ in range(20)]
    assert sum([each.actuator for each in test.found] == [None] for test in tests) >= 17


def test_an_offset_that_drifts_is_no_gain_with_noise_that_grows(lab, sample):
    experiment, part = sample
    predicted, noise = experiment.forces - part.force_rows, lab.noise.forces
    size, root = 1 + np.abs(predicted) / 40, np.linalg.cholesky(noise.covariance)
    weights = replace(scaling_filter(noise.covariance, lab.samples), size=size)
    model = replace(experiment.noise, forces=replace(noise, filter=weights))
    time, rng = np.linspace(-0.5, 0.5, 12), np.random.default_rng(6)
    for _ in range(20):
        periods = predicted + size * (rng.standard_normal((12, lab.samples, 6)) @ root.T)
        periods[:, :, 0] += 2 * np.sqrt(noise.covariance[0, 0]) * time[:, None]
        forces = replace(experiment.recording.forces, periods=periods, values=periods.mean(axis=0))
        recording = replace(experiment.recording, forces=forces)
        drawn = replace(experiment, recording=recording, noise=model)
        rows = replace(part, force_rows=forces.values - predicted)
        assert not gain_drift(drawn, rows, GAIN_DRIFT).found


def test_a_warming_motor_makes_the_estimate_doubtful(lab):
    data = lab.measure(7)
    forces = data.forces.copy()
    forces[:, 3] *= 1 - 0.48 * np.arange(len(forces)) / len(forces)
    for kept in (None, slice(0, 3 * lab.samples)):
        rows = slice(None) if kept is None else kept
        short = replace(data, time=data.time[rows], lengths=data.lengths[rows], forces=forces[rows])
        experiment = lab.experiment(short, lab.noise)
        result = diagnose(lab.robot, [experiment], lab.knowledge, lab.estimate([experiment]))
        test = result.recordings[0].tests.gain_drift
        if kept is not None:
            assert "scatter" in test.refused
            continue
        assert [each.actuator for each in test.found] == [3]
        assert test.found[0].change == pytest.approx(-0.4, abs=5 * test.found[0].std)
        assert any("drifts" in finding.contradiction for finding in result.verdict.failed)


def test_periods_of_no_whole_number_of_samples(lab):
    data = lab.measure(8, samples=100.3)
    forces = data.forces.copy()
    forces[:, 3] *= 1 - 0.5 * np.arange(len(forces)) / len(forces)
    experiment = lab.experiment(replace(data, forces=forces), lab.noise)
    assert not experiment.recording.averaged
    result = diagnose(lab.robot, [experiment], lab.knowledge, lab.estimate([experiment]))
    found = result.recordings[0].tests.gain_drift.found
    assert [each.actuator for each in found] == [3]
