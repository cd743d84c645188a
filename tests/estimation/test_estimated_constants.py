"""Constants of terms that are estimated with the parameters: pitch and velocity."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import scipy

from estimation.diagnostics.diagnosis import diagnose
from estimation.estimators.knowledge import UnidentifiableError
from estimation.identification import estimate
from estimation.identification.record import EstimateRecord
from expdesign.configuration import InputError, load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.mechanism.catalogue import DEFAULT
from expdesign.robot import load_robot, robot_from
from expdesign.robot.deviation import estimated_constants, tolerated
from tests.estimation.cases import ROBOT, measured, read_estimate, trajectory

STEP = 0.01
MOTION = trajectory(100, STEP)
PITCH, VELOCITY = 0.03, 0.06
WAVES = {f"{name}{j}": value for name, value in (("cs", 9.0), ("cc", -5.0)) for j in range(1, 7)}
HUMPS = {f"s{j}": 15.0 for j in range(1, 7)}
QUIET = 0.1


@cache
def _palida():
    return load_robot_description("palida").description.model_dump(mode="json", by_alias=True)


def _terms(pitch, velocity):
    return [*DEFAULT, {"cogging": {"pitch": pitch}}, {"stribeck": {"velocity": velocity}}]


def _guess(value):
    return {"value": value, "estimate": True}


def _noise():
    own = ROBOT.description.noise
    sizes = {"force": own.force_covariance, "length": own.length_covariance}
    return {f"{kind}_covariance": (QUIET**2 * size).tolist() for kind, size in sizes.items()}


PITCH_BEGUN, VELOCITY_BEGUN = _guess(1.02 * PITCH), _guess(1.3 * VELOCITY)


def _run(pitch=PITCH_BEGUN, velocity=VELOCITY_BEGUN, estimate=None, **sections):
    robot = _palida() | {"terms": _terms(pitch, velocity)}
    section = {"noise": "given", "harmonics": 2, "estimators": ["gm"], **(estimate or {})}
    given = {"noise": _noise(), "estimate": section, **sections}
    return load_run({"name": "n", "robot": robot, **given})


@cache
def _machine():
    parameters = _palida()["parameters"] | WAVES | HUMPS
    robot = _palida() | {"terms": _terms(PITCH, VELOCITY), "parameters": parameters}
    return robot_from(load_run({"name": "n", "robot": robot}).robot)


def _data(seed=0, scale=QUIET):
    return measured(
        MOTION, seed, robot=_machine(), step=STEP, force_scale=scale, length_scale=scale
    )


def _constants(found):
    """Return pitch and velocity of an estimate, and their standard deviations."""
    start = {"cogging_pitch": 1.02 * PITCH, "stribeck_velocity": 1.3 * VELOCITY}
    known = found.systematic
    names = [one.name for one in known.deviations]
    at = [names.index(name) for name in start]
    return np.array(list(start.values())) + known.values[at], known.std[at]


def test_both_estimators_find_them_with_the_spread_they_state():
    true, runs = np.array([PITCH, VELOCITY]), 8
    off, parameters = {"gm": [], "ml": []}, []
    for seed in range(runs):
        result = estimate(_run(estimate={"estimators": ["gm", "ml"]}), _data(seed), MOTION)
        for name, found in result.estimates.items():
            assert found.converged
            values, std = _constants(found)
            off[name].append((values - true) / std)
            parameters.append((found.values - _machine().parameters) / found.std)
    for name, errors in off.items():
        squares = np.sum(np.square(errors), axis=0)
        low, high = scipy.stats.chi2.ppf([2e-4, 1 - 2e-4], runs)
        assert np.all((low < squares) & (squares < high)), name
    # Parameters that move with the constants count that: 42 of them, much alike within a run.
    assert np.mean(np.square(parameters)) == pytest.approx(1, abs=0.3)


def test_it_is_the_least_of_all_squares():
    """A second computation: SciPy's search over parameters and constants, of a known motion."""
    exact = measured(MOTION, 3, robot=_machine(), step=STEP, force_scale=QUIET, length_scale=0.0)
    run = _run(noise=_noise() | {"length_covariance": (1e-16 * np.eye(6)).tolist()})
    found = estimate(run, exact, MOTION)["gm"]
    states = MOTION.sample(exact.time)
    factor = np.linalg.cholesky(QUIET**2 * ROBOT.description.noise.force_covariance)

    def model(constants):
        moved = replace(_machine().description, constants=tuple(constants))
        regressors = replace(_machine(), description=moved).regressor(*states)
        white = np.linalg.solve(factor, regressors)
        return white.reshape(-1, regressors.shape[2])

    target = np.linalg.solve(factor, exact.forces[..., None])[..., 0].ravel()

    def rest(constants):
        columns = model(constants)
        return target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]

    scale = [PITCH, VELOCITY]
    best = scipy.optimize.least_squares(rest, scale, x_scale=scale, xtol=1e-12, ftol=1e-12)
    values, std = _constants(found)
    # Next to a reversal the sign of friction is an expectation there, and exact here.
    np.testing.assert_allclose((values - best.x) / std, 0, atol=0.2)
    np.testing.assert_allclose(
        std, np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac))), rtol=0.05
    )


@pytest.mark.parametrize("share", [0.92, 0.97, 1.04, 1.08])
def test_the_search_for_a_pitch_begins_anywhere_near(share):
    run = _run(pitch=_guess(share * PITCH), velocity=VELOCITY)
    (known,) = (one.systematic for one in estimate(run, _data(1), MOTION).estimates.values())
    assert abs(share * PITCH + known.values[0] - PITCH) < 5 * known.std[0]


def test_a_tolerance_is_the_prior():
    """Information adds up, and the estimate is pulled by as much."""
    near = {"pitch": _guess(PITCH), "velocity": VELOCITY}
    free = estimate(_run(**near), _data(2), MOTION)["gm"]
    stated = 0.5 * float(free.systematic.std[0])
    tolerances = {"terms": {"cogging": {"pitch": stated}}}
    held = estimate(_run(**near, tolerances=tolerances), _data(2), MOTION)["gm"]
    expected = (free.systematic.std[0] ** -2 + stated**-2) ** -0.5
    assert held.systematic.std[0] == pytest.approx(expected, rel=0.02)
    pulled = free.systematic.values[0] * (held.systematic.std[0] / free.systematic.std[0]) ** 2
    assert held.systematic.values[0] == pytest.approx(pulled, abs=0.1 * stated)
    # What is left to the prior is systematic: nothing without one.
    assert not np.any(free.covariance_systematic)
    assert np.any(held.covariance_systematic)


@pytest.mark.parametrize("systematic", ["budget", "estimated"])
def test_they_stand_beside_tolerances(systematic):
    section = {"estimators": ["gm", "ml"], "systematic": systematic}
    run = _run(estimate=section, tolerances={"base_joints": "0.1 mm"})
    found = estimate(run, _data(4), MOTION)
    plain = estimate(_run(estimate={"estimators": ["gm", "ml"]}), _data(4), MOTION)
    for name, one in found.estimates.items():
        assert len(one.systematic.deviations) == 2 + 18
        values, std = _constants(one)
        others, _ = _constants(plain[name])
        assert np.all(np.abs(values - others) < 3 * std)
        joint = systematic == "estimated" and name == "ml"
        assert one.systematic.with_priors == joint
        share = np.diag(one.covariance_systematic)
        assert np.all(share[:3] > 0)
        if not joint:
            np.testing.assert_allclose(
                np.diag(one.covariance_random), np.diag(plain[name].covariance), rtol=1e-6
            )


def test_what_is_written_of_them(tmp_path):
    run = _run(estimate={"estimators": ["gm", "ml"]})
    result = estimate(run, _data(5), MOTION)
    diagnosis = diagnose(result.robot, result.experiments, result.knowledge, result.best)
    record = EstimateRecord.of(result, diagnosis)
    record.write(tmp_path)
    again = EstimateRecord.read(tmp_path)
    assert again.constants == record.constants
    rows = {(row.estimator, row.constant): row for row in again.constants}
    assert len(rows) == 4
    row = rows["ml", "cogging.pitch"]
    assert (row.unit, row.stated) == ("m", pytest.approx(1.02 * PITCH))
    assert np.isnan(row.tolerance)
    values, std = _constants(result["ml"])
    assert (row.value, row.std) == (pytest.approx(values[0]), pytest.approx(std[0]))
    kept = json.loads((tmp_path / "estimate.json").read_text())["estimators"]["ml"]
    assert [one["constant"] for one in kept["constants"]] == ["cogging.pitch", "stribeck.velocity"]
    assert not again.budget  # nothing has a tolerance
    # The robot that was found: value and what is left of it, still to be estimated.
    robot = load_robot(tmp_path / "identified-robot.yaml")
    np.testing.assert_allclose(robot.description.constants, values)
    left = {one.name: one.std for one in tolerated(robot)}
    np.testing.assert_allclose([left["cogging_pitch"], left["stribeck_velocity"]], std)
    assert len(estimated_constants(robot)) == 2
    saved = read_estimate(tmp_path, robot_from(run.robot)).estimate
    np.testing.assert_allclose(saved.systematic.values, result["ml"].systematic.values)
    np.testing.assert_allclose(saved.covariance_random, result["ml"].covariance_random)


def test_the_bound_counts_them():
    """No less than the covariance of maximum likelihood, which has them among its unknowns."""
    gm, ml = (estimate(_run(estimate={"estimators": [n]}), _data(7), MOTION) for n in ("gm", "ml"))
    np.testing.assert_allclose(np.sqrt(np.diag(gm.bound)), ml["ml"].std, rtol=0.02)


def test_residuals_are_those_of_the_machine_that_was_found():
    result = estimate(_run(), _data(6), MOTION)
    values, _ = _constants(result["gm"])
    np.testing.assert_allclose(result.robot.description.constants, values)
    diagnosis = diagnose(result.robot, result.experiments, result.knowledge, result.best)
    failed = {finding.assumption for finding in diagnosis.verdict.failed}
    assert not {"no position-periodic force", "the model explains the forces"} & failed


def test_constants_that_the_data_do_not_tell():
    terms = [*DEFAULT, "force_offset", {"cable": {"rest_length": _guess(0.6)}}]
    given = {"name": "n", "robot": _palida() | {"terms": terms}, "estimate": {"harmonics": 2}}
    springy = _palida()["parameters"] | {f"k{j}": 100.0 for j in range(1, 7)}
    machine = given | {"robot": given["robot"] | {"parameters": springy}}
    data = measured(MOTION, robot=robot_from(load_run(machine).robot), step=STEP)
    with pytest.raises(UnidentifiableError, match="estimate: false") as caught:
        estimate(load_run(given), data, MOTION)
    assert "cable_rest_length" in caught.value.names


def test_pointwise_kinematics_are_refused():
    with pytest.raises(InputError, match=r"cogging\.pitch, stribeck\.velocity") as caught:
        _run(estimate={"differentiation": "central"})
    assert caught.value.problems[0].key == "estimate.differentiation"


# Small, so that what is expected of the sign of friction is the sign.
UNEQUAL = {"force_std": [*["0.03 N"] * 4, *["0.4 N"] * 2], "length_std": ["3 um"] * 6}
EQUAL = {"force_std": ["0.04 N"] * 6, "length_std": ["10 um"] * 6}


@pytest.mark.parametrize("tolerance", [None, 2e-7])
@pytest.mark.parametrize(("estimator", "noise"), [("ls", UNEQUAL), ("gm", EQUAL)])
def test_their_spread_counts_weights_and_lengths(estimator, noise, tolerance):
    """A second computation: the sandwich from difference quotients, all samples at once."""
    sections = {"estimate": {"estimators": [estimator], "spectrum": "white"}, "noise": noise}
    if tolerance is not None:
        sections["tolerances"] = {"terms": {"cogging": {"pitch": tolerance}}}
    result = estimate(_run(_guess(PITCH), _guess(VELOCITY), **sections), _data(scale=0.0), MOTION)
    experiment, robot = result.experiments[0], _machine()
    motion, p, true = experiment.motion, robot.parameters, np.array([PITCH, VELOCITY])
    times, periods = experiment.record.forces.times, experiment.record.forces.counts[0]

    def regressor(motion, constants):
        moved = replace(robot.description, constants=tuple(constants))
        states = np.split(motion.at(times).state(), 3, axis=1)
        return replace(robot, description=moved).regressor(*states).reshape(6 * len(times), -1)

    def lengths(step):
        return robot.inverse_kinematics(motion.moved(step).at(times).state()[:, :6]).ravel()

    def slope(function, count, size):
        steps = size * np.eye(count)
        return np.transpose([(function(s) - function(-s)) / (2 * size) for s in steps])

    def whole(one_sample):
        return np.kron(np.eye(len(times)), one_sample) / periods

    by_constants = slope(lambda s: regressor(motion, true * (1 + s)) @ p, 2, 1e-6) / true
    by_motion = slope(lambda s: regressor(motion.moved(s), true) @ p, motion.unknowns, 1e-8)
    of_lengths = slope(lengths, motion.unknowns, 1e-8)
    columns = np.concatenate([regressor(motion, true), by_constants], axis=1)
    scales = np.linalg.norm(columns, axis=0)
    columns = columns / scales
    prior = np.zeros(len(scales))
    prior[len(p)] = 0.0 if tolerance is None else (tolerance * scales[len(p)]) ** -2

    forces, noise_of_lengths = experiment.noise.forces.covariance, experiment.noise.lengths
    weighting = forces if estimator == "gm" else np.eye(6) * np.trace(forces) / 6
    weighted = np.linalg.solve(whole(weighting), columns)
    inverse = np.linalg.inv(columns.T @ weighted + np.diag(prior))
    of_motion = of_lengths.T @ np.linalg.solve(whole(noise_of_lengths.covariance), of_lengths)
    noisy = whole(forces) + by_motion @ np.linalg.solve(of_motion, by_motion.T)
    covariance = inverse @ (weighted.T @ noisy @ weighted + np.diag(prior)) @ inverse
    expected, naive = (np.sqrt(np.diag(each))[-2:] / scales[-2:] for each in (covariance, inverse))
    np.testing.assert_allclose(result[estimator].systematic.std, expected, rtol=1e-4)
    assert np.any(np.abs(naive / expected - 1) > 0.05)
