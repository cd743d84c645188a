"""A payload on an identified machine: against the joint problem, Monte Carlo and the twin."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from estimation.estimators.covariance import EstimatedDeviation, SystematicUncertainty
from estimation.estimators.prior_estimate import UnloadedMachine
from estimation.estimators.result import TEN, payload_estimate
from estimation.identification import estimate_parameters, estimation_result
from estimation.identification.result import EstimationResult
from estimation.twin import Twin
from expdesign.configuration import load_run
from expdesign.configuration.bodies import BodyDescription, payload_parameters
from expdesign.configuration.robot import as_general
from expdesign.mechanism.bodies import about_centre, inertia_of
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from expdesign.robot import load_robot
from expdesign.robot.deviation import deviations
from tests.estimation.cases import made_up, trajectory

ROBOT = load_robot("palida")
M = 29
NAMES = (*ROBOT.parameter_names[:10], "sx", "sy", "Ixy", "Ixz", "Iyz")
PLACES = np.array([NAMES.index(name) for name in OF_A_BODY.values()])
OTHERS = np.setdiff1d(np.arange(M), PLACES)
BODY = {
    "mass": 5,
    "centre": [0.02, -0.01, 0.06],
    "inertia": [0.02, 0.03, 0.025, 0.002, -0.001, 0.003],
}
TRUE = payload_parameters([BodyDescription.model_validate(BODY)])


# --- the linear problem ---------------------------------------------------------------------------


class Linear:
    """Forces that are linear in 29 parameters, with a prior and deviations of the machine."""

    def __init__(self, seed=0):
        rng = np.random.default_rng(seed)
        self.rng = rng
        self.regressor = rng.normal(size=(120, M))
        spread = rng.normal(size=(M, 2 * M)) * rng.uniform(0.02, 0.2, M)[:, None]
        self.covariance = spread @ spread.T
        self.p = rng.normal(size=M)
        self.payload = rng.normal(size=10)
        # Two deviations: the first shared by both recordings, the second of the earlier alone.
        self.forces_by = rng.normal(size=(120, 1)) * 0.3
        self.before_by = rng.normal(size=(M, 2)) * 0.2
        self.deviations = tuple(replace(one, tolerance=1.0) for one in deviations(ROBOT)[:2])

    def solved(self, forces, before):
        """Return the estimate of p' with the prior of what is no platform, and the payload."""
        kept = np.zeros_like(self.covariance)
        block = np.ix_(OTHERS, OTHERS)
        kept[block] = np.linalg.inv(self.covariance[block])
        inverse = np.linalg.inv(self.regressor.T @ self.regressor + kept)
        values = inverse @ (self.regressor.T @ forces + kept @ before)
        response = inverse @ self.regressor.T @ self.forces_by
        inherited = inverse @ kept @ self.before_by
        whole = np.column_stack([response[:, 0] + inherited[:, 0], inherited[:, 1]])
        systematic = SystematicUncertainty(
            estimated=False,
            deviations=tuple(map(EstimatedDeviation.of, self.deviations)),
            response=whole,
        )
        earlier = UnloadedMachine(
            before, kept, self.deviations, self.before_by, self.covariance, PLACES
        )
        found = made_up(values, inverse).with_systematic(systematic)
        return found, payload_estimate(found, earlier)

    def joint(self):
        """Return columns and prior of (π, p), p the machine without its payload."""
        both = np.concatenate([self.regressor[:, PLACES], self.regressor], axis=1)
        prior = np.zeros((10 + M, 10 + M))
        prior[10:, 10:] = np.linalg.inv(self.covariance)
        return both, prior


@pytest.mark.parametrize("seed", range(3))
def test_it_is_the_estimate_of_the_joint_problem(seed):
    case = Linear(seed)
    forces = case.rng.normal(size=120)
    before = case.rng.normal(size=M)
    _, found = case.solved(forces, before)
    both, prior = case.joint()
    inverse = np.linalg.inv(both.T @ both + prior)
    expected = inverse @ (both.T @ forces + prior @ np.concatenate([np.zeros(10), before]))
    np.testing.assert_allclose(found.vector, expected[:10], atol=1e-9)
    random = found.covariance - found.covariance_systematic
    np.testing.assert_allclose(random, inverse[:10, :10], atol=1e-9)


def test_what_both_recordings_share_is_counted_as_a_difference():
    case = Linear()
    _, found = case.solved(np.zeros(120), case.p)
    moved = []
    for theta in np.eye(2):
        values = case.forces_by[:, 0] * theta[0], case.p + case.before_by @ theta
        moved.append(case.solved(*values)[1].vector - found.vector)
    expected = np.transpose(moved) @ np.array(moved)
    np.testing.assert_allclose(found.covariance_systematic, expected, atol=1e-9)


def test_constants_estimated_with_the_parameters_count_like_these():
    """The same problem, the last two of its unknowns called constants of terms."""
    case, own = Linear(2), M - 2
    before = case.rng.normal(size=M)
    before[own:] = 0.0  # from where the robot file has them
    found, expected = case.solved(case.rng.normal(size=120), before)
    kept = np.zeros_like(case.covariance)
    kept[np.ix_(OTHERS, OTHERS)] = np.linalg.inv(case.covariance[np.ix_(OTHERS, OTHERS)])
    constants = tuple(replace(one, tolerance=np.inf) for one in deviations(ROBOT)[2:4])
    moved = np.pad(found.systematic.response, ((0, 0), (2, 0)))
    left = -np.eye(4)
    left[:2] = moved[own:]
    pairs = zip(constants, found.values[own:].tolist(), strict=True)
    entries = *(EstimatedDeviation.of(*pair) for pair in pairs), *found.systematic.deviations
    systematic = SystematicUncertainty(
        estimated=True, deviations=entries, response=moved[:own], left=left
    )
    parted = replace(
        found,
        values=found.values[:own],
        covariance=found.covariance[:own, :own],
        covariance_joint=found.covariance_random,
        systematic=systematic,
    )
    earlier = UnloadedMachine(
        before, kept, case.deviations, case.before_by, case.covariance, PLACES
    )
    payload = payload_estimate(parted, earlier)
    np.testing.assert_allclose(payload.vector, expected.vector, atol=1e-9)
    np.testing.assert_allclose(payload.covariance, expected.covariance, atol=1e-9)
    shares = payload.covariance_systematic, expected.covariance_systematic
    np.testing.assert_allclose(*shares, atol=1e-9)


def test_spread_over_many_machines_is_what_is_stated():
    """The prior's error, that of the tolerances and the noise are drawn anew in each."""
    case, count = Linear(4), 4000
    root = np.linalg.cholesky(case.covariance)
    true = case.p.copy()
    true[PLACES] += case.payload
    _, stated = case.solved(case.regressor @ true, case.p)
    theta = case.rng.normal(size=(count, 2))
    before = case.p + case.rng.normal(size=(count, M)) @ root.T + theta @ case.before_by.T
    forces = case.regressor @ true + case.rng.normal(size=(count, 120))
    forces += theta[:, :1] @ case.forces_by.T
    found = np.array([case.solved(*each)[1].vector for each in zip(forces, before, strict=True)])
    off = np.linalg.solve(np.linalg.cholesky(stated.covariance), (found - case.payload).T)
    # Ten independent normal numbers in each: mean within 4.5 and variance within 4.5 of theirs.
    assert np.max(np.abs(np.mean(off, axis=1))) < 4.5 / np.sqrt(count)
    assert np.mean(off**2) == pytest.approx(1, abs=4.5 * np.sqrt(2 / (10 * count)))
    ratio = np.std(found, axis=0) / np.sqrt(np.diag(stated.covariance))
    np.testing.assert_allclose(ratio, 1, atol=4.5 / np.sqrt(2 * count))


# --- centre and inertia about it ------------------------------------------------------------------


@given(st.integers(0, 10_000))
def test_centre_and_inertia_are_those_of_the_body(seed):
    rng = np.random.default_rng(seed)
    mass, centre = rng.uniform(0.5, 20), rng.normal(size=3)
    moments = rng.uniform(1, 1.5, 3).tolist() + rng.uniform(-0.2, 0.2, 3).tolist()
    body = BodyDescription.model_validate(
        {"mass": mass, "centre": centre.tolist(), "inertia": moments}
    )
    values = np.array([payload_parameters([body])[name] for name in OF_A_BODY.values()])
    derived, slope = about_centre(values)
    np.testing.assert_allclose(derived, [*centre, *moments], rtol=1e-9, atol=1e-9)
    step = 1e-6 * np.diag(1 + np.abs(values))
    differences = [(about_centre(values + h)[0] - about_centre(values - h)[0]) for h in step]
    expected = np.transpose(differences) / (2 * np.diag(step))
    np.testing.assert_allclose(slope, expected, rtol=1e-6, atol=1e-6)
    assert len(derived) + len(TEN) == 19
    assert inertia_of(derived[3:]).shape == (3, 3)


# --- on the twin ----------------------------------------------------------------------------------

MOTION = trajectory(200, 0.01)
SECTION = {"harmonics": 2, "estimators": ["ls", "gm"], "noise": "given"}
TOLERANCES = {"force_constant": {"common": "5 %"}}


def _run(name, estimate_section, **sections):
    general = as_general(ROBOT.description.description)
    return load_run(
        {
            "name": name,
            "robot": general.model_dump(),
            "experiment": {"periods": 10, "sampling": 100},
            "estimate": {**SECTION, **estimate_section},
            **sections,
        }
    )


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    """The run folder of an identification without payload, with forces that may be 5 % off."""
    folder = tmp_path_factory.mktemp("machine")
    run = _run("machine", {}, tolerances=TOLERANCES)
    estimation_result(estimate_parameters(run, Twin.of(run, MOTION).measurement(7), MOTION)).write(
        folder
    )
    return folder


@pytest.fixture(scope="module")
def loaded(machine):
    """An estimate with the payload, whose run knows it for the twin alone."""
    experiment = {"periods": 10, "sampling": 100, "payload": BODY}
    run = _run("loaded", {"prior": str(machine)}, experiment=experiment, tolerances=TOLERANCES)
    return estimate_parameters(run, Twin.of(run, MOTION).measurement(3), MOTION)


def test_the_payload_is_found(loaded):
    true = np.array([TRUE[name] for name in OF_A_BODY.values()])
    for found in loaded.payloads.values():
        random = found.covariance - found.covariance_systematic
        off = found.vector - true
        assert off @ np.linalg.solve(random, off) < 35  # chi square of 10: 1 in 10 000
        assert np.sqrt(random[0, 0]) < 0.05 * true[0]
    # The robot itself is what the machine is with its payload.
    assert loaded.robot.description.description.parameters["p10"] == pytest.approx(16.307)
    assert loaded.robot.description.parameters["p10"] == pytest.approx(21.307)


def test_forces_that_are_off_by_a_share_are_off_so_for_the_payload(loaded):
    """The same force constants in both recordings: 5 % of the payload, and not of the machine."""
    found = loaded.payloads["gm"]
    std = np.sqrt(found.covariance_systematic[0, 0])
    assert std == pytest.approx(0.05 * found.vector[0], rel=0.05)


def test_it_is_kept_and_read_again(loaded, tmp_path):
    estimation_result(loaded).write(tmp_path)
    rows = EstimationResult.read(tmp_path).payload
    assert [row.quantity for row in rows["gm"][:10]] == list(TEN)
    found = {row.quantity: row for row in rows["gm"]}
    best = loaded.payloads["gm"]
    assert found["mass"].value == best.vector[0]
    assert found["mass"].std == pytest.approx(np.sqrt(best.covariance[0, 0]))
    centre = found["sx"].value / found["mass"].value
    slope = np.zeros(10)
    slope[:2] = [-centre / best.vector[0], 1 / best.vector[0]]
    assert found["cx"].value == pytest.approx(centre)
    assert found["cx"].std == pytest.approx(np.sqrt(slope @ best.covariance @ slope))
    assert (tmp_path / "tables" / "payload.csv").is_file()


def test_a_mass_that_may_be_none_has_no_centre(machine, tmp_path):
    run = _run("empty", {"prior": str(machine), "estimators": ["gm"]}, tolerances=TOLERANCES)
    found = estimate_parameters(run, Twin.of(run, MOTION).measurement(5), MOTION)
    rows = {row.quantity: row for row in estimation_result(found).payload["gm"]}
    assert abs(rows["mass"].value) < 4 * rows["mass"].std
    assert np.isnan(rows["cx"].value)


def test_an_estimate_without_a_machine_before_has_no_payload(tmp_path):
    run = _run("plain", {"estimators": ["gm"]})
    found = estimate_parameters(run, Twin.of(run, MOTION).measurement(1), MOTION)
    estimation_result(found).write(tmp_path)
    assert not found.payloads
    assert not (tmp_path / "tables" / "payload.csv").exists()
    assert not EstimationResult.read(tmp_path).payload
