"""Recordings without a period: splines, noise from residuals, weights of uncertain samples."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy.linalg as sla
from scipy import fft

from benchmarks import shots, unknowns
from estimation.estimators import ParameterPriors
from estimation.estimators.result import covariance_ml_less_gm
from estimation.identification import (
    estimate,
    estimate_parameters,
    prepare_experiment,
    run_estimators,
    single_shot,
)
from estimation.identification.periods import UnsuitableDataError
from estimation.measurement_model import HarmonicMotion, prediction
from estimation.measurement_model.motion import MotionColumns, NormalEquations
from estimation.measurement_model.prediction import sliding_rate_kernel
from estimation.measurement_model.spline import SplineMotion
from estimation.processing.autoregression import autoregressive_noise
from expdesign.configuration import InputError, load_run
from expdesign.noise import lines_of
from expdesign.robot import robot_from
from tests.estimation.cases import ROBOT, STEP, measured, run, trajectory

MOTION = trajectory(samples=320, harmonics=3)


def passes(seed=0, periods=1.3, **options):
    """Return a recording of a motion that ends before it repeats."""
    return measured(MOTION, seed, periods=periods, **options)


@cache
def estimated():
    return estimate(run({"estimators": ["gm", "ml"]}), passes())


@pytest.mark.slow
def test_a_motion_that_does_not_repeat_is_estimated_along_a_spline():
    data = passes(force_scale=1e-6, length_scale=1e-6)
    experiment = prepare_experiment(run(), ROBOT, data, None)
    priors = ParameterPriors.of(ROBOT, run().run.estimate)
    found = run_estimators(ROBOT, [experiment], priors, ("gm", "ml"))
    for name in ("gm", "ml"):
        relative = np.abs(found[name].values / ROBOT.parameters - 1)
        assert np.all(relative[1:] < 1e-5), name
        assert np.all(np.abs(found[name].values - ROBOT.parameters) < 4 * found[name].std), name


def test_a_difference_of_estimates_does_not_depend_on_the_parts_it_is_summed_in(monkeypatch):
    """GM weights with a filter, ML without: of long recordings both come in the same parts."""
    experiment = prepare_experiment(run({"noise": "given"}), ROBOT, passes(), None)
    count = experiment.recording.samples
    noise = 5.0 * simulate(count, 0.8, np.random.default_rng(2))
    coloured = autoregressive_noise(noise, np.zeros((count, 6, 0)), np.ones(count))
    experiment = replace(experiment, linear_noise=coloured)
    priors = ParameterPriors.of(ROBOT, run().run.estimate)
    found = run_estimators(ROBOT, [experiment], priors, ("gm", "ml"))
    filters = [found[name].influences[0].weights.filter is None for name in ("gm", "ml")]
    assert filters == [False, True]
    # No weights are better than those of the noise itself (Gauss and Markov), which is white.
    white = run_estimators(ROBOT, [replace(experiment, linear_noise=None)], priors, ("gm",))
    assert np.all(found["gm"].std > white["gm"].std)
    whole = covariance_ml_less_gm(found)
    monkeypatch.setattr(prediction, "_CHUNK", 100)
    scale = np.sqrt(np.diag(whole))
    np.testing.assert_allclose(
        covariance_ml_less_gm(found) / np.outer(scale, scale),
        whole / np.outer(scale, scale),
        atol=1e-9,
    )


def test_its_result_says_so():
    result = estimated()
    assert any("without a period the motion is a spline" in each for each in result.warnings)
    (recording,) = result.recordings
    assert (recording.period_source, recording.harmonics) == ("no period", None)
    assert 0.01 < recording.knot_spacing < 0.3
    assert recording.noise.force_source == "residuals"
    assert result.estimators["ml"].motions == ()
    sigma = np.sqrt(np.diag(ROBOT.description.noise.force_covariance))
    assert np.all(np.abs(np.sqrt(np.diag(recording.noise.force_covariance)) / sigma - 1) < 0.2)


def test_causes_are_searched_along_the_motion_and_periods_are_not_needed():
    verdict = estimated().diagnostics.verdict
    assert verdict.status == "accepted"
    outcomes = {each.assumption: each.outcome for each in verdict.findings}
    assert outcomes["no unmodelled inertia of the drives"] == "holds"
    assert outcomes["all periods are alike"] == "not tested"


def test_a_delay_is_found_without_a_period():
    data, steps = passes(), 2
    late = replace(
        data,
        time=data.time[steps:],
        lengths=data.lengths[steps:],
        forces=data.forces[:-steps],
    )
    found = estimate(run({"estimators": ["gm"]}), late)
    verdict = found.diagnostics.verdict
    assert verdict.status == "doubtful"
    assert "lag behind the lengths" in verdict.causes[0].contradiction
    (delays,) = (e for e in found.diagnostics.recordings[0].tests.causes if e.kind == "delay")
    delay = min(delays.candidates, key=lambda each: each.log_p)
    assert delay.values[0] == pytest.approx(steps * STEP, abs=4 * delay.std[0])
    outcomes = {each.assumption: each.outcome for each in estimated().diagnostics.verdict.findings}
    assert outcomes["forces and lengths are sampled at the same time"] == "holds"


@pytest.mark.parametrize(("noise", "forces", "lengths"), [("auto", 0.1, 4.0), ("given", 1.0, 1.0)])
def test_signs_are_as_uncertain_as_the_motion_of_forces_and_lengths(noise, forces, lengths):
    """The forces determine the rates, too."""
    data = passes(force_scale=forces, length_scale=lengths)
    experiment = prepare_experiment(run({"noise": noise}), ROBOT, data, None)
    refined, times = experiment.refined_motion, experiment.recording.forces.times
    kernel = sliding_rate_kernel(ROBOT.terms)
    found, true, linear = (
        kernel(motion.at(times).state(), ROBOT.geometry_vector)[0]
        for motion in (refined.motion, HarmonicMotion.of(MOTION), experiment.fit.motion)
    )
    inside = slice(10, -10)
    for rates, spread in ((found, refined.spread), (linear, experiment.fit.spread)):
        ratio = ((rates - true) / spread)[inside]
        assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.25)
    assert np.median(refined.spread / experiment.fit.spread) < (0.8 if forces < lengths else 1.0)
    assert experiment.for_estimator("gm").fit is experiment.fit
    assert experiment.for_estimator("ml").fit is refined


@pytest.mark.slow
@pytest.mark.parametrize("number", [5, 12])
def test_noise_is_found_although_the_lengths_hardly_show_the_accelerations(number):
    """The first motion explains the forces a hundred times worse than their noise."""
    _, data = shots.record("irregular", number, 0.0, 10.0)
    settings = {"differentiation": "spline", "systematic": "none"}
    path = unknowns.ROBOTS["irregular"]
    config = load_run({"name": "shots", "robot": str(path), "estimate": settings})
    experiment = prepare_experiment(config, robot_from(config.robot), data, None)
    known = experiment.recording.step * 1000
    of_forces, _ = unknowns.read_noise(path)
    ratio = np.diag(experiment.noise.forces.covariance) * known / np.diag(of_forces)
    assert experiment.settled
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.1)


def test_a_motion_and_a_noise_that_do_not_settle_are_reported(monkeypatch):
    settled = estimated()  # with all rounds, whatever ran before
    monkeypatch.setattr(single_shot, "_ROUNDS", 1)
    found = estimate(run({"estimators": ["gm"]}), passes())
    assert any("motion and noise still changed" in each for each in found.warnings)
    verdict = found.diagnostics.verdict
    assert verdict.status == "doubtful"
    assert any("were not found together" in each.contradiction for each in verdict.findings)
    assert not found.diagnostics.recordings[0].tests.settled
    outcomes = {each.assumption: each.outcome for each in settled.diagnostics.verdict.findings}
    assert not any(each.startswith("motion and noise") for each in outcomes)


@pytest.mark.parametrize(
    ("settings", "key"),
    [({"harmonics": 5}, "harmonics"), ({"frequency": "estimated"}, "frequency")],
)
def test_settings_of_periods_are_refused_with_splines(settings, key):
    with pytest.raises(InputError, match=f"{key} is for motions with a period"):
        run({"differentiation": "spline", **settings})


def test_a_fourier_series_that_is_asked_for_needs_a_period():
    with pytest.raises(UnsuitableDataError, match="do not repeat"):
        estimate_parameters(run({"differentiation": "fourier"}), passes())


def test_samples_at_rest_do_not_show_friction():
    """Before the motion the machine rests, and friction holds with an unknown force."""
    data = passes(periods=1.0)
    still = 300
    rng = np.random.default_rng(7)
    noise = ROBOT.description.noise
    first = data.lengths[:1] + rng.multivariate_normal(np.zeros(6), noise.length_covariance, still)
    held = data.forces[:1] + 30.0 + 5.0 * rng.standard_normal((still, 6))
    rest = type(data)(
        np.arange(still + len(data)) * data.step,
        np.concatenate([first, data.lengths]),
        np.concatenate([held, data.forces]),
    )
    experiment = prepare_experiment(
        run({"differentiation": "spline", "noise": "given"}), ROBOT, rest, None
    )
    assert np.sum(experiment.certainty[50 : still - 50]) < 3
    assert np.mean(experiment.certainty[still + 50 :]) > 0.8


def simulate(count, coefficient, rng):
    noise = rng.standard_normal((count + 200, 6))
    for t in range(1, len(noise)):
        noise[t] += coefficient * noise[t - 1]
    return noise[200:]


def test_residuals_that_a_fit_shortened_show_the_noise():
    """A fit of 40 columns of low frequency takes a third of the noise's long memory."""
    rng, count, coefficient = np.random.default_rng(3), 1500, 0.9
    columns = fft.idct(np.eye(count)[:, :40], axis=0, norm="ortho")
    ratios = []
    for _ in range(6):
        noise = simulate(count, coefficient, rng)
        taken = columns @ (columns.T @ noise)
        found = autoregressive_noise(noise - taken, taken[:, :, None], np.ones(count))
        ratios.append(np.mean(np.diag(found.lines.matrices[0].real)) * (1 - coefficient) ** 2)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.12)


def test_variances_of_noise_with_memory_are_as_uncertain_as_stated():
    """Of a constant and of two waves, behind an estimated memory of 50 samples."""
    rng, count, coefficient = np.random.default_rng(5), 1500, 0.98
    times = 2 * np.pi * np.arange(count) / count
    columns = np.zeros((count, 6, 3))
    columns[:, :, 0] = 1.0
    columns[:, 0, 1], columns[:, 2, 2] = np.cos(4 * times), np.cos(20 * times)
    lines, found = lines_of(columns), []
    for _ in range(120):
        noise = simulate(count, coefficient, rng)
        own = autoregressive_noise(noise, np.zeros((count, 6, 0)), np.ones(count), "estimated")
        spread, variance = own.lines.spread(lines)
        found.append((np.diag(spread), variance))
    values, variances = np.array(found).transpose(1, 0, 2)
    scatter = np.std(np.log(values), axis=0)
    stated = np.median(np.sqrt(variances) / values, axis=0)
    np.testing.assert_allclose(stated, scatter, rtol=0.35)


@pytest.mark.parametrize("correlation", [0.0, 0.8])
@pytest.mark.parametrize("other", [1.0, -1.0])
def test_correlated_channels_share_the_errors_of_their_memories(correlation, other):
    """Of a constant in all channels, or with the other sign in the last three."""
    rng, count, draws = np.random.default_rng(6), 600, 200
    root = np.linalg.cholesky(np.full((6, 6), correlation) + (1 - correlation) * np.eye(6))
    columns = np.ones((count, 6, 1))
    columns[:, 3:] = other
    lines, found = lines_of(columns), []
    for _ in range(draws):
        noise = simulate(count, 0.9, rng) @ root.T
        own = autoregressive_noise(noise, np.zeros((count, 6, 0)), np.ones(count), "estimated")
        spread, variance = own.lines.spread(lines)
        found.append((spread[0, 0], variance[0]))
    values, variances = np.array(found).T
    stated = np.median(np.sqrt(variances) / values)
    assert stated == pytest.approx(np.std(np.log(values)), rel=0.25)


def test_a_sample_that_is_not_known_has_no_weight_in_any_filtered_value():
    rng, count, place = np.random.default_rng(7), 600, 300
    certainty = np.where(np.arange(count) == place, 0.0, 1.0)
    noise = autoregressive_noise(
        simulate(count, 0.8, rng), np.zeros((count, 6, 0)), certainty, "estimated"
    )
    impulse = np.zeros((count, 6))
    impulse[place] = 1.0
    assert noise.filter.lag >= 1
    assert np.all(noise.filter(impulse) == 0)
    # All samples that do not depend on it keep their weights.
    np.testing.assert_array_less(0.1, np.abs(noise.filter(np.roll(impulse, 50, axis=0))[350]))


def test_filtered_equations_are_those_of_the_whole_matrices():
    rng, count = np.random.default_rng(1), 400
    times = np.arange(count) * 0.01
    motion = SplineMotion.over(times, 21)
    certainty = np.ones(count)
    certainty[100:110] = 0.2
    noise = autoregressive_noise(
        simulate(count, 0.8, rng), np.zeros((count, 6, 0)), certainty, "estimated"
    )
    rest, others = rng.standard_normal((count, 6)), rng.standard_normal((count, 6, 3))
    slope = rng.standard_normal((count, 6, 18))
    halves = [slice(0, 150), slice(150, count)]
    parts = [
        (rest[h], MotionColumns(others[h], slope[h], motion.at(times[h])), np.ones(count)[h])
        for h in halves
    ]
    found = NormalEquations.of(parts, noise.covariance, noise.filter)
    whole = np.concatenate([others, motion.at(times).chain(slope)], axis=2)
    # The filter as a matrix, column by column.
    unit = np.eye(6 * count).reshape(count, 6, -1)
    operation = noise.filter(unit).reshape(6 * count, -1)
    weights = np.kron(np.eye(count), np.linalg.inv(noise.covariance))
    weight = operation.T @ weights @ operation
    flat, residual = whole.reshape(6 * count, -1), rest.ravel()
    np.testing.assert_allclose(found.matrix.toarray(), flat.T @ weight @ flat, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(found.gradient, flat.T @ weight @ residual, rtol=1e-9, atol=1e-6)
    adjoint = noise.filter.adjoint(unit).reshape(6 * count, -1)
    np.testing.assert_allclose(adjoint, operation.T, atol=1e-12)
    # Away from uncertain samples it whitens noise of its spectrum.
    row = noise.lines.matrices[:, 0, 0].real
    covariance = sla.toeplitz(np.fft.irfft(row, count))
    first = operation.reshape(count, 6, count, 6)[200:300, 0, :, 0]
    white = first @ covariance @ first.T
    assert np.max(np.abs(white - np.diag(np.diag(white)))) < 1e-6 * white[0, 0]
