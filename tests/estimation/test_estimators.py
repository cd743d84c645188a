from dataclasses import replace

import numpy as np
import pytest
import statsmodels.api as sm
from scipy.optimize import least_squares as scipy_least_squares

from estimation.estimators import (
    Experiment,
    ParameterPriors,
    UnidentifiableError,
    linear_estimate,
    maximum_likelihood,
)
from estimation.estimators.experiment import regressors_along
from estimation.estimators.joint_equations import PerturbedMachine, reduced_information
from estimation.kinematics import fit_motion
from estimation.measurement_model import HarmonicMotion
from estimation.measurement_model.prediction import held_regressor_kernel
from estimation.processing import PeriodSource, fold_recording
from expdesign.configuration.estimate import EstimateSection
from tests.estimation.cases import ROBOT, given_noise, measured, trajectory

NOISE = ROBOT.description.noise
GIVEN = given_noise(NOISE.force_covariance, NOISE.length_covariance)
MOTION = trajectory()


def knowledge(**section):
    return ParameterPriors.of(ROBOT, EstimateSection(**section))


def experiment(seed=0, motion=MOTION, noise=GIVEN, **options):
    record = fold_recording(measured(motion, seed, **options), motion.omega, PeriodSource.DESIGN)
    start = HarmonicMotion.of(motion)
    fit = fit_motion(ROBOT, record, noise.lengths, 2, start=start)
    return Experiment.from_fit(ROBOT, record, noise, fit)


def test_gauss_markov_equals_generalised_least_squares():
    case = experiment()
    found = linear_estimate(ROBOT, [case], knowledge(), "gm")
    inverse = np.linalg.cholesky(np.linalg.inv(NOISE.force_covariance)).T
    rows = np.concatenate([inverse @ block for block in case.fitted_regressors])
    forces = (case.forces @ inverse.T).ravel()
    reference = sm.OLS(forces, rows).fit()
    np.testing.assert_allclose(found.values, reference.params, rtol=1e-9)
    periods = case.counts[0]
    expected = reference.normalized_cov_params / periods
    np.testing.assert_allclose(found.covariance_forces, expected, rtol=1e-6)


def test_least_squares_with_the_full_covariance_of_the_noise():
    case = experiment()
    found = linear_estimate(ROBOT, [case], knowledge(), "ls")
    rows = case.fitted_regressors.reshape(-1, 24)
    pseudo = np.linalg.pinv(rows)
    np.testing.assert_allclose(found.values, pseudo @ case.forces.ravel(), rtol=1e-8)
    full = np.kron(np.eye(case.recording.samples), NOISE.force_covariance / case.counts[0])
    np.testing.assert_allclose(found.covariance_forces, pseudo @ full @ pseudo.T, rtol=1e-6)


def test_the_share_of_the_kinematic_noise_is_how_estimates_move_with_the_motion():
    # Hardly any residual, whose part of the derivative has the mean zero and is not in B.
    case = experiment(force_scale=1e-3, length_scale=1e-3)
    inverse = np.linalg.inv(NOISE.force_covariance)
    signs = case.fit.signs(ROBOT, case.recording.forces.times)

    def estimates(step):
        moved = case.fit.motion.add_step(step)
        # Signs as they were: their change is no part of the derivative.
        rows = regressors_along(ROBOT, moved, case.recording.forces.times, signs)
        for weight in (np.eye(6), inverse):
            weighted = np.einsum("nij,ik->njk", rows, weight).transpose(1, 0, 2).reshape(24, -1)
            yield np.linalg.solve(weighted @ rows.reshape(-1, 24), weighted @ case.forces.ravel())

    steps = 1e-7 * np.eye(len(case.fit.covariance))
    ends = [np.array([list(estimates(sign * step)) for step in steps]) for sign in (1, -1)]
    slopes = (ends[0] - ends[1]).transpose(1, 2, 0) / 2e-7
    for estimator, slope in zip(("ls", "gm"), slopes, strict=True):
        base = linear_estimate(ROBOT, [case], knowledge(), estimator)
        expected = np.sqrt(np.diag(slope @ case.fit.covariance @ slope.T))
        found = np.sqrt(np.diag(base.covariance_kinematics))
        np.testing.assert_allclose(found, expected, rtol=1e-2)


def test_maximum_likelihood_equals_an_independent_least_squares():
    case = experiment()
    start = linear_estimate(ROBOT, [case], knowledge(), "gm")
    found = maximum_likelihood(ROBOT, [case], knowledge(), start)
    signs = case.along_motion(found.motions[0]).signs(ROBOT, case.recording.forces.times)
    force_white = np.linalg.inv(np.linalg.cholesky(NOISE.force_covariance))
    length_white = np.linalg.inv(np.linalg.cholesky(NOISE.length_covariance))
    times = case.recording.forces.times
    root = np.sqrt(case.counts[0])
    scales = np.concatenate([found.std, np.sqrt(np.diag(case.fit.covariance))])

    def residuals(scaled):
        values = scaled * scales
        table = values[24:].reshape(6, 5)
        motion = HarmonicMotion(table, MOTION.omega)
        states = motion.trajectory.sample(times)
        frozen = motion.at(times).state()
        kernel = held_regressor_kernel(ROBOT.terms)
        (regressors,) = kernel(frozen, signs, ROBOT.machine)
        force = (case.forces - regressors @ values[:24]) @ force_white.T
        length = (
            case.recording.lengths.values - ROBOT.inverse_kinematics(states.pose)
        ) @ length_white.T
        return root * np.concatenate([force.ravel(), length.ravel()])

    first = np.concatenate([start.values, case.fit.motion.table.ravel()]) / scales
    # Central differences: with one-sided ones ξ is off by a hundredth of its deviation.
    reference = scipy_least_squares(
        residuals, first, jac="3-point", xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    # It stops where rounding hides that the cost falls: one more step of Gauss and Newton.
    step = np.linalg.lstsq(reference.jac, -reference.fun)[0]
    values = (reference.x + step) * scales
    assert np.all(np.abs(found.values - values[:24]) < 1e-6 * (np.abs(values[:24]) + found.std))
    np.testing.assert_allclose(found.motions[0].table.ravel(), values[24:], atol=1e-9)
    jacobian = reference.jac / scales
    expected = np.linalg.inv(jacobian.T @ jacobian)[:24, :24]
    np.testing.assert_allclose(np.diag(found.covariance), np.diag(expected), rtol=1e-3)


def test_the_joint_information_is_that_of_the_stacked_rows():
    case = experiment()
    known = knowledge()
    machine = PerturbedMachine.exact(ROBOT)
    equations = machine.joint_equations(case, case.fit.motion, ROBOT.parameters, known.free)
    full = equations.matrix
    expected = np.linalg.inv(np.linalg.inv(full)[:24, :24])
    reduced = reduced_information([equations], known)
    np.testing.assert_allclose(reduced, expected, rtol=1e-5, atol=1e-6)
    # What the lengths leave open costs information.
    assert np.all(np.linalg.eigvalsh(full[:24, :24] - reduced) > -1e-6)


def test_two_experiments_are_worth_their_sum():
    other = trajectory(seed=9)
    one, two = experiment(1), experiment(2, other)
    known = knowledge()
    results = [
        maximum_likelihood(ROBOT, cases, known, linear_estimate(ROBOT, cases, known, "gm"))
        for cases in ([one], [two], [one, two])
    ]
    first, second, both = (np.linalg.inv(result.covariance) for result in results)
    np.testing.assert_allclose(both, first + second, rtol=0.05, atol=0.02 * np.abs(both).max())
    assert np.all(results[2].std < np.minimum(results[0].std, results[1].std))


def test_fixed_parameters_stay():
    known = knowledge(fixed={"p1": 0.004, "p4": None})
    case = experiment()
    start = linear_estimate(ROBOT, [case], known, "gm")
    for result in (start, maximum_likelihood(ROBOT, [case], known, start)):
        assert result.values[0] == 0.004
        assert result.values[3] == ROBOT.parameters[3]
        assert result.std[0] == 0
        assert np.all(result.std[[1, 2, *range(4, 24)]] > 0)


def test_a_prior_pulls_as_its_precision_says():
    case = experiment()
    free = linear_estimate(ROBOT, [case], knowledge(), "gm")
    k = 0
    known = knowledge(prior={"p1": {"value": 0.02, "std": float(free.std[k])}})
    pulled = linear_estimate(ROBOT, [case], known, "gm")
    # Two pieces of knowledge with the same weight: the mean, with 1/√2 of the error.
    assert pulled.values[k] == pytest.approx((free.values[k] + 0.02) / 2, rel=1e-2)
    assert np.sqrt(pulled.covariance_forces[k, k]) == pytest.approx(
        np.sqrt(free.covariance_forces[k, k] / 2), rel=2e-2
    )


def test_bounds_hold_and_the_others_give_way():
    case = experiment()
    free = linear_estimate(ROBOT, [case], knowledge(), "gm")
    low = float(free.values[9] + 2 * free.std[9])
    known = knowledge(bounds={"p10": [low, low + 1]})
    start = linear_estimate(ROBOT, [case], known, "gm")
    full = maximum_likelihood(ROBOT, [case], known, start)
    for result in (start, full):
        assert result.values[9] == pytest.approx(low, rel=1e-12)
        assert known.at_bound(result.values)[9]
    assert full.converged
    # p9 goes with p10: the conditional mean of the normal distribution.
    expected = free.values + free.covariance[:, 9] / free.covariance[9, 9] * (low - free.values[9])
    assert abs(start.values[8] - expected[8]) < 0.2 * free.std[8]


def test_parameters_that_nothing_excites_are_named():
    still = trajectory()
    slow = still.__class__(2 * np.pi / 1000, still.lambda0, still.mu * 1e-7, still.nu * 1e-7)
    case = experiment(0, MOTION)
    spread = np.zeros((case.recording.samples, 18))
    known = replace(case.fit, motion=HarmonicMotion.of(slow), spread=spread)
    frozen = Experiment.along(ROBOT, case.recording, GIVEN, known)
    with pytest.raises(UnidentifiableError) as error:
        linear_estimate(ROBOT, [frozen], knowledge(), "gm")
    assert "p1" in error.value.names
    assert "estimate.fixed" in str(error.value)


def test_estimates_spread_as_they_say_and_cover():
    known = knowledge()
    pulls = {"ls": [], "gm": [], "ml": []}
    noise = given_noise(NOISE.force_covariance, 25 * NOISE.length_covariance)
    for seed in range(40):
        case = experiment(seed, noise=noise, length_scale=5)
        gm = linear_estimate(ROBOT, [case], known, "gm")
        results = (linear_estimate(ROBOT, [case], known, "ls"), gm)
        for result in (*results, maximum_likelihood(ROBOT, [case], known, gm)):
            pulls[result.estimator].append((result.values - ROBOT.parameters) / result.std)
    for name, drawn in pulls.items():
        values = np.array(drawn)
        # 40 × 24 correlated values.
        assert 0.8 < np.sqrt(np.mean(values**2)) < 1.2, name
        assert 0.90 < np.mean(np.abs(values) < 1.96) < 0.99, name
        assert np.max(np.abs(values.mean(axis=0))) * np.sqrt(40) < 3.9, name
