"""Estimates beside the nearest that some bodies have: test, spread, files, the identified robot."""

import sys

import numpy as np
import pytest

from estimation.estimators import ParameterPriors
from estimation.identification import estimate_parameters, estimation_result
from estimation.identification.result import EstimationResult
from estimation.uncertainty.consistency import (
    DRAWS,
    consistency_text,
    consistent_estimate,
    least_favourable,
    monte_carlo_p,
)
from expdesign.configuration import load_run
from expdesign.configuration.estimate import EstimateSection
from expdesign.configuration.tolerances import IDENTIFIED_ROBOT as FILE
from expdesign.mechanism.nearest import Projection
from expdesign.robot import load_robot
from tests.estimation.cases import ROBOT, made_up, measured, run, trajectory

MOTION = trajectory(100, 0.01)
NAMES = ROBOT.parameter_names
STD = 0.02 * ROBOT.scales


@pytest.fixture(scope="module", autouse=True)
def consistency_draws():
    """Draw as many as an estimate does: these tests are about them."""


def truth(**changes):
    """Return PaLiDA's parameters with struts that have some thickness."""
    named = dict(zip(NAMES, ROBOT.parameters.tolist(), strict=True))
    named |= {"p1": 0.3, "p2": 0.9, "p3": 1.0} | changes
    return np.array([named[name] for name in NAMES])


def beside(values, section=None, std=STD):
    return consistent_estimate(
        ROBOT, made_up(values, std), ParameterPriors.of(ROBOT, section or EstimateSection())
    )


def test_an_estimate_that_bodies_have_stays():
    found = beside(truth())
    np.testing.assert_array_equal(found.vector, truth())
    np.testing.assert_array_equal(found.spread, STD)
    assert (found.distance, found.p, found.active) == (0, 1, ())
    assert found.realisable
    assert not found.significant


def test_one_condition_is_what_half_a_chi_square_says():
    """Friction alone is negative: it becomes zero, and p is that of one side of the bell."""
    k = NAMES.index("r2")
    for sigmas, expected in ((0.5, 0.309), (1.5, 0.067), (4.0, 0.0)):
        values = truth(p5=-0.5, p9=0.5)  # light sliders, and a platform that is not flat
        values[k] = -sigmas * STD[k]
        found = beside(values)
        assert found.distance == pytest.approx(sigmas, rel=1e-4)
        assert found.p == pytest.approx(expected, abs=0.1)
        assert found.significant == (sigmas == 4)
        assert found.active == ("r2",)
        assert found.vector[k] == pytest.approx(0, abs=1e-6 * STD[k])
        assert found.low[k] == 0
        # Half of the errors are taken away, in other parameters nothing.
        assert found.spread[k] / STD[k] == pytest.approx(np.sqrt(0.5), rel=0.2)
        others = np.delete(found.spread / STD, k)
        np.testing.assert_allclose(others, 1, atol=0.25)
        np.testing.assert_allclose(np.delete(found.vector - values, k), 0, atol=1e-6)


def test_the_test_begins_where_noise_goes_farthest():
    """Draw by draw, so that p is never too small by where it begins."""
    among = ROBOT.realisable
    projection = Projection.by(np.diag(STD**2), among, np.full(len(NAMES), True))
    rng = np.random.default_rng(0)
    # Within 3 σ of its limits: width and breadth of the struts, and two of friction.
    near = truth(p1=0.03, p2=0.94, p3=0.96, r2=0.04, r_beta=0.01)
    null = least_favourable(projection, near)
    assert among.bodies(near) is not None
    assert among.bodies(null, 1e-9) is not None
    place = {name: k for k, name in enumerate(NAMES)}
    assert null[place["p2"]] == pytest.approx(null[place["p3"]], abs=1e-6)
    assert null[place["r2"]] == pytest.approx(0, abs=1e-6)
    assert null[place["r1"]] == pytest.approx(near[place["r1"]])
    farther = 0
    for _ in range(30):
        move = projection.factor @ rng.standard_normal(len(NAMES))
        here, there = (projection.of(start + move).distance for start in (near, null))
        assert there >= here - 1e-5
        farther += there > here + 0.01
    assert farther > 5


def test_bounds_and_fixed_values_of_the_run_are_kept():
    values = truth(p2=1.05)
    section = EstimateSection(fixed={"p10": 12.0}, bounds={"p3": [0.8, 1.01], "p1": [0.2, 1.0]})
    values[NAMES.index("p10")] = 12.0
    std = np.where(np.array(NAMES) == "p10", 0.0, STD)
    found = beside(values, section, std)
    named = found.values
    assert named["p10"] == 12
    assert named["p3"] <= 1.01
    assert named["p2"] <= named["p3"]
    assert np.isnan(found.spread[NAMES.index("p10")])
    # No bodies have a negative mass.
    values[NAMES.index("p10")] = -12.0
    assert beside(values, replace_fixed(section, -12.0), std) is None


def test_a_fixed_value_at_its_limit_leaves_bodies():
    """Rounding of the search moves a held value: that is no contradiction."""
    config = run({"estimators": ["gm"], "harmonics": 2, "noise": "given", "fixed": {"p1": None}})
    data = measured(MOTION, 1, step=0.01)
    found = estimate_parameters(config, data, MOTION).consistent["gm"]
    assert found.values["p1"] == ROBOT.parameters[NAMES.index("p1")]
    assert set(found.bodies) == {"ring", "stator", "slider", "platform"}


def replace_fixed(section, mass):
    return section.model_copy(update={"fixed": {"p10": mass}})


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A result whose identified robot shall be one that bodies have, and its folder."""
    section = {"harmonics": 2, "estimators": ["gm"], "consistent": True}
    data = measured(MOTION, 3, step=0.01)
    result = estimate_parameters(run(section), data, MOTION)
    folder = tmp_path_factory.mktemp("consistent")
    estimation_result(result).write(folder)
    return result, folder


def test_the_identified_robot_is_one_that_bodies_have(written):
    result, folder = written
    near = result.consistent["gm"]
    assert not near.realisable  # PaLiDA's table is not, and nor is this estimate
    robot = load_robot(folder / FILE)
    np.testing.assert_array_equal(robot.parameters, near.vector)
    assert not [text for text in robot.description.warnings if "inconsistent" in text]
    assert robot.realisable.bodies(robot.parameters) is not None


def test_as_a_prior_it_is_the_estimate_itself(written):
    result, folder = written
    after = load_run(
        {"name": "n", "robot": str(folder / FILE), "estimate": {"prior_from": "robot"}}
    )
    robot = load_robot(folder / FILE)
    knowledge = ParameterPriors.of(robot, after.run.estimate)
    np.testing.assert_array_equal(knowledge.prior_mean, result["gm"].values)


def test_the_folder_has_both_side_by_side(written):
    result, folder = written
    record = EstimationResult.read(folder)
    near = result.consistent["gm"]
    keys = record.best_estimator.consistent
    assert keys.distance == near.distance
    assert keys.text
    for k, row in enumerate(record.consistent["gm"]):
        assert (row.estimate, row.consistent) == (result["gm"].values[k], near.vector[k])
        assert row.moved == pytest.approx((row.consistent - row.estimate) / row.std)
    # What stands in the file is enough to see that they are bodies.
    for body in keys.bodies.values():
        inertia = np.array(body.inertia)
        second = np.trace(inertia) / 2 * np.eye(3) - inertia
        moment = np.array(body.moment)
        whole = np.block([[second, moment[:, None]], [moment, np.array(body.mass)]])
        assert np.linalg.eigvalsh(whole)[0] >= -1e-12 * np.trace(whole)


def test_what_is_fixed_to_what_no_bodies_have_is_told():
    section = {"harmonics": 2, "estimators": ["gm"], "fixed": {"p10": -3.0}}
    result = estimate_parameters(run(section), measured(MOTION, 1, step=0.01), MOTION)
    assert result.consistent["gm"] is None
    assert any("no physically consistent parameters" in warning for warning in result.warnings)
    record = estimation_result(result)
    assert record.best_estimator.consistent is None
    assert not record.consistent


def test_fixed_and_bounds_are_blamed_only_where_they_are_set(monkeypatch):
    module = sys.modules[estimate_parameters.__module__]
    monkeypatch.setattr(module, "consistent_estimate", lambda *_: None)
    data = measured(MOTION, 1, step=0.01)
    for given, blamed in (
        ({}, set()),
        ({"fixed": {"p10": 12.0}}, {"estimate.fixed"}),
        ({"bounds": {"p10": [0, 30]}}, {"estimate.bounds"}),
    ):
        result = estimate_parameters(
            run({"harmonics": 2, "estimators": ["gm"], **given}), data, MOTION
        )
        (told,) = [
            each for each in result.warnings if each.startswith("gm: ") and "consistent" in each
        ]
        assert {key for key in ("estimate.fixed", "estimate.bounds") if key in told} == blamed


def test_a_sharp_estimate_of_a_machine_that_no_bodies_are_is_told_so():
    """The twin of PaLiDA as it ships: its p2 is 0.004 kg m² above p3."""
    found = beside(ROBOT.parameters, EstimateSection(), 1e-3 * ROBOT.scales)
    assert found.significant
    told = consistency_text(found, known=ROBOT.realisable.bodies(ROBOT.parameters) is not None)
    assert told.startswith("not physically consistent")
    assert "robot file" in told
    assert "robot file" not in consistency_text(found, known=True)


# --- p-value from draws ---------------------------------------------------------------------------


def test_a_p_value_from_draws_is_smallest_if_none_is_as_far():
    assert monte_carlo_p(iter([False] * DRAWS + [True] * 9)) == pytest.approx(1 / (DRAWS + 1))
    assert monte_carlo_p(iter([True, False, False])) == pytest.approx(2 / 4)


@pytest.mark.parametrize("share", [0.005, 0.05, 0.5])
def test_a_p_value_from_draws_is_that_of_the_distance(share):
    """A distance that a share of the draws exceeds has this p, within the error of a sample."""
    rng = np.random.default_rng(3)
    found = [monte_carlo_p(iter(rng.uniform(size=DRAWS * 10) < share)) for _ in range(200)]
    assert np.mean(found) == pytest.approx(share, rel=0.15)
