"""Noise with memory: its spectrum, weights for it, and covariances that count it."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy import signal, stats

from estimation import identification
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.finding import Status
from estimation.diagnostics.noise_tests import noise_tests
from estimation.estimators import (
    Experiment,
    ParameterPriors,
    covariance_ml_less_gm,
    linear_estimate,
    maximum_likelihood,
)
from estimation.estimators.experiment import MotionEstimate
from estimation.estimators.result import covariance_fields
from estimation.kinematics import _turn_information, fit_motion
from estimation.measurement_model import HarmonicMotion
from estimation.processing import NoiseEstimate, NoiseModel, PeriodSource, fold_recording
from estimation.processing.spectrum import (
    NoiseLines,
    _neighbours,
    contrasts,
    estimated_filter,
    given_filter,
    smoothed_spectrum,
)
from estimation.twin import Twin
from estimation.uncertainty.intervals import interval_widths
from expdesign.configuration.estimate import EstimateSection
from expdesign.noise import multiplicity
from tests.estimation.cases import ROBOT, STEP, given_noise, measured, run, trajectory

SIGMA = ROBOT.description.noise.force_covariance
DELTA = ROBOT.description.noise.length_covariance
MOTION = trajectory()
KNOWN = ParameterPriors.of(ROBOT, EstimateSection())
DRY = tuple(name for name in ROBOT.parameter_names if name.startswith("r"))
GLIDING = ParameterPriors.of(ROBOT, EstimateSection(fixed=dict.fromkeys(DRY, 0.0)))
"""Without dry friction, whose signs follow the motion and have no part in a linear law."""


def coloured(rng, covariance, periods, samples, memory):
    """Return stationary noise, (M, N, 6), with the autocorrelation memory^lag."""
    white = rng.standard_normal((periods * samples + 2000, 6)) @ np.linalg.cholesky(covariance).T
    series = signal.lfilter([np.sqrt(1 - memory**2)], [1, -memory], white, axis=0)
    return series[2000:].reshape(periods, samples, 6)


def first_order(samples, memory):
    """Return the spectrum of such noise of unit variance at the lines of a period."""
    angle = 2 * np.pi * np.arange(samples // 2 + 1) / samples
    return (1 - memory**2) / (1 - 2 * memory * np.cos(angle) + memory**2)


def scatter(periods):
    flat = contrasts(periods).reshape(-1, 6)
    return NoiseEstimate(flat.T @ flat / len(flat), float(len(flat)))


@pytest.mark.parametrize("samples", [200, 201])
def test_the_lines_hold_the_variance_of_a_sample(samples):
    periods = coloured(np.random.default_rng(0), SIGMA, 4, samples, 0.5)
    lines = NoiseLines.of(periods)
    mean = np.einsum("l,lij->ij", multiplicity(samples) / samples, lines.matrices).real
    np.testing.assert_allclose(mean, scatter(periods).covariance, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(("memory", "samples"), [(0.5, 400), (0.9, 801)])
def test_a_smooth_spectrum_is_found(memory, samples):
    periods = coloured(np.random.default_rng(1), SIGMA, 10, samples, memory)
    found = smoothed_spectrum(NoiseLines.of(periods), scatter(periods).covariance)
    expected = first_order(samples, memory)[:, None, None] * SIGMA
    ratio = np.einsum("lii->li", found.matrices).real / np.einsum("lii->li", expected)
    assert np.max(np.abs(np.log(ratio))) < 0.25
    assert np.mean(np.abs(np.log(ratio))) < 0.06


def test_white_noise_needs_no_filter():
    rng = np.random.default_rng(2)
    kept = 0
    for _ in range(20):
        periods = coloured(rng, SIGMA, 5, 200, 0.0)
        kept += estimated_filter(NoiseLines.of(periods), scatter(periods).covariance) is None
    assert kept >= 17


@pytest.mark.parametrize(("periods", "samples"), [(4, 40), (4, 41), (5, 40)])
def test_neighbours_leave_the_line_itself_out(periods, samples):
    """And with an even number of periods the adjacent ones, which share a contrast with it."""
    rng = np.random.default_rng(3)
    lines = NoiseLines.of(rng.standard_normal((periods, samples, 6)))
    reach = 1 - periods % 2
    count, width = len(lines.matrices), 5
    kept = (rng.random(count) > 0.2).astype(float)
    found, freedom = next(_neighbours(lines, [width], kept))
    for line in range(count):
        inside = np.arange(line - width, line + width + 1) % samples
        # Beyond the middle stand the conjugates of the lines.
        folded = np.minimum(inside, samples - inside)
        near = np.arange(line - reach, line + reach + 1) % samples
        near = np.minimum(near, samples - near)
        parts = [
            (lines.matrices[f] if f == i else lines.matrices[f].conj())
            for i, f in zip(inside, folded, strict=True)
            if f not in near and kept[f]
        ]
        np.testing.assert_allclose(found[line], np.mean(parts, axis=0), atol=1e-12)
        distinct = {int(f) for f in folded if f not in near and kept[f]}
        assert lines.freedom <= freedom[line] <= lines.freedom * len(distinct)


def test_lines_that_all_stand_out_predict_no_line_between_them():
    """Means over few neighbours are no candidate then; the spectrum is still found."""
    rng = np.random.default_rng(11)
    spectrum = np.fft.rfft(rng.standard_normal((2500, 6)), axis=0)
    spectrum[395:615] *= 10.0
    lines = NoiseLines.of(np.fft.irfft(spectrum, 2500, axis=0).reshape(10, 250, 6))
    found = smoothed_spectrum(lines, lines.covariance)
    size = np.einsum("kii->k", found.matrices).real / 6
    quiet, loud = np.r_[1:38, 64:124], np.r_[42:60]
    assert np.mean(size[quiet]) == pytest.approx(1.0, rel=0.2)
    assert np.mean(size[loud]) == pytest.approx(100.0, rel=0.2)


def test_what_a_line_weighs_does_not_depend_on_its_own_noise():
    periods = coloured(np.random.default_rng(3), SIGMA, 10, 300, 0.0)
    lines = NoiseLines.of(periods)
    changed = lines.matrices.copy()
    changed[40] *= 1.3
    kept = np.ones(len(changed))
    before, _ = next(_neighbours(lines, [8], kept))
    after, _ = next(_neighbours(replace(lines, matrices=changed), [8], kept))
    # Of ten periods, adjacent lines share a contrast.
    np.testing.assert_allclose(after[39:42], before[39:42])
    assert np.max(np.abs(after[42] / before[42] - 1)) > 1e-3


def test_a_smoothed_spectrum_does_not_depend_on_correlations_at_its_own_line():
    """Variances count through the autoregressive models, which are of the channels."""
    spectrum = np.fft.rfft(np.random.default_rng(0).standard_normal((3000, 6)), axis=0)
    line = np.arange(len(spectrum))[:, None] / 10
    spectrum *= np.where(np.abs(line - 60) < 25, 3.0, 1.0)
    spectrum *= np.where(np.abs(line - 120) < 10, 0.3, 1.0)
    lines = NoiseLines.of(np.fft.irfft(spectrum, 3000, axis=0).reshape(10, 300, 6))
    changed = lines.matrices.copy()
    changed[50] *= np.where(np.eye(6), 1.0, 1.2)
    before, after = (
        smoothed_spectrum(each, lines.covariance).smooth
        for each in (lines, replace(lines, matrices=changed))
    )
    # Of ten periods, adjacent lines share a contrast.
    np.testing.assert_allclose(after[49:52], before[49:52], rtol=1e-9)
    assert np.max(np.abs(after[[48, 52]] / before[[48, 52]] - 1)) > 1e-3


def test_a_hum_keeps_its_own_line():
    samples, rng = 400, np.random.default_rng(4)
    periods = coloured(rng, np.eye(6), 10, samples, 0.0)
    time = np.arange(10 * samples)
    # Between two lines, so that its phase differs from period to period.
    hum = 0.7 * np.sin(2 * np.pi * 20.3 * time / samples).reshape(10, samples)
    found = smoothed_spectrum(NoiseLines.of(periods + hum[:, :, None]), np.eye(6) * 1.25)
    assert found.standing_out[20]
    assert np.count_nonzero(found.standing_out) <= 4
    size = np.einsum("lii->l", found.matrices).real / 6
    assert size[20] > 5 * np.median(size)


@pytest.mark.parametrize("quieter", [1, 20, 100])
@pytest.mark.parametrize("correlation", [0, 0.99])
def test_whitening_behind_a_filter_holds_for_channels_of_any_size(quieter, correlation):
    """At every line H C̄ Hᴴ = Σ, also where the filter has left 1e-8 of the noise."""
    std = np.array([1, 1, 1, 1, 1, 1 / quieter])
    alike = correlation + (1 - correlation) * np.eye(6)
    covariance = np.outer(std, std) * alike
    damping = np.tile(np.geomspace(1, 1e-4, 201)[:, None], 6)
    noise = NoiseEstimate(covariance, np.inf, "given").before_sensors(damping, 400)
    gain = noise.filter.gain
    whitened = gain @ noise.filter.spectrum @ gain.conj().transpose(0, 2, 1)
    assert np.max(np.abs(whitened - covariance) / np.outer(std, std)) < 1e-6


def test_behind_a_filter_the_weights_are_as_uncertain_as_without():
    """A filter that changes nothing: 50 degrees of freedom make the variances 1.36 times larger."""
    recording = fold_recording(measured(MOTION), MOTION.omega, PeriodSource.DESIGN)
    known, seen = (
        NoiseModel(NoiseEstimate(SIGMA, freedom), NoiseEstimate(DELTA, freedom))
        for freedom in (np.inf, 50.0)
    )
    behind = NoiseModel(
        *(each.before_sensors(np.ones((101, 6)), 200) for each in (seen.forces, seen.lengths))
    )
    fit = fit_motion(ROBOT, recording, known.lengths, MOTION.harmonics)
    exact, without, within = (
        linear_estimate(
            ROBOT, [Experiment.from_fit(ROBOT, recording, noise, fit)], GLIDING, "gm"
        ).covariance
        for noise in (known, seen, behind)
    )
    np.testing.assert_allclose(without, 50 * 49 / (44 * 41) * exact, rtol=1e-9)
    np.testing.assert_allclose(np.diag(within), np.diag(without), rtol=1e-9)


def test_filtered_noise_is_white():
    samples, memory = 300, 0.8
    spectrum = first_order(samples, memory)[:, None, None] * SIGMA.astype(complex)
    whiten = given_filter(SIGMA, spectrum, samples)
    noise = coloured(np.random.default_rng(5), SIGMA, 400, samples, memory)
    lines = NoiseLines.of(np.stack([whiten(period) for period in noise]))
    size = np.einsum("lij,ji->l", lines.matrices, np.linalg.inv(SIGMA)).real / 6
    # A period's ends do not meet: what leaks is of the memory's share in the period.
    np.testing.assert_allclose(size, 1.0, atol=0.15)


@pytest.mark.parametrize("memory", [0.97, 0.99])
def test_the_mean_of_noise_with_a_long_memory_is_white_behind_the_filter(memory):
    """The memory is a third of a period: its ends do not meet, those of the mean do."""
    rng, ratios = np.random.default_rng(6), []
    for _ in range(25):
        periods = coloured(rng, SIGMA, 10, 300, memory)
        seen = scatter(periods)
        whiten = estimated_filter(NoiseLines.of(periods), seen.covariance)
        mean = whiten(periods.mean(axis=0)) * np.sqrt(10)
        ratios.append(np.einsum("ni,ij,nj->", mean, np.linalg.inv(seen.covariance), mean) / 1800)
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.04)


@pytest.mark.parametrize("samples", [60, 61])
def test_a_harmonic_turns_the_lines_of_the_slopes(samples):
    rng, phase = np.random.default_rng(9), 0.7
    angle = 2 * np.pi * np.arange(samples) / samples + phase
    parts = np.stack([np.ones(samples), np.cos(angle), np.sin(3 * angle)])
    slopes = np.einsum("pn,pij->nij", parts, rng.standard_normal((3, 6, 6)))
    # Each channel has a memory of its own: the spectra are complex.
    memory = np.linspace(0.1, 0.8, 6)
    turn = np.exp(-2j * np.pi * np.arange(samples // 2 + 1) / samples)
    response = 1 / (1 - memory * turn[:, None])
    spectrum = response[:, :, None] * SIGMA * response.conj()[:, None, :]
    whiten, inverse = given_filter(SIGMA, spectrum, samples), np.linalg.inv(SIGMA)
    information = _turn_information(slopes, whiten.gain @ inverse @ whiten.gain, phase)
    for harmonic in (1, 4, samples // 2 - 1):
        waves = (np.sin(harmonic * angle), np.cos(harmonic * angle))
        columns = np.concatenate([slopes * wave[:, None, None] for wave in waves], axis=2)
        filtered = whiten(columns)
        expected = np.einsum("nia,ij,njb->ab", filtered, inverse, filtered)
        scale = np.max(np.abs(expected))
        np.testing.assert_allclose(information(harmonic), expected, atol=1e-12 * scale)
        rows = whiten.rows(columns)
        np.testing.assert_allclose(
            np.einsum("nia,ij,njb->ab", rows, inverse, rows), expected, atol=1e-12 * scale
        )


@cache
def experiment(memory=0.0, *, filtered=False, scale=1.0, longer=1.0, gliding=False):
    """Return an experiment whose noise is filtered as noise with this memory would be.

    Its noise is smaller by `scale` than what is assumed, that of the lengths larger by `longer`.
    """
    data = measured(MOTION, force_scale=scale, length_scale=scale * longer)
    if gliding:
        states = MOTION.sample(data.time)
        values = np.array(ROBOT.parameters)
        without = ROBOT.actuator_forces(*states, np.where(GLIDING.free, values, 0.0))
        data = replace(data, forces=data.forces + without - ROBOT.actuator_forces(*states))
    record = fold_recording(data, MOTION.omega, PeriodSource.DESIGN)
    noises = []
    for covariance in (SIGMA, longer**2 * DELTA):
        matrices = first_order(record.samples, memory)[:, None, None] * covariance.astype(complex)
        own = given_filter(covariance, matrices, record.samples) if filtered else None
        lines = NoiseLines(matrices, record.samples, np.inf)
        noises.append(NoiseEstimate(covariance, np.inf, "given", lines, own))
    noise = NoiseModel(*noises)
    start = HarmonicMotion.of(MOTION)
    own = noise.lengths
    fit = fit_motion(ROBOT, record, own, 2, start=start)
    return Experiment.from_fit(ROBOT, record, noise, fit)


def estimated(case, known=KNOWN):
    results = {name: linear_estimate(ROBOT, [case], known, name) for name in ("ls", "gm")}
    return results | {"ml": maximum_likelihood(ROBOT, [case], known, results["gm"])}


def disturbed(case, forces, lengths):
    """Return the experiment with errors added to its means."""
    record = case.recording
    record = replace(
        record,
        forces=replace(record.forces, values=record.forces.values + forces),
        lengths=replace(record.lengths, values=record.lengths.values + lengths),
    )
    fit = fit_motion(ROBOT, record, case.noise.lengths, 2, start=case.fit.motion)
    known = MotionEstimate(fit.motion, fit.covariance, case.fit.spread)
    return Experiment.along(ROBOT, record, case.noise, known)


@pytest.mark.parametrize("filtered", [False, True])
def test_the_influence_is_how_an_estimate_moves_with_the_data(filtered):
    # Next to no residuals: what they add to the second derivative is not in a Gauss–Newton law.
    case = experiment(memory=0.6, filtered=filtered, scale=1e-3, longer=20.0, gliding=True)
    rng = np.random.default_rng(6)
    count = case.recording.samples
    forces = 0.3 * coloured(rng, SIGMA, 1, count, 0.9)[0]
    lengths = 6 * coloured(rng, DELTA, 1, count, 0.9)[0]
    for errors in ((forces, 0 * lengths), (0 * forces, lengths)):
        moved, present = (estimated(each, GLIDING) for each in (disturbed(case, *errors), case))
        for name, estimate in present.items():
            (influence,) = estimate.influences
            expected = influence.response(
                lambda part: errors[0][part][:, :, None],  # noqa: B023 - called at once
                lambda part: errors[1][part][:, :, None],  # noqa: B023 - called at once
            )[:, 0]
            found = (moved[name].values - estimate.values)[GLIDING.free]
            std = estimate.std[GLIDING.free]
            assert np.linalg.norm((found - expected) / std) < 0.05 * np.linalg.norm(expected / std)


@pytest.mark.parametrize("filtered", [False, True])
def test_the_covariance_is_that_of_the_noise_as_it_is(filtered):
    case = experiment(memory=0.9, filtered=filtered)
    found = estimated(case)
    rng = np.random.default_rng(7)
    draws = 400
    periods = [coloured(rng, each, draws, case.recording.samples, 0.9) for each in (SIGMA, DELTA)]
    means = [each / np.sqrt(case.counts[0]) for each in periods]
    for estimate in found.values():
        (influence,) = estimate.influences
        moved = influence.response(
            lambda part: means[0].transpose(1, 2, 0)[part],
            lambda part: means[1].transpose(1, 2, 0)[part],
        )
        ratio = np.var(moved, axis=1) / np.diag(estimate.covariance)
        assert abs(np.mean(ratio) - 1) < 0.15
        assert np.all(np.abs(ratio - 1) < 6 * np.sqrt(2 / draws))
    spread = np.exp(np.mean(np.log(found["gm"].std / found["ls"].std)))
    assert spread < (0.75 if filtered else 1.0)


def test_white_lines_give_the_covariance_of_white_noise():
    case = experiment()
    plain = replace(case, noise=case.noise.as_white())
    for name, estimate in estimated(case).items():
        expected = estimated(plain)[name]
        np.testing.assert_allclose(estimate.covariance, expected.covariance, rtol=1e-8)
        np.testing.assert_allclose(estimate.colour, 1.0, rtol=1e-8)


def test_weights_that_lose_something_are_no_colour():
    """White lines, and a filter that does nothing but is an estimate."""
    data = measured(MOTION)
    record = fold_recording(data, MOTION.omega, PeriodSource.DESIGN)
    flat = np.broadcast_to(SIGMA, (record.samples // 2 + 1, 6, 6)).astype(complex)
    weights = replace(given_filter(SIGMA, flat, record.samples), loss=1.2)
    lines = NoiseLines(flat, record.samples, np.inf)
    forces = NoiseEstimate(SIGMA, np.inf, lines=lines, filter=weights)
    noise = replace(given_noise(SIGMA, DELTA), forces=forces)
    fit = fit_motion(ROBOT, record, noise.lengths, 2)
    experiment = Experiment.from_fit(ROBOT, record, noise, fit)
    found = linear_estimate(ROBOT, [experiment], KNOWN, "gm")
    np.testing.assert_allclose(found.colour, 1.0, rtol=1e-6)


@pytest.mark.parametrize("samples", [6, 7, 8, 30])
def test_weights_from_next_to_nothing_have_a_finite_loss(samples):
    periods = coloured(np.random.default_rng(0), SIGMA, 3, samples, 0.9)
    found = estimated_filter(NoiseLines.of(periods), scatter(periods).covariance, always=True)
    assert found is None or 1 < found.loss < 100


def test_the_difference_of_gm_and_ml_under_white_noise_is_that_of_their_covariances():
    # Hardly any residuals: both are linearised at the same place.
    found = estimated(experiment(scale=1e-4, longer=30.0, gliding=True), GLIDING)
    expected = found["gm"].covariance - found["ml"].covariance
    covariance = covariance_ml_less_gm(found)
    std = np.where(GLIDING.free, found["ml"].std, 1.0)
    error = np.abs(covariance - expected) / np.multiply.outer(std, std)
    assert np.max(error) < 0.02 * np.max(np.diag(covariance) / std**2)


@pytest.mark.parametrize(("periods", "memory"), [(3, 0.0), (3, 0.8), (10, 0.8)])
def test_intervals_cover_with_the_spectrum_of_few_periods(periods, memory):
    case = experiment(memory=memory)
    (influence,) = linear_estimate(ROBOT, [case], KNOWN, "gm").influences
    rng = np.random.default_rng(8)
    samples, hits = case.recording.samples, []
    for _ in range(60):
        noise = [coloured(rng, each, periods, samples, memory) for each in (SIGMA, DELTA)]
        means = [each.mean(axis=0)[:, :, None] for each in noise]
        error = influence.response(lambda part: means[0][part], lambda part: means[1][part])  # noqa: B023 - called at once
        record = replace(
            case.recording,
            forces=replace(case.recording.forces, counts=np.full(samples, float(periods))),
            lengths=replace(case.recording.lengths, counts=np.full(samples, float(periods))),
        )
        seen = [replace(scatter(each), lines=NoiseLines.of(each)) for each in noise]
        # Weights as they were; the spectrum and the number of periods are this draw's.
        known = replace(case, recording=record, noise=NoiseModel(*seen))
        share = periods / case.counts[0]
        own = replace(
            influence,
            experiment=known,
            weights=replace(seen[0], covariance=influence.weights.covariance),
            force_gain=influence.force_gain / share,
            length_gain=influence.length_gain / share,
        )
        stated = covariance_fields([own], KNOWN, np.zeros_like(influence.force_gain))
        std = np.sqrt(np.diag(stated["covariance"]))
        hits.append(np.abs(error[:, 0]) <= interval_widths(stated["freedom"]) * std)
    coverage, trials = np.mean(hits), len(hits)
    # Parameters of one draw are not independent: about a sixth of them count.
    margin = stats.norm.ppf(0.999) * np.sqrt(0.95 * 0.05 / (trials * 4))
    assert abs(coverage - 0.95) < margin


@pytest.mark.parametrize(
    ("disturbance", "loss"),
    [
        pytest.param(
            {"lost": {"share": 0.002}}, "squared", marks=[pytest.mark.slow, pytest.mark.full]
        ),
        ({"lost": {"share": 0.05}}, "squared"),
        pytest.param(
            {"outliers": {"share": 0.002, "force": 300.0, "length": 1e-3}},
            "huber",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_intervals_cover_where_samples_are_missing_or_count_less(disturbance, loss):
    """Taken for white, this noise has intervals that hold the truth much too seldom."""
    config = run(
        {"estimators": ["gm"], "loss": loss},
        noise={"force_spectrum": {"ar": 0.9}},
        experiment={"periods": 8, "sampling": 1 / STEP, "seed": 5, **disturbance},
    )
    twin, hits, truth = Twin.of(config, MOTION), [], np.array(ROBOT.parameters)
    for repetition in range(1, 41):
        case = identification.prepare_experiment(
            config, ROBOT, twin.measurement(repetition), MOTION
        )
        assert case.noise.forces.filter is not None
        found = identification.run_estimators(ROBOT, [case], KNOWN, ("gm",))["gm"]
        widths = interval_widths(found.freedom) * found.std
        hits.append(np.abs(found.values - truth) <= widths)
    margin = stats.norm.ppf(0.999) * np.sqrt(0.95 * 0.05 / (len(hits) * 4))
    assert abs(np.mean(hits) - 0.95) < margin


def test_tolerances_make_no_colour_significant():
    """Colour is judged by what the random share rests on, which is all that it is of."""
    data, section = measured(MOTION), {"estimators": ["gm"], "harmonics": MOTION.harmonics}
    alone = identification.estimate_parameters(run(section), data, MOTION)["gm"]
    config = run(section, tolerances={"platform_joints": "5 mm"})
    together = identification.estimate_parameters(config, data, MOTION)["gm"]
    assert np.max(together.std / alone.std) > 2
    assert together.largest_colour_ratio() == pytest.approx(alone.largest_colour_ratio(), rel=1e-6)


@pytest.mark.parametrize("name", ["gm", "ml"])
def test_a_memory_that_is_weighted_as_white_is_no_fault_of_the_model(name):
    memory = {"force_spectrum": {"ar": 0.7}, "length_spectrum": {"ar": 0.7}}
    machine = run(noise=memory, experiment={"periods": 10, "sampling": 1 / STEP})
    white = run({"spectrum": "white", "estimators": [name], "harmonics": 2})
    for number in (1, 2):
        data = Twin.of(machine, MOTION, seed=4).measurement(number)
        result = identification.estimate_parameters(white, data, MOTION)
        experiments = [each.experiment for each in result.recordings]
        found = diagnose(ROBOT, experiments, result.priors, result[name])
        assert found.verdict.status is Status.ACCEPTED
        assert not experiments[0].noise.forces.filter


@pytest.mark.parametrize("memory", [0.0, 0.9, 0.98, 0.999])
def test_where_filtered_periods_begin_and_end_are_no_outliers(memory):
    """A filter goes round the period, and noise with memory does not join its own beginning."""
    case, rng = experiment(memory=memory), np.random.default_rng(4)
    found = []
    for _ in range(20):
        periods = coloured(rng, SIGMA, 10, 200, memory)
        seen = replace(scatter(periods), lines=NoiseLines.of(periods))
        seen = replace(seen, filter=estimated_filter(seen.lines, seen.covariance))
        assert (seen.filter is None) == (memory == 0)
        for outliers in (0, 4):
            dirty = periods.copy()
            dirty[rng.integers(10, size=outliers), rng.integers(20, 180, size=outliers), 2] += 400.0
            channels = replace(case.recording.forces, periods=dirty, values=dirty.mean(axis=0))
            record = replace(case.recording, forces=channels, periods=10.0)
            tests = noise_tests(record, NoiseModel(seen, case.noise.lengths), channels.values, None)
            normal = tests.normality.forces
            found.append((outliers, np.any(normal.with_outliers), np.any(normal.failed)))
    flagged = np.array([one[1:] for one in found if not one[0]])
    assert not np.any(flagged)
    assert all(one[1] for one in found if one[0])
