"""Constants of terms that are estimated with the parameters: pitch and velocity."""

import json
from dataclasses import replace

import numpy as np
import pytest
import scipy

from estimation.diagnostics.diagnosis import diagnose
from estimation.estimators.priors import UnidentifiableError
from estimation.identification import estimate_parameters, estimation_result
from estimation.identification.calibration import estimated_machine
from estimation.identification.result import EstimationResult
from estimation.selection import Evidence
from expdesign.configuration import InputError, load_run
from expdesign.mechanism.terms import DEFAULT
from expdesign.robot import load_robot, robot_from
from expdesign.robot.deviation import estimated_constants, toleranced_deviations
from tests.estimation import constants as case
from tests.estimation.cases import ROBOT, measured, read_estimate
from tests.estimation.constants import MOTION, PITCH, QUIET, STEP, VELOCITY


@pytest.mark.slow
def test_both_estimators_find_them_with_the_spread_they_state(known_channels):
    true, runs = np.array([PITCH, VELOCITY]), 8
    off, parameters = {"gm": [], "ml": []}, []
    for seed in range(runs):
        result = estimate_parameters(
            case.run(estimate={"estimators": ["gm", "ml"]}), case.data(seed), MOTION
        )
        for name, found in result.estimates.items():
            assert found.converged
            values, std = case.constants(found)
            off[name].append((values - true) / std)
            parameters.append((found.values - case.machine().parameters) / found.std)
    for name, errors in off.items():
        squares = np.sum(np.square(errors), axis=0)
        low, high = scipy.stats.chi2.ppf([2e-4, 1 - 2e-4], runs)
        assert np.all((low < squares) & (squares < high)), name
    # Parameters that move with the constants count that: 42 of them, much alike within a run.
    assert np.mean(np.square(parameters)) == pytest.approx(1, abs=0.3)


def test_it_is_the_least_of_all_squares():
    """A second computation: SciPy's search over parameters and constants, of a known motion."""
    exact = measured(
        MOTION, 3, robot=case.machine(), step=STEP, force_scale=QUIET, length_scale=0.0
    )
    run = case.run(noise=case.noise() | {"length_covariance": (1e-16 * np.eye(6)).tolist()})
    found = estimate_parameters(run, exact, MOTION)["gm"]
    states = MOTION.sample(exact.time)
    factor = np.linalg.cholesky(QUIET**2 * ROBOT.description.noise.force_covariance)

    def model(constants):
        moved = replace(case.machine().description, constants=tuple(constants))
        regressors = replace(case.machine(), description=moved).regressor(*states)
        white = np.linalg.solve(factor, regressors)
        return white.reshape(-1, regressors.shape[2])

    target = np.linalg.solve(factor, exact.forces[..., None])[..., 0].ravel()

    def rest(constants):
        columns = model(constants)
        return target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]

    scale = [PITCH, VELOCITY]
    best = scipy.optimize.least_squares(rest, scale, x_scale=scale, xtol=1e-12, ftol=1e-12)
    values, std = case.constants(found)
    # Next to a reversal the sign of friction is an expectation there, and exact here.
    np.testing.assert_allclose((values - best.x) / std, 0, atol=0.2)
    np.testing.assert_allclose(
        std, np.sqrt(np.diag(np.linalg.inv(best.jac.T @ best.jac))), rtol=0.05
    )


@pytest.mark.parametrize("share", [0.92, 0.97, 1.04, 1.08])
def test_the_search_for_a_pitch_begins_anywhere_near(share):
    run = case.run(pitch=case.guess(share * PITCH), velocity=VELOCITY)
    (known,) = (
        one.systematic for one in estimate_parameters(run, case.data(1), MOTION).estimates.values()
    )
    assert abs(share * PITCH + known.values[0] - PITCH) < 5 * known.std[0]


def test_a_tolerance_is_the_prior():
    """Information adds up, and the estimate is pulled by as much."""
    near = {"pitch": case.guess(PITCH), "velocity": VELOCITY}
    free = estimate_parameters(case.run(**near), case.data(2), MOTION)["gm"]
    stated = 0.5 * float(free.systematic.std[0])
    tolerances = {"terms": {"cogging": {"pitch": stated}}}
    held = estimate_parameters(case.run(**near, tolerances=tolerances), case.data(2), MOTION)["gm"]
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
    run = case.run(estimate=section, tolerances={"base_joints": "0.1 mm"})
    found = estimate_parameters(run, case.data(4), MOTION)
    plain = estimate_parameters(
        case.run(estimate={"estimators": ["gm", "ml"]}), case.data(4), MOTION
    )
    for name, one in found.estimates.items():
        assert len(one.systematic.deviations) == 2 + 18
        values, std = case.constants(one)
        others, _ = case.constants(plain[name])
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
    run = case.run(estimate={"estimators": ["gm", "ml"]})
    result = estimate_parameters(run, case.data(5), MOTION)
    diagnosis = diagnose(result.robot, result.experiments, result.priors, result.best)
    record = estimation_result(result, diagnosis)
    record.write(tmp_path)
    again = EstimationResult.read(tmp_path)
    assert again.constants == record.constants
    rows = {(name, row.constant): row for name, own in again.constants.items() for row in own}
    assert len(rows) == 4
    row = rows["ml", "cogging.pitch"]
    assert (row.unit, row.stated) == ("m", pytest.approx(1.02 * PITCH))
    assert np.isnan(row.tolerance)
    values, std = case.constants(result["ml"])
    assert (row.value, row.std) == (pytest.approx(values[0]), pytest.approx(std[0]))
    kept = json.loads((tmp_path / "estimate.json").read_text())["estimators"]["ml"]
    assert [one["constant"] for one in kept["constants"]] == ["cogging.pitch", "stribeck.velocity"]
    assert not again.budget  # nothing has a tolerance
    # The robot that was found: value and what is left of it, still to be estimated.
    robot = load_robot(tmp_path / "identified-robot.yaml")
    np.testing.assert_allclose(robot.description.constants, values)
    left = {one.name: one.tolerance for one in toleranced_deviations(robot)}
    np.testing.assert_allclose([left["cogging_pitch"], left["stribeck_velocity"]], std)
    assert len(estimated_constants(robot)) == 2
    own = estimated_machine(robot, read_estimate(tmp_path, robot).estimate.systematic).robot
    np.testing.assert_allclose(own.description.constants, values)
    saved = read_estimate(tmp_path, robot_from(run.robot)).estimate
    np.testing.assert_allclose(saved.systematic.values, result["ml"].systematic.values)
    np.testing.assert_allclose(saved.covariance_random, result["ml"].covariance_random)


def test_the_bound_counts_them():
    """No less than the covariance of maximum likelihood, which has them among its unknowns."""
    gm, ml = (
        estimate_parameters(case.run(estimate={"estimators": [n]}), case.data(7), MOTION)
        for n in ("gm", "ml")
    )
    np.testing.assert_allclose(np.sqrt(np.diag(gm.bound)), ml["ml"].std, rtol=0.02)


def test_residuals_are_those_of_the_machine_that_was_found():
    result = estimate_parameters(case.run(), case.data(6), MOTION)
    values, _ = case.constants(result["gm"])
    np.testing.assert_allclose(result.robot.description.constants, values)
    diagnosis = diagnose(result.robot, result.experiments, result.priors, result.best)
    failed = {finding.assumption for finding in diagnosis.verdict.failed}
    assert not {"no position-periodic force", "the model explains the forces"} & failed


def test_constants_that_the_data_do_not_tell():
    terms = [*DEFAULT, "force_offset", {"cable": {"rest_length": case.guess(0.6)}}]
    given = {"name": "n", "robot": case.palida() | {"terms": terms}, "estimate": {"harmonics": 2}}
    springy = case.palida()["parameters"] | {f"k{j}": 100.0 for j in range(1, 7)}
    machine = given | {"robot": given["robot"] | {"parameters": springy}}
    data = measured(MOTION, robot=robot_from(load_run(machine).robot), step=STEP)
    with pytest.raises(UnidentifiableError, match="estimate: false") as caught:
        estimate_parameters(load_run(given), data, MOTION)
    assert "cable_rest_length" in caught.value.names


def test_pointwise_kinematics_are_refused():
    with pytest.raises(InputError, match=r"cogging\.pitch, stribeck\.velocity") as caught:
        case.run(estimate={"differentiation": "central"})
    assert caught.value.problems[0].key == "estimate.differentiation"


# Small, so that what is expected of the sign of friction is the sign.
UNEQUAL = {"force_std": [*["0.03 N"] * 4, *["0.4 N"] * 2], "length_std": ["3 um"] * 6}
EQUAL = {"force_std": ["0.04 N"] * 6, "length_std": ["10 um"] * 6}


@pytest.mark.parametrize(
    ("estimator", "noise", "memory", "tolerance"),
    [
        ("ls", UNEQUAL, 0.0, None),
        ("ls", UNEQUAL, 0.0, 2e-7),
        ("gm", EQUAL, 0.0, None),
        ("gm", EQUAL, 0.8, 2e-7),
        ("ml", UNEQUAL, 0.0, 2e-7),
        ("ml", EQUAL, 0.8, None),
    ],
)
def test_the_joint_covariance_is_that_of_all_noise(estimator, noise, memory, tolerance):
    """Of parameters and constants: what weights, lengths, colour and priors make of it."""
    sections = {"estimate": {"estimators": [estimator], "spectrum": "white"}, "noise": noise}
    if memory:
        sections["noise"] = noise | {"force_spectrum": {"ar": memory}}
    if tolerance is not None:
        sections["tolerances"] = {"terms": {"cogging": {"pitch": tolerance}}}
    near = case.guess(PITCH), case.guess(VELOCITY)
    result = estimate_parameters(case.run(*near, **sections), case.data(scale=0.0), MOTION)
    random, systematic, naive = _dense(result.experiments[0], estimator, memory, tolerance)
    # Noise that remembers counts line by line, as if the recording were endless.
    found, off = result[estimator], 0.06 if memory else 1e-3
    for share, expected in ((found.joint_random, random), (found.joint, random + systematic)):
        std = np.sqrt(np.diag(expected))
        np.testing.assert_array_less(np.abs(share - expected) / np.multiply.outer(std, std), off)
    std = np.sqrt(np.diag(random + systematic)[-2:])
    np.testing.assert_allclose(found.systematic.std, std, rtol=off)
    if estimator != "ml" or memory:
        assert np.any(np.abs(np.sqrt(np.diag(naive)[-2:]) / std - 1) > 0.05)


def _dense(experiment, estimator, memory, tolerance):
    """Return random and systematic share, and F⁻¹, by difference quotients, all samples at once."""
    motion, robot, true = experiment.joint.motion, case.machine(), np.array([PITCH, VELOCITY])
    times, periods = experiment.recording.forces.times, experiment.recording.forces.counts[0]
    count, p = len(times), robot.parameters

    def regressor(motion, constants):
        moved = replace(robot.description, constants=tuple(constants))
        states = np.split(motion.at(times).state(), 3, axis=1)
        return replace(robot, description=moved).regressor(*states).reshape(6 * count, -1)

    def lengths(step):
        return robot.inverse_kinematics(motion.add_step(step).at(times).state()[:, :6]).ravel()

    def slope(function, count, size):
        steps = size * np.eye(count)
        return np.transpose([(function(s) - function(-s)) / (2 * size) for s in steps])

    by_constants = slope(lambda s: regressor(motion, true * (1 + s)) @ p, 2, 1e-6) / true
    by_motion = slope(lambda s: regressor(motion.add_step(s), true) @ p, motion.unknowns, 1e-8)
    of_lengths = slope(lengths, motion.unknowns, 1e-8)
    columns = np.concatenate([regressor(motion, true), by_constants], axis=1)
    scales = np.linalg.norm(columns, axis=0)
    columns, prior = columns / scales, np.zeros(len(scales))
    prior[len(p)] = 0.0 if tolerance is None else (tolerance * scales[len(p)]) ** -2

    noise = experiment.noise
    forces, for_lengths = noise.forces.covariance, noise.lengths.covariance
    weighting = np.eye(6) * np.trace(forces) / 6 if estimator == "ls" else forces
    # The mean over periods of noise that remembers: every sample with all of the others.
    apart = np.subtract.outer(np.arange(count), np.arange(count))
    between = np.subtract.outer(np.arange(periods), np.arange(periods)).ravel()
    along = sum(memory ** np.abs(apart + count * k) for k in between) / periods
    each = np.eye(count) / periods
    of_motion = of_lengths.T @ np.linalg.solve(np.kron(each, for_lengths), of_lengths)
    through_motion = by_motion @ np.linalg.solve(of_motion, by_motion.T)
    # To eliminate the motion is to take the lengths' noise for that of the forces.
    seen = np.kron(each, weighting) + (through_motion if estimator == "ml" else 0.0)
    weighted = np.linalg.solve(seen, columns)
    noisy = np.kron(along, forces) / periods + through_motion
    inverse = np.linalg.inv(columns.T @ weighted + np.diag(prior))
    random = inverse @ weighted.T @ noisy @ weighted @ inverse
    found = random, inverse @ np.diag(prior) @ inverse, inverse
    return [each / np.multiply.outer(scales, scales) for each in found]


def test_a_selection_begins_where_data_and_tolerance_of_a_constant_agree():
    """Its tolerance still speaks for the stated value, not for the one that was found."""
    tolerances = {"terms": {"cogging": {"pitch": 1e-5}}}
    robot = case.palida() | {"terms": case.terms(case.PITCH_BEGUN, case.VELOCITY)}
    section = {"noise": "given", "harmonics": 2, "estimators": ["gm"]}
    config = {"name": "n", "robot": robot | {"tolerances": tolerances}, "noise": case.noise()}
    found = estimate_parameters(config | {"estimate": section}, case.data(1), MOTION)
    gm = found["gm"]
    known = gm.systematic.estimates
    begun = Evidence.of(found.robot, found.experiments, found.priors, gm.values, {}, known).total
    assert abs(known["cogging_pitch"]) > 10 * 1e-5
    assert np.max(np.abs(begun.gradient) / np.sqrt(np.diag(begun.matrix))) < 0.5
