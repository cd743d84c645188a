from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from estimation.data.measurement import Measurement
from estimation.data.sensors import SensorResponse
from estimation.diagnostics.linearisation import linearise
from estimation.identification import estimate, estimate_parameters, prepare_experiment
from estimation.identification.periods import UnsuitableDataError
from estimation.processing import PeriodSource, fold_recording
from estimation.processing.noise import NoiseEstimate, huber_weights
from expdesign.configuration.estimate import DataSection
from expdesign.noise import lines_of, multiplicity
from tests.estimation.cases import ROBOT, STEP, measured, run, trajectory

NOISE = ROBOT.description.noise


@pytest.mark.parametrize("samples", [200, 200.4])
def test_covariances_agree_with_the_truth_within_their_own_uncertainty(samples):
    motion = trajectory(samples)
    scores = []
    for seed in range(40):
        record = fold_recording(
            measured(motion, seed, periods=6), motion.omega, PeriodSource.DESIGN
        )
        for found, true in (
            (record.forces.scatter, NOISE.force_covariance),
            (record.lengths.scatter, NOISE.length_covariance),
        ):
            error = NoiseEstimate(true, found.freedom).std_error()
            scores.append((found.covariance - true) / error)
    scores = np.array(scores)
    # 80 × 36 elements, 21 of which are different: mean 0, mean square 1. The friction's jumps
    # stay below a series' reach and add a little where the period is not whole.
    assert abs(scores.mean()) < 0.3
    assert 0.85 < np.mean(scores**2) < 1.2


def test_an_outlier_hardly_touches_robust_means_and_covariances():
    motion = trajectory()
    data = measured(motion, periods=8)
    data.forces[::97] += 900.0
    data.lengths[::61] -= 0.01
    clean = measured(motion, periods=8)
    plain = fold_recording(data, motion.omega, PeriodSource.DESIGN)
    robust = fold_recording(data, motion.omega, PeriodSource.DESIGN, robust=True)
    reference = fold_recording(clean, motion.omega, PeriodSource.DESIGN)

    def off(record):
        return np.sqrt(np.mean((record.forces.values - reference.forces.values) ** 2))

    assert off(robust) < 0.1 * off(plain)
    ratio = np.diag(robust.forces.scatter.covariance) / np.diag(NOISE.force_covariance)
    assert np.all(ratio < 1.2)
    assert np.all(np.diag(plain.forces.scatter.covariance) > 5 * np.diag(NOISE.force_covariance))


def dirty(motion, periods, seed=0):
    data = measured(motion, seed, periods=periods)
    data.forces[::53, 2] += 800.0
    data.lengths[::71, 4] += 0.01
    return data


@pytest.mark.parametrize("periods", [1, 2, 3, 8])
@pytest.mark.parametrize("samples", [200, 200.4])
def test_a_robust_record_has_the_covariance_of_clean_data(samples, periods):
    motion = trajectory(samples)
    clean = fold_recording(measured(motion, periods=periods), motion.omega, PeriodSource.DESIGN)
    record = fold_recording(dirty(motion, periods), motion.omega, PeriodSource.DESIGN, robust=True)
    lost = len(record.forces.values) * (periods if record.averaged else 1) / 53
    assert record.forces.counts.sum() < clean.forces.counts.sum() - 0.9 * lost
    if clean.forces.scatter is not None:
        for found, true in (
            (record.forces.scatter, NOISE.force_covariance),
            (record.lengths.scatter, NOISE.length_covariance),
        ):
            ratio = np.diag(found.covariance) / np.diag(true)
            assert np.all((ratio > 0.75) & (ratio < 1.3))


def test_outliers_are_no_pure_error_where_periods_cannot_be_averaged():
    """Nor in the scatter that lack of fit is compared with: a third more in strut 3."""
    motion = trajectory(200.4)
    scatters = []
    for loss, data in (("huber", dirty(motion, 8)), ("squared", measured(motion, periods=8))):
        experiment = prepare_experiment(run({"loss": loss, "harmonics": 2}), ROBOT, data, motion)
        free, along = np.ones(len(ROBOT.parameters), dtype=bool), experiment.fit.motion
        part = linearise(ROBOT, experiment, np.array(ROBOT.parameters), free, along)
        scatters.append(np.diag(part.force_scatter.covariance))
    np.testing.assert_allclose(*scatters, rtol=0.05)


@pytest.mark.parametrize("periods", [1, 2, 3, 4, 8])
def test_robust_weights_leave_clean_data_alone_whatever_the_number_of_periods(periods):
    motion = trajectory()
    kept = [
        fold_recording(
            measured(motion, seed, periods=periods),
            motion.omega,
            PeriodSource.DESIGN,
            robust=True,
        )
        for seed in range(10)
    ]
    for channels in ("forces", "lengths"):
        share = np.mean([getattr(record, channels).counts for record in kept]) / periods
        assert share > 0.998


@pytest.mark.parametrize("periods", [1, 4])
def test_outliers_of_coarsely_quantised_channels_lose_their_weight(periods):
    """Most differences are exactly zero: their median is no scale."""
    motion = trajectory()
    data = measured(motion, periods=periods, force_scale=0.0, length_scale=0.0)
    forces = np.round(data.forces / 50.0) * 50.0
    forces += np.where(np.random.default_rng(2).random(forces.shape) < 0.1, 50.0, 0.0)
    forces[::53, 2] += 5000.0
    coarse = Measurement(data.time, data.lengths, forces, data.step)
    record = fold_recording(coarse, motion.omega, PeriodSource.DESIGN, robust=True)
    hit = np.unique(np.arange(0, len(data), 53) % 200)
    assert np.all(record.forces.counts[hit] < periods - 0.9)


def test_two_periods_have_no_median():
    with pytest.raises(ValueError, match="3 periods, not 2"):
        huber_weights(np.zeros((2, 10, 6)))


def _without_noise(data, kind):
    """Return a recording with a channel that repeats exactly, or is that of another strut."""
    forces = data.forces.copy()
    forces[:, 2] = np.tile(forces[:100, 2], 5) if kind == "still" else forces[:, 1]
    return replace(data, forces=forces)


@pytest.mark.parametrize(
    ("kind", "words"), [("still", "Q3"), ("copy", "Q2 and Q3 have the same noise")]
)
def test_a_singular_covariance_of_the_noise(kind, words):
    motion = trajectory(100, 0.01)
    data = _without_noise(measured(motion, 1, step=0.01), kind)
    with pytest.raises(UnsuitableDataError, match=words):
        estimate_parameters(run(), data, motion)
    result = estimate(run({"noise": "given", "harmonics": 2}), data, motion)
    assert result.diagnostics.recordings[0].tests.lack_of_fit.refused
    assert np.all(result["ml"].std > 0)


def test_a_recording_that_is_given_twice_is_refused():
    motion = trajectory(100, 0.01)
    data, other = (measured(motion, seed, step=0.01) for seed in (1, 2))
    with pytest.raises(UnsuitableDataError, match="recordings 1 and 3 are the same"):
        estimate_parameters(run(), [data, other, replace(data, source="again.csv")], motion)


def test_windows_of_one_file_that_overlap_are_refused():
    """By their rows, whatever the files are called; windows one after the other are two."""
    motion = trajectory(100, 0.01)
    data = measured(motion, 1, periods=8, step=0.01)

    def window(first, last):
        values = {name: getattr(data, name)[first:last] for name in ("time", "lengths", "forces")}
        return replace(data, source=f"{first}.csv", **values)

    with pytest.raises(UnsuitableDataError, match="1 and 2 have 100 rows in common"):
        estimate_parameters(run(), [window(0, 500), window(400, 800)], motion)
    found = estimate_parameters(run({"estimators": ["ls"]}), [window(0, 400), window(400, 800)])
    assert len(found.recordings) == 2


@pytest.mark.parametrize("resolution", [1.0, 0.5])
def test_short_recordings_that_begin_at_rest_are_different(resolution):
    """Rows at rest are often equal in coarse units: no pair of ten is refused, but an overlap."""
    motion = trajectory(100, 0.01)
    moving = measured(motion, 1, periods=5, step=0.01, force_scale=0.0, length_scale=0.0)
    rest = 60
    start = np.r_[np.zeros(rest, dtype=int), np.arange(440)]
    time = 0.01 * np.arange(500)

    def recording(seed, rows=slice(300)):
        rng = np.random.default_rng(seed)
        forces = moving.forces[start] + rng.normal(0, 0.35, (500, 6))
        jitter = rng.normal(0, 1e-5, (500, 6))
        jitter[:rest] = 0
        lengths = np.round((moving.lengths[start] + jitter) / 1e-6) * 1e-6
        forces = np.round(forces / resolution) * resolution
        return Measurement(time[rows], lengths[rows], forces[rows], 0.01)

    data = [recording(seed) for seed in range(10)]
    # Pairs are compared in their order: the last one is refused, so that no other was.
    with pytest.raises(UnsuitableDataError, match="10 and 11 have 100 rows in common"):
        estimate_parameters(run(), [*data, recording(9, slice(200, 500))], motion)


def _without_rows(data, share, seed):
    """Return a recording in which a share of the samples is missing."""
    draw = np.random.default_rng(seed).permutation(len(data))
    kept = np.sort(draw[round(len(data) * share) :])
    values = {name: getattr(data, name)[kept] for name in ("time", "lengths", "forces")}
    return replace(data, **values, lost=len(data) - len(kept))


@pytest.mark.parametrize("spectrum", ["white", "auto"])
@pytest.mark.parametrize("loss", ["squared", "huber"])
def test_missing_samples_and_outliers_do_not_make_the_spectrum_smaller(loss, spectrum):
    """They are replaced by the mean, which is no noise: 6 % of four periods are 8 % of it."""
    motion, robust = trajectory(), loss == "huber"
    data = dirty(motion, 4) if robust else measured(motion, periods=4)
    data = _without_rows(data, 0.06, 1)
    recording = fold_recording(data, motion.omega, PeriodSource.DESIGN, robust=robust)
    for channels in (recording.forces, recording.lengths):
        noise = channels.noise(spectrum)
        np.testing.assert_allclose(noise.lines.covariance, noise.covariance, rtol=1e-9)
        assert noise.lines.freedom == pytest.approx(noise.freedom / 200)


def test_noise_behind_a_filter_with_missing_samples_is_that_of_the_means():
    """At the lines that the filter leaves. The recorded forces are noise alone."""
    motion, periods = trajectory(), 10
    section = DataSection.model_validate({"filter": {"Q": {"low_pass": 20.0, "order": 2}}})
    sensors, low_pass = SensorResponse.of(section, "Q"), signal.butter(2, 20.0, fs=1 / STEP)
    found, true = [], []
    for seed in range(20):
        data = measured(motion, seed, periods=periods)
        white = np.random.default_rng(seed).normal(size=(len(data) + 200, 6))
        noise = signal.lfilter(*low_pass, white, axis=0)[200:]
        data = _without_rows(replace(data, forces=noise, force_sensors=sensors), 0.09, seed)
        forces = fold_recording(data, motion.omega, PeriodSource.DESIGN).forces
        samples, means = 2 * forces.kept - 1, forces.as_recorded(forces.values)
        squares = np.abs(lines_of(means)[: forces.kept]) ** 2 * np.mean(forces.counts)
        true.append(multiplicity(samples) @ squares / samples)
        found.append(np.diag(forces.noise().covariance))
    # 20 recordings of about 43 samples and 6 channels: a standard deviation of 2 %.
    assert np.mean(found) == pytest.approx(np.mean(true), rel=0.05)
