import json
import re
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from estimation import kinematics
from estimation.data.measurement import Measurement
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.finding import FindingOutcome, Status
from estimation.estimators import maximum_likelihood
from estimation.identification import (
    estimate,
    estimate_parameters,
    estimation_result,
    prepare_experiment,
)
from estimation.identification.periods import choose_omega
from estimation.kinematics import MotionFitError
from estimation.processing import PeriodSource
from estimation.processing.periodic_recording import single_recording
from expdesign.configuration import InputError, load_run
from expdesign.robot import robot_from
from expdesign.trajectory import FourierTrajectory
from results.views.estimate import estimates_table
from tests.estimation.cases import PERIODS, ROBOT, STEP, measured, run, trajectory

MOTION = trajectory()
QUIET = {"force_scale": 0.02, "length_scale": 0.2}


def changed(data, **fields):
    return Measurement(**{**vars(data), **fields})


def same(one, other, rtol=1e-7):
    for name in one.estimates:
        np.testing.assert_allclose(
            one[name].values, other[name].values, rtol=rtol, atol=rtol * one[name].std.max()
        )
        np.testing.assert_allclose(one[name].std, other[name].std, rtol=1e-4)


def without_noise(**noise):
    """Return a run with a robot that states no noise, or only what is given."""
    bare = load_run({"name": "case", "robot": "palida", "estimate": {}})
    description = bare.run.robot.model_dump(by_alias=True, exclude_none=True)
    description.pop("noise")
    return load_run({"name": "case", "robot": description, **({"noise": noise} if noise else {})})


def pull(result, name):
    return (result[name].values - ROBOT.parameters) / result[name].std


def test_all_estimators_recover_the_parameters():
    result = estimate_parameters(run(), measured(MOTION), MOTION)
    assert list(result.estimates) == ["ls", "gm", "ml"]
    assert result.best.estimator == "ml"
    for name in result.estimates:
        assert np.sum(pull(result, name) ** 2) / 24 < 2.5
    record = result.recordings[0].experiment.recording
    assert (record.periods, record.samples) == (PERIODS, 200)
    assert result.recordings[0].harmonics == 2
    assert result.recordings[0].experiment.noise.source == "estimated"
    assert len(result.rows) == 72


def test_the_estimate_needs_no_design():
    data = measured(MOTION)
    same(estimate_parameters(run(), data, MOTION), estimate_parameters(run(), data), rtol=2e-3)


def test_a_period_that_is_no_whole_number_of_samples():
    motion = trajectory(333 + 1 / 3)
    data = measured(motion, periods=4)
    result = estimate_parameters(run({"estimators": ["gm"]}), data, motion)
    assert np.sum(pull(result, "gm") ** 2) / 24 < 2.5
    # As many samples as whole periods would have, and as much information.
    whole = estimate_parameters(run({"estimators": ["gm"]}), measured(trajectory(333), periods=4))
    # Four whole periods show the noise's own spectrum, too: what chance makes of it is `colour`.
    white = whole["gm"].std / np.sqrt(whole["gm"].colour)
    np.testing.assert_allclose(result["gm"].std, white, rtol=0.06)


def test_stamps_that_jitter_are_used_as_they_are():
    rng = np.random.default_rng(5)
    times = np.arange(1000) * STEP + rng.uniform(-0.3, 0.3, 1000) * STEP
    data = changed(measured(MOTION, times=times, **QUIET), stamped=True)
    result = estimate_parameters(run({"estimators": ["gm", "ml"]}), data, MOTION)
    assert np.sum(pull(result, "ml") ** 2) / 24 < 2.5
    rounded = changed(data, time=np.arange(1000) * STEP, stamped=False)
    wrong = estimate_parameters(run({"estimators": ["gm"]}), rounded, MOTION)
    assert np.sum(pull(wrong, "gm") ** 2) > 3 * np.sum(pull(result, "gm") ** 2)


@pytest.mark.slow
def test_delays_between_the_channels_are_taken_out():
    times = np.arange(1000) * STEP
    late = measured(MOTION, times=times - 0.004, **QUIET)
    prompt = measured(MOTION, times=times, **QUIET)
    data = changed(prompt, lengths=late.lengths, length_delay=0.004)
    result = estimate_parameters(run(), data, MOTION)
    assert np.sum(pull(result, "ml") ** 2) / 24 < 2.5
    unaware = estimate_parameters(run(), changed(data, length_delay=0.0), MOTION)
    assert np.sum(pull(unaware, "ml") ** 2) > 10 * np.sum(pull(result, "ml") ** 2)


@pytest.mark.slow
def test_an_estimated_frequency():
    data = measured(MOTION)
    off = 1 + 3e-4
    slow = changed(data, time=data.time * off, step=data.step * off)
    with_clock = run({"estimators": ["gm", "ml"], "frequency": "estimated"})
    result = estimate_parameters(with_clock, slow, MOTION)
    fit = result.recordings[0].experiment.fit
    error = np.sqrt(fit.covariance[-1, -1])
    assert abs(fit.motion.omega - MOTION.omega / off) < 4 * error
    assert error / MOTION.omega < 1e-5


@pytest.mark.slow
def test_time_stamps_far_from_zero_change_nothing(tmp_path):
    """The clock of a controller that counts from 1970."""
    since = 1.7e9
    config = run({"estimators": ["gm", "ml"], "frequency": "estimated"})
    data = measured(MOTION)
    near = estimate_parameters(config, data, MOTION)
    # Whole periods later: the same phases.
    later = changed(data, time=data.time + since)
    far = estimate_parameters(config, later, MOTION)
    for name in near.estimates:
        close = (far[name].values - near[name].values) / near[name].std
        assert np.max(np.abs(close)) < 0.02
    estimation_result(far).write(tmp_path)
    table = pd.read_csv(tmp_path / "tables" / "estimated_motion.csv")
    assert table["t"].iloc[0] == pytest.approx(since, abs=1e-6)
    record = json.loads((tmp_path / "estimate.json").read_text())
    written = record["estimators"]["ml"]["motions"][0]
    motion = FourierTrajectory(
        written["omega"], *(np.array(written[key]) for key in ("lambda0", "mu", "nu"))
    )
    # With the frequency as found, the motion runs at the file's own times.
    np.testing.assert_allclose(
        motion.sample(later.time[:200]).pose,
        table[["x", "y", "z", "phi", "theta", "psi"]].to_numpy()[:200],
        atol=1e-5,
    )


@pytest.mark.slow
@pytest.mark.parametrize(("periods", "off"), [(3, 0.015), (5, 2e-3), (5, -0.015)])
def test_a_clock_that_is_off_is_told(off, periods):
    data = measured(MOTION, periods=periods)
    other = changed(data, time=data.time / (1 + off), step=data.step / (1 + off))
    result = estimate_parameters(run({"estimators": ["gm"]}), other, MOTION)
    told = [warning for warning in result.warnings if "frequency: estimated" in warning]
    assert len(told) == 1
    stated = float(re.search(r"\(([+-][\d.e-]+) %", told[0]).group(1)) / 100
    assert stated == pytest.approx(off, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("off", [0.03, -0.04])
def test_another_period_is_refused_though_it_is_near(off):
    data = measured(MOTION)
    other = changed(data, time=data.time / (1 + off), step=data.step / (1 + off))
    with pytest.raises(InputError, match="the lengths repeat after"):
        estimate_parameters(run({"estimators": ["gm"]}), other, MOTION)


def test_a_machine_that_rests_for_most_of_its_period_is_not_refused():
    data = measured(MOTION)
    resting = np.arange(len(data)) % 200 > 80
    lengths, forces = data.lengths.copy(), data.forces.copy()
    rng = np.random.default_rng(1)
    lengths[resting] = lengths[0] + 1e-4 * rng.normal(size=(resting.sum(), 6))
    still = changed(data, lengths=lengths, forces=forces)
    omega, source = choose_omega(run(), still, MOTION)
    assert (omega, source) == (MOTION.omega, PeriodSource.DESIGN)
    with pytest.raises(InputError, match="do not repeat with the design's period"):
        choose_omega(run(), still, trajectory(170))
    slow = replace(still, time=1e3 * still.time, step=1e3 * still.step)
    with pytest.raises(InputError, match="every 5 s are too far apart for the design's period"):
        choose_omega(run(), slow, MOTION)


@pytest.mark.parametrize("seed", range(5))
def test_a_clock_that_is_right_is_not_doubted(seed):
    result = estimate_parameters(run({"estimators": ["gm"]}), measured(MOTION, seed), MOTION)
    assert not [warning for warning in result.warnings if "repeat" in warning]


@pytest.mark.slow
def test_lengths_of_unknown_noise_have_the_covariance_of_what_the_motion_leaves():
    samples = 100
    motion = trajectory(samples, 1.0 / samples)
    config = without_noise()
    ratios = []
    for seed in range(8):
        data = measured(motion, seed, periods=1, step=1.0 / samples)
        result = estimate_parameters(config, data, motion)
        noise = result.recordings[0].experiment.noise
        assert noise.lengths.includes_model_error
        true = ROBOT.description.noise.length_covariance
        ratios.append(np.diag(noise.lengths.covariance) / np.diag(true))
        assert any("residuals of the motion fitted" in warning for warning in result.warnings)
    # 8 × 100 samples less 5 coefficients each: 5 % of the variance is one sigma.
    assert np.all(np.abs(np.mean(ratios, axis=0) - 1) < 0.2)


def test_the_noise_of_the_forces_alone_is_not_thrown_away():
    config = without_noise(force_std=["25 N"] * 6)
    noise = (
        estimate_parameters(config, measured(MOTION, periods=1), MOTION)
        .recordings[0]
        .experiment.noise
    )
    assert (noise.forces.source, noise.lengths.source) == ("given", "residuals")
    assert noise.source == "forces given, lengths residuals"
    np.testing.assert_allclose(noise.forces.covariance, 625.0 * np.eye(6))


def test_struts_in_another_order_give_the_same_estimate():
    order = np.array([3, 0, 5, 1, 4, 2])
    description = ROBOT.description.description.model_dump(by_alias=True, exclude_none=True)
    source = load_run({"name": "case", "robot": "palida"}).run.robot.model_dump(
        by_alias=True, exclude_none=True
    )
    assert description["name"] == source["name"]
    renumbered = dict(source)
    for key in ("base_joints", "platform_joints", "alpha_axes", "platform_joint_axes"):
        if source.get(key) is not None:
            renumbered[key] = [source[key][j] for j in order]
    parameters = dict(source["parameters"])
    for k, j in enumerate(order):
        parameters[f"r{k + 1}"] = source["parameters"][f"r{j + 1}"]
        parameters[f"v{k + 1}"] = source["parameters"][f"v{j + 1}"]
    renumbered["parameters"] = parameters
    sigma, delta = (
        ROBOT.description.noise.force_covariance,
        ROBOT.description.noise.length_covariance,
    )
    renumbered["noise"] = {
        "force_covariance": sigma[np.ix_(order, order)].tolist(),
        "length_covariance": delta[np.ix_(order, order)].tolist(),
    }
    renumbered.pop("limits", None)
    other = load_run({"name": "case", "robot": renumbered})
    assert robot_from(other.robot).parameters[12] == ROBOT.parameters[12 + order[0]]
    data = measured(MOTION)
    swapped = changed(data, lengths=data.lengths[:, order], forces=data.forces[:, order])
    one, two = estimate_parameters(run(), data, MOTION), estimate_parameters(other, swapped, MOTION)
    back = np.concatenate([np.arange(12), 12 + np.argsort(order), 18 + np.argsort(order)])
    for name in one.estimates:
        tolerance = 1e-6 * one[name].std
        assert np.all(np.abs(two[name].values[back] - one[name].values) < tolerance), name


def test_one_period_of_few_samples_does_not_identify_p1():
    data = measured(MOTION, periods=1)
    result = estimate_parameters(run(), data, MOTION)
    assert result.recordings[0].experiment.noise.source == "given"
    row = next(r for r in result.rows if (r.estimator, r.parameter) == ("ml", "p1"))
    assert row.identified is False
    own = result["ml"]
    known = result.priors.identified_combinations(result.robot, own.values, own.covariance)
    combinations = [each for each in known if "p1" in each.regrouped.split(", ")]
    assert combinations
    assert all(each.std < each.std_alone for each in combinations)


def test_without_periods_and_noise_the_residuals_serve_and_it_is_said():
    result = estimate_parameters(without_noise(), measured(MOTION, periods=1), MOTION)
    noise = result.recordings[0].experiment.noise
    assert noise.forces.includes_model_error
    assert any("includes the model's error" in warning for warning in result.warnings)
    ratio = np.diag(noise.forces.covariance) / np.diag(ROBOT.description.noise.force_covariance)
    assert np.all((ratio > 0.6) & (ratio < 1.5))


@pytest.mark.parametrize(
    ("samples", "periods", "stated", "source"),
    [
        (200, 2, True, "given"),
        (200, 3, True, "estimated"),
        (300, 2, True, "estimated"),
        (40, 3, True, "given"),
        (40, 3, False, "estimated"),
        (200, 1, False, "residuals"),
    ],
)
def test_freedom_decides_whether_the_periods_tell_the_noise(samples, periods, stated, source):
    motion = trajectory(samples, 1.0 / samples)
    config = run() if stated else without_noise()
    data = measured(motion, periods=periods, step=1.0 / samples)
    experiment = prepare_experiment(config, ROBOT, data, motion)
    assert experiment.noise.forces.source == source


def lossy(data, rows):
    """Return the data without these rows."""
    kept = np.setdiff1d(np.arange(len(data)), rows)
    parts = {name: getattr(data, name)[kept] for name in ("time", "lengths", "forces")}
    return changed(data, **parts, lost=len(rows))


def test_a_few_lost_samples_change_little():
    data = measured(MOTION)
    whole = estimate_parameters(run(), data, MOTION)
    result = estimate_parameters(run(), lossy(data, [17, 18, 444, 998]), MOTION)
    record = result.recordings[0].experiment.recording
    assert (record.samples, record.lost, record.rows) == (200, 4, 996)
    assert record.averaged
    assert record.forces.periods is None
    assert record.forces.counts[[16, 17, 18, 44]].tolist() == [5, 4, 4, 4]
    assert result.recordings[0].experiment.noise.source == "estimated"
    verdict = diagnose(result.robot, result.experiments, result.priors, result.best).verdict
    (white,) = (one for one in verdict.findings if one.assumption == "the noise is white")
    assert (white.outcome, white.serious) == (FindingOutcome.NOT_TESTED, False)
    for name in result.estimates:
        moved = (result[name].values - whole[name].values) / whole[name].std
        # Four of a thousand samples: each parameter moves by some √0.004 of its std.
        assert np.max(np.abs(moved)) < 0.4
        assert np.exp(np.mean(np.log(result[name].std / whole[name].std))) == pytest.approx(
            1, abs=0.03
        )


def test_a_recording_without_a_period_counts_its_lost_samples():
    recording = single_recording(lossy(measured(MOTION), [17, 18, 444]))
    assert (recording.rows, recording.lost) == (997, 3)


def test_a_phase_that_every_period_lost_is_left_out():
    rows = [30 + 200 * k for k in range(PERIODS)]
    result = estimate_parameters(run({"estimators": ["gm"]}), lossy(measured(MOTION), rows), MOTION)
    record = result.recordings[0].experiment.recording
    assert record.samples == 199
    assert np.max(np.diff(record.forces.times)) == pytest.approx(2 * STEP)
    assert np.sum(pull(result, "gm") ** 2) / 24 < 2.5
    pointwise, lost = run({"differentiation": "central"}), lossy(measured(MOTION), rows)
    with pytest.raises(MotionFitError, match="some were lost"):
        prepare_experiment(pointwise, ROBOT, lost, MOTION)


@pytest.mark.parametrize("samples", [200, 200.4])
def test_lost_samples_with_outliers_and_any_period(samples):
    motion = trajectory(samples)
    data = measured(motion, periods=6)
    data.forces[::53, 2] += 800.0
    config = run({"estimators": ["gm"], "loss": "huber"})
    result = estimate_parameters(config, lossy(data, range(40, 60)), motion)
    assert np.sum(pull(result, "gm") ** 2) / 24 < 2.5


def test_lost_samples_and_a_period_column_with_a_beginning():
    data = measured(MOTION, periods=6)
    numbers = (np.arange(len(data)) + 150) // 200
    begun = changed(data, period=numbers)
    kept = lossy(begun, [])
    assert kept.lost == 0
    missing = [3, 60, 61, 300]
    rest = np.setdiff1d(np.arange(len(data)), missing)
    record = prepare_experiment(
        run(), ROBOT, changed(lossy(data, missing), period=numbers[rest]), MOTION
    ).recording
    assert (record.periods, record.dropped) == (5, 49 + 150)
    assert record.lost == 3


def test_the_robust_loss_does_not_advise_itself():
    data = measured(MOTION, periods=8)
    data.forces[::53, 2] += 800.0
    found = {}
    for loss in ("squared", "huber"):
        result = estimate_parameters(run({"estimators": ["gm"], "loss": loss}), data, MOTION)
        verdict = diagnose(result.robot, result.experiments, result.priors, result.best).verdict
        (found[loss],) = (f for f in verdict.findings if f.assumption == "no outliers")
    assert found["squared"].failed
    assert found["squared"].serious
    assert "huber" in found["squared"].advice
    assert found["huber"].failed
    assert not found["huber"].serious
    assert "huber" not in found["huber"].advice


def test_outliers_with_and_without_a_robust_loss():
    data = measured(MOTION, periods=8)
    forces = data.forces.copy()
    forces[::53, 2] += 800.0
    dirty = changed(data, forces=forces)
    plain = estimate_parameters(run({"estimators": ["gm"]}), dirty, MOTION)
    robust = estimate_parameters(run({"estimators": ["gm"], "loss": "huber"}), dirty, MOTION)
    clean = estimate_parameters(run({"estimators": ["gm"]}), data, MOTION)

    def off(result):
        return np.linalg.norm((result["gm"].values - clean["gm"].values) / clean["gm"].std)

    assert off(robust) < 0.3 * off(plain)
    assert np.all(robust["gm"].std < 1.25 * clean["gm"].std)


def test_an_estimate_that_did_not_converge_is_not_accepted(monkeypatch):
    """Neither its screen nor its page shows intervals."""
    monkeypatch.setattr(sys.modules[maximum_likelihood.__module__], "_STEPS", 0)
    data = measured(trajectory(), 1)
    data = replace(data, lengths=data.lengths + 4e-3 * np.eye(6)[1])
    result = estimate(run({"estimators": ["ml"]}), data)
    assert not result.best_estimator.converged
    assert not result.intervals_cover
    verdict = result.diagnostics.verdict
    assert verdict.status is Status.DOUBTFUL
    assert any("did not converge" in finding.contradiction for finding in verdict.failed)
    heads = [column.title for column in estimates_table(result, None).columns]
    assert heads == ["parameter", "unit", "a priori", "estimate"]


def test_pointwise_differentiation_is_biased_and_says_that_it_does_not_cover():
    data = measured(trajectory(1000, 1e-3), step=1e-3)
    result = estimate_parameters(
        run({"estimators": ["ls", "gm"], "differentiation": "central"}),
        data,
        trajectory(1000, 1e-3),
    )
    assert result.pointwise
    assert not estimation_result(result).intervals_cover
    assert any("do not cover" in warning for warning in result.warnings)
    assert np.abs(pull(result, "ls")).max() > 10


def test_a_wrong_period_is_refused_with_the_right_one():
    other = trajectory(170)
    with pytest.raises(InputError, match=r"repeat after (1|0\.99\d*|1\.00\d*) s"):
        estimate_parameters(run(), measured(MOTION), other)


@pytest.mark.parametrize(
    ("section", "message"),
    [
        ({"estimators": ["ml"], "differentiation": "central"}, "Fourier series"),
        ({"fixed": list(ROBOT.parameter_names)}, "nothing to estimate"),
        ({"fixed": ["sx"]}, "has the parameter"),
    ],
)
def test_settings_that_do_not_fit_are_refused(section, message):
    with pytest.raises(InputError, match=message):
        estimate_parameters(run(section), measured(MOTION), MOTION)


def test_noise_that_is_asked_for_and_not_there():
    with pytest.raises(InputError, match="scatter between periods"):
        estimate_parameters(run({"noise": "estimated"}), measured(MOTION, periods=1), MOTION)


def test_two_recordings_in_one_estimate():
    other = trajectory(seed=9)
    data = (measured(MOTION, 1), measured(other, 2))
    both = estimate_parameters(run(), data, (MOTION, other))
    one = estimate_parameters(run(), data[0], MOTION)
    assert np.sum(pull(both, "ml") ** 2) / 24 < 2.5
    assert np.all(both["ml"].std < one["ml"].std)
    assert len(both["ml"].motions) == 2


@pytest.mark.parametrize("kind", ["forces", "lengths"])
def test_a_dead_channel_is_named(kind):
    data = measured(MOTION)
    values = getattr(data, kind).copy()
    values[:, 5] = values[0, 5]
    letter = "Q6" if kind == "forces" else "q6"
    with pytest.raises(InputError, match=f"{letter}.*no noise at all"):
        estimate_parameters(run(), changed(data, **{kind: values}), MOTION)


def test_a_cutoff_beyond_the_sampling_is_refused():
    settings = {"estimators": ["ls"], "differentiation": "butterworth", "cutoff": "150 Hz"}
    with pytest.raises(InputError, match="half the sampling rate"):
        estimate_parameters(run(settings), measured(MOTION), MOTION)


def test_a_start_from_single_samples_meets_all_phases(monkeypatch):
    """50 samples and 40 periods: every fiftieth sample has the same phase."""
    monkeypatch.setattr(kinematics, "_START_POINTS", 40)
    motion = trajectory(50, step=0.02)
    data = measured(motion, periods=40, step=0.02)
    result = estimate_parameters(
        run({"estimators": ["gm"], "frequency": "estimated"}), data, motion
    )
    assert np.sum(pull(result, "gm") ** 2) / 24 < 2.5
