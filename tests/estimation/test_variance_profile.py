"""Noise whose size depends on the motion: found before outliers, weighted, and counted."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.finding import Status
from estimation.diagnostics.linearisation import linearise
from estimation.diagnostics.residuals import force_residuals
from estimation.identification import estimate_parameters, prepare_experiment
from estimation.processing import PeriodSource, fold_recording
from estimation.processing.variance import variance_profile
from tests.estimation.cases import ROBOT, measured, run, trajectory

MOTION = trajectory()
SIZE = "the noise has the same size throughout a period"
OUTLIERS = "no outliers"


def recording(seed, over, *, growth=3.0, periods=8, outliers=0):
    """Return a recording with force noise that grows to 1 + `growth` times its least size."""
    data = measured(MOTION, seed, force_scale=0.0, periods=periods)
    rng = np.random.default_rng([7, seed])
    motion = MOTION.sample(data.time)
    struts = ROBOT.strut_motion(motion.pose, motion.rate, motion.acceleration)
    size = np.abs(struts.length_rate if over == "speed" else data.forces)
    factor = 1 + growth * size / size.max(axis=0)
    factors = np.linalg.cholesky(ROBOT.description.noise.force_covariance)
    noise = 0.3 * factor * (rng.standard_normal(data.forces.shape) @ factors.T)
    for row in rng.integers(0, len(noise), outliers):
        noise[row, 2] += 20 * factors[2, 2] * factor[row, 2]
    return replace(data, forces=data.forces + noise)


def judged(data, **options):
    found = estimate_parameters(run({"estimators": ["gm", "ml"], **options}), data)
    return found, diagnose(found.robot, found.experiments, found.priors, found.best).verdict


def failed(verdict):
    return {finding.assumption for finding in verdict.findings if finding.failed}


@pytest.mark.parametrize("over", ["speed", "force"])
def test_noise_that_grows_is_no_outlier(over):
    data = recording(1, over)
    found, verdict = judged(data)
    assert verdict.status is Status.ACCEPTED, verdict.summary
    assert SIZE in failed(verdict)
    assert OUTLIERS not in failed(verdict)
    profile = found.experiments[0].recording.forces.profile
    assert profile.over == over
    assert np.all((profile.ratio > 2) & (profile.ratio < 5))
    # Weights that do not account for it are doubted, and so are intervals.
    _, white = judged(data, spectrum="white", noise="given")
    assert SIZE in failed(white)


@pytest.mark.parametrize("loss", ["squared", "huber"])
def test_outliers_are_judged_by_the_size_at_their_instant(loss):
    data = recording(2, "speed", outliers=6)
    found, verdict = judged(data, loss=loss)
    assert {SIZE, OUTLIERS} <= failed(verdict)
    taken = found.experiments[0].recording.weight_taken
    # Without the size some 3 % of the samples lost weight.
    assert taken == pytest.approx(6.0, abs=3.0) if loss == "huber" else taken == 0


def test_weights_of_scaled_white_noise_are_as_uncertain_as_without_its_size():
    """Both take Σ from the same scatter; its estimate costs 4 % of the variance."""
    fold = fold_recording(recording(1, "speed", periods=3), MOTION.omega, PeriodSource.DESIGN)
    noise = fold.forces.noise()
    assert noise.filter.smoothing == "white, scaled over the speed"
    assert noise.weighting_loss == fold.forces.scatter.weighting_loss > 1.03


def test_residuals_have_the_standard_deviation_of_their_instant():
    """With the mean one, those at high speed are twice as large as those at low."""
    experiment = prepare_experiment(run({"harmonics": 2}), ROBOT, recording(1, "speed"), MOTION)
    values, none = np.array(ROBOT.parameters), np.zeros(len(ROBOT.parameters), dtype=bool)
    part = linearise(ROBOT, experiment, values, none, experiment.fit.motion)
    found, speed = force_residuals(experiment, part), np.abs(part.speed)
    fast = speed > np.median(speed, axis=0)
    squares = (found.forces / found.std) ** 2
    ratio = np.sqrt(np.mean(squares[fast]) / np.mean(squares[~fast]))
    assert ratio == pytest.approx(1.0, abs=0.15)


def test_even_noise_has_no_profile():
    found = 0
    for seed in range(40):
        fold = fold_recording(measured(MOTION, seed), MOTION.omega, PeriodSource.DESIGN)
        found += fold.forces.profile is not None or fold.lengths.profile is not None
    assert found <= 1


def test_the_profile_of_noise_is_found():
    rng, phase = np.random.default_rng(0), np.linspace(0, 2 * np.pi, 800, endpoint=False)
    speed = np.abs(np.cos(phase))[:, None] * np.ones(6)
    noise = rng.standard_normal((8, 800, 6)) * (1 + 2 * speed)
    profile = variance_profile(noise, {"speed": speed})
    assert profile.over == "speed"
    truth = (1 + 2 * speed) / np.sqrt(np.mean((1 + 2 * speed) ** 2))
    assert np.sqrt(np.mean((profile.std / truth - 1) ** 2)) < 0.06
    np.testing.assert_allclose(profile.std, truth, rtol=0.3)


def test_noise_of_a_part_of_the_period():
    noise = np.random.default_rng(0).standard_normal((8, 800, 6))
    noise[:, 200:300] *= 3.0
    speed = np.abs(np.cos(np.linspace(0, 2 * np.pi, 800, endpoint=False)))[:, None] * np.ones(6)
    profile = variance_profile(noise, {"speed": speed})
    assert profile.over == "phase"
    assert np.mean(profile.std[220:280]) == pytest.approx(3 * np.mean(profile.std[400:]), rel=0.1)


@pytest.mark.parametrize("step", [2.5, 5.0, 50.0])
def test_rounding_is_no_profile(step):
    for seed in range(5):
        data = measured(MOTION, seed, force_scale=0.3)
        grid = step * np.sqrt(np.diag(ROBOT.description.noise.length_covariance))
        rounded = replace(data, lengths=np.round(data.lengths / grid) * grid)
        fold = fold_recording(rounded, MOTION.omega, PeriodSource.DESIGN)
        assert fold.lengths.scatter is not None
        assert fold.lengths.profile is None


def test_one_rounded_channel_leaves_the_profile_of_the_others():
    data = recording(1, "speed")
    forces = data.forces.copy()
    step = 5 * np.sqrt(ROBOT.description.noise.force_covariance[2, 2])
    forces[:, 2] = np.round(forces[:, 2] / step) * step
    rounded = replace(data, forces=forces)
    profile = fold_recording(rounded, MOTION.omega, PeriodSource.DESIGN).forces.profile
    assert profile.over == "speed"
    assert np.all(profile.std[:, 2] == 1)
    assert np.all(np.delete(profile.ratio, 2) > 2)


def test_a_size_near_zero_has_a_bounded_weight():
    speed = np.abs(np.cos(np.linspace(0, 2 * np.pi, 800, endpoint=False)))[:, None] * np.ones(6)
    noise = np.random.default_rng(0).standard_normal((8, 800, 6)) * speed**4
    std = variance_profile(noise, {"speed": speed}).std
    assert np.min(std) > 0.09
    np.testing.assert_allclose(np.mean(std**2, axis=0), 1)


def _coverage(count, **options):
    inside = []
    for seed in range(count):
        found, _ = judged(recording(100 + seed, "speed"), **options)
        best, m = found.best, len(ROBOT.parameters)
        half = stats.t.ppf(0.975, best.freedom[:m]) * best.std[:m]
        inside.append(np.abs(best.values[:m] - ROBOT.parameters) <= half)
    return np.mean(inside), np.mean([each[-6:] for each in inside])


@pytest.mark.slow
def test_intervals_hold_with_noise_that_grows():
    every, viscous = _coverage(15)
    assert every > 0.91
    assert viscous > 0.88


@pytest.mark.slow
@pytest.mark.full
def test_intervals_hold_with_noise_that_grows_in_many_recordings():
    every, viscous = _coverage(150)
    assert 0.93 < every < 0.97
    assert 0.93 < viscous < 0.97
