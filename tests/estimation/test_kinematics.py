from dataclasses import replace

import numpy as np
import pytest

from estimation.data.measurement import Measurement
from estimation.kinematics import (
    MotionFitError,
    choose_harmonics,
    fit_motion,
    pointwise_motion,
    rate_spread,
    signs_along,
    start_motion,
)
from estimation.measurement_model import HarmonicMotion
from estimation.processing import NoiseEstimate, PeriodSource, fold_recording
from expdesign.trajectory import FourierTrajectory
from tests.estimation.cases import ROBOT, measured, trajectory

DELTA = ROBOT.description.noise.length_covariance
NOISE = NoiseEstimate(DELTA, np.inf, "given")


def record_of(motion, seed=0, **options):
    return fold_recording(measured(motion, seed, **options), motion.omega, PeriodSource.DESIGN)


def test_noise_free_lengths_give_the_motion_back():
    motion = trajectory()
    fit = fit_motion(ROBOT, record_of(motion, length_scale=0), NOISE, 2)
    np.testing.assert_allclose(fit.motion.table, HarmonicMotion.of(motion).table, atol=1e-10)


@pytest.mark.slow
def test_the_fit_spreads_as_its_covariance_says():
    motion = trajectory()
    true = HarmonicMotion.of(motion)
    offs, chi = [], []
    weights = np.linalg.inv(DELTA)
    for seed in range(60):
        record = record_of(motion, seed)
        fit = fit_motion(ROBOT, record, NOISE, 2, start=true)
        offs.append((fit.motion.table - true.table).ravel())
        rest, freedom = fit.residuals, fit.residuals.size - len(fit.covariance)
        chi_square = np.einsum("s,si,ij,sj->", record.lengths.counts, rest, weights, rest)
        chi.append(chi_square / freedom)
    normal = np.linalg.solve(np.linalg.cholesky(fit.covariance), np.array(offs).T)
    # 60 × 30 standard normal values: their mean square is 1 ± 0.033.
    assert abs(np.mean(normal**2) - 1) < 0.12
    assert abs(np.mean(chi) - 1) < 0.02


def test_a_fit_from_the_data_alone_equals_one_from_the_design():
    motion = trajectory()
    record = record_of(motion)
    own = fit_motion(ROBOT, record, NOISE, 2)
    helped = fit_motion(ROBOT, record, NOISE, 2, start=HarmonicMotion.of(motion))
    np.testing.assert_allclose(own.motion.table, helped.motion.table, atol=1e-9)


def test_a_free_frequency_is_found_with_its_uncertainty():
    motion = trajectory()
    scores = []
    for seed in range(30):
        data = measured(motion, seed)
        record = fold_recording(data, motion.omega * (1 + 1e-5), PeriodSource.DESIGN, average=False)
        start = replace(start_motion(ROBOT, record, 2), free_frequency=True)
        fit = fit_motion(ROBOT, record, NOISE, 2, start=start)
        error = np.sqrt(fit.covariance[-1, -1])
        scores.append((fit.motion.omega - motion.omega) / error)
    assert abs(np.mean(scores)) < 0.6
    assert 0.5 < np.std(scores) < 1.5


def test_harmonics_are_chosen_from_the_data():
    base = trajectory()
    table = HarmonicMotion.of(base).with_harmonics(6)
    table.table[0, 6] = 0.3e-3  # sine of the sixth harmonic in x
    disturbed = table.trajectory
    right = 0
    for seed in range(20):
        plain = choose_harmonics(ROBOT, record_of(base, seed), NOISE, 2)
        right += plain.motion.harmonics == 2
        found = choose_harmonics(ROBOT, record_of(disturbed, seed), NOISE, 2)
        assert found.motion.harmonics == 6
    # One in a thousand is found by chance.
    assert right >= 19


def test_more_harmonics_than_samples_are_refused():
    with pytest.raises(MotionFitError, match="150 harmonics need 301 samples"):
        fit_motion(ROBOT, record_of(trajectory()), NOISE, 150)


def test_central_differences_of_clean_lengths():
    motion = trajectory()
    record = record_of(motion, length_scale=0)
    found = pointwise_motion(ROBOT, record)
    truth = motion.sample(record.forces.times)
    np.testing.assert_allclose(found.state[:, :6], truth.pose, atol=1e-9)
    # Second order in the step: (2 ω h)²/6 of the rate.
    np.testing.assert_allclose(found.state[:, 6:12], truth.rate, atol=5e-3)
    np.testing.assert_allclose(found.state[:, 12:], truth.acceleration, atol=5e-2)


def test_the_low_pass_quietens_the_accelerations_without_delay():
    motion = trajectory()
    record = record_of(motion)
    truth = motion.sample(record.forces.times).acceleration
    rough = pointwise_motion(ROBOT, record).state[:, 12:] - truth
    smooth = pointwise_motion(ROBOT, record, cutoff=10.0).state[:, 12:] - truth
    assert np.std(smooth) < 0.1 * np.std(rough)
    slope = motion.sample(record.forces.times + 1e-6).acceleration - truth
    lag = np.sum(smooth * slope) / np.sum(slope**2) * 1e-6
    assert abs(lag) < 0.1 * record.step


def test_single_samples_lose_their_ends_and_nothing_else():
    motion = trajectory(200.4)
    record = record_of(motion, length_scale=0)
    found = pointwise_motion(ROBOT, record)
    truth = motion.sample(record.forces.times[found.rows])
    np.testing.assert_allclose(found.state[:, 12:], truth.acceleration, atol=5e-2)


def test_stamped_data_are_not_differentiated_point_by_point():
    data = measured(trajectory())
    stamped = Measurement(data.time, data.lengths, data.forces, data.step, stamped=True)
    record = fold_recording(stamped, 2 * np.pi, PeriodSource.DESIGN)
    with pytest.raises(MotionFitError, match="uniform time"):
        pointwise_motion(ROBOT, record)


def test_signs_along_are_the_mean_of_the_signs_of_drawn_motions():
    motion = trajectory()
    record = record_of(motion, length_scale=30)
    fit = fit_motion(ROBOT, record, replace(NOISE, covariance=900 * DELTA), 2)
    times = record.forces.times
    spread = rate_spread(ROBOT, fit.motion, record, fit.covariance)
    expected = signs_along(ROBOT, fit.motion.at(times), spread)
    rng = np.random.default_rng(0)
    factor = np.linalg.cholesky(fit.covariance)
    draws = 200
    total = np.zeros_like(expected)
    for _ in range(draws):
        drawn = fit.motion.add_step(factor @ rng.normal(size=len(factor)))
        total += signs_along(ROBOT, drawn.at(times), np.zeros_like(spread))
    doubtful = np.abs(expected) < 0.99
    assert np.count_nonzero(doubtful) > 50
    error = np.sqrt((1 - expected**2) / draws + 1e-4)
    assert np.sqrt(np.mean(((total / draws - expected) / error)[doubtful] ** 2)) < 1.5
    assert np.all(spread > 0)


def test_signs_are_not_known_where_the_whole_machine_rests():
    """At both ends of its path all rates are zero but for the errors of the fit."""
    plain = trajectory()
    motion = FourierTrajectory.from_displacements(
        plain.omega, plain.lambda0, 0 * plain.sine, plain.cosine
    )
    record = record_of(motion)
    fit = fit_motion(ROBOT, record, NOISE, 2)
    spread = rate_spread(ROBOT, fit.motion, record, fit.covariance)
    signs = signs_along(ROBOT, fit.motion.at(record.forces.times), spread)
    rests = np.isin(np.arange(record.samples), (0, record.samples // 2))
    np.testing.assert_array_equal(np.isinf(spread), np.tile(rests[:, None], spread.shape[1]))
    assert not np.any(signs[rests])
    assert np.mean(np.abs(signs[~rests]) > 0.99) > 0.9
