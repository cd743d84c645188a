"""Estimates that no machine can have are named first, and are not accepted."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from estimation.diagnostics.finding import FindingOutcome, Status
from estimation.diagnostics.plausibility import plausibility
from estimation.diagnostics.verdict import verdict
from estimation.estimators import ParameterPriors
from expdesign.configuration.estimate import EstimateSection
from expdesign.library import robot_files
from expdesign.mechanism.terms import DEFAULT
from expdesign.robot import Robot, load_robot
from tests.diagnostics.conftest import Laboratory
from tests.estimation.cases import made_up

LAB = Laboratory(samples=200, periods=4)


def found_in(data):
    estimate = LAB.estimate([LAB.experiment(data)])
    return plausibility(LAB.robot, LAB.knowledge, estimate)


def judged(robot, values, std, section=None):
    knowledge = ParameterPriors.of(robot, section or EstimateSection())
    return plausibility(robot, knowledge, made_up(values, std))


@pytest.mark.parametrize(
    ("constant", "causes"),
    [
        (1 / 85, ("`data.units: {Q: A}` with `data.force_constants` of about 8",)),
        (-1.0, ("the sign of all forces is wrong", "`data.sign: {Q: -1}`")),
        (1e3, ("`data.units: {Q: mN}`",)),
        (1 / 4.448, ("`data.units: {Q: lbf}`",)),
        (4.448, ("the forces are in newtons",)),
        (-1 / 85, ("the sign of all forces is wrong", "`data.units: {Q: A}`")),
    ],
)
def test_forces_in_another_unit_and_of_the_wrong_sign(constant, causes):
    data = LAB.measure(1)
    finding = found_in(replace(data, forces=constant * data.forces))
    assert finding.failed
    assert "p10" in finding.contradiction
    assert all(cause in finding.advice for cause in causes)
    # Whatever else holds: it keeps `accepted` away.
    judged_so = verdict([], finding)
    assert (judged_so.status, judged_so.causes) == (Status.DOUBTFUL, judged_so.findings)
    assert judged_so.findings == (replace(finding, first=True),)
    assert judged_so.summary == f"doubtful: {finding.contradiction}"


def test_a_clean_estimate_is_plausible():
    finding = found_in(LAB.measure(2))
    assert finding.outcome is FindingOutcome.HOLDS
    assert verdict([], finding).status is Status.ACCEPTED


@pytest.mark.parametrize("name", robot_files())
def test_clean_estimates_of_all_robots_that_ship_are_plausible(name):
    """As they scatter where every parameter is known to 30 %, and to half an order."""
    robot = load_robot(name)
    rng = np.random.default_rng(7)
    values, size = robot.parameters, robot.scales
    for std in (0.3 * size, 5 * size):
        for _ in range(20):
            drawn = values + std * np.clip(rng.standard_normal(len(values)), -2.9, 2.9)
            finding = judged(robot, drawn, std)
            assert not finding.failed, (name, finding.sentence)
    tripled = judged(robot, 3 * values, 0.01 * size)
    assert not (tripled.failed and tripled.serious)


@pytest.mark.parametrize("name", robot_files())
def test_a_common_factor_beyond_the_tolerance_of_the_forces(name):
    """A wrong force constant is named; without a stated tolerance it is no reason for doubt."""
    robot = load_robot(name)
    std = 0.02 * robot.scales
    tolerated = SimpleNamespace(deviations=[SimpleNamespace(group="force_constant.common")])
    scattered = 1 + 0.03 * np.random.default_rng(8).standard_normal(len(robot.parameters))
    for factor, failed in ((0.52, True), (1.9, True), (1.06, False)):
        values = factor * scattered * robot.parameters
        knowledge = ParameterPriors.of(robot, EstimateSection())
        for systematic in (None, tolerated):
            estimate = replace(made_up(values, std), systematic=systematic)
            finding = plausibility(robot, knowledge, estimate)
            assert finding.failed == failed
            assert not failed or finding.serious == (systematic is not None)
            assert not failed or f"(about {factor:.2g}"[:7] in finding.contradiction
    # Another platform alone is no factor of the forces.
    values = robot.parameters.copy()
    values[[robot.parameter_names.index(p) for p in ("p6", "p7", "p8", "p9", "p10")]] *= 1.9
    estimate = replace(made_up(values, std), systematic=tolerated)
    assert not plausibility(robot, knowledge, estimate).failed


@pytest.mark.parametrize("name", robot_files())
def test_what_no_machine_has(name):
    robot = load_robot(name)
    names, size = robot.parameter_names, robot.scales
    for parameter, factor in (("p10", -1), ("r3", -1), ("v2", -1), ("p10", 0.05), ("p10", 20)):
        values, k = robot.parameters.copy(), names.index(parameter)
        values[k] = factor * size[k]
        finding = judged(robot, values, 0.01 * size)
        assert finding.failed
        assert f"({parameter})" in finding.contradiction
        # One parameter alone speaks for no unit and no sign of all forces.
        assert "nearly all" not in finding.advice
    # Friction of any size may be there, and a fixed value is the user's.
    values = robot.parameters.copy()
    values[names.index("r3")] *= 30
    assert not judged(robot, values, 0.02 * size).failed
    values[names.index("p10")] *= -1
    fixed = EstimateSection(fixed={"p10": float(values[names.index("p10")])})
    assert not judged(robot, values, 0.02 * size, fixed).failed


def test_less_than_three_standard_deviations_are_no_doubt():
    robot = load_robot("palida")
    k = robot.parameter_names.index("r3")
    for sigmas, failed in ((2.9, False), (3.1, True)):
        values = robot.parameters.copy()
        std = 0.01 * robot.scales
        values[k] = -sigmas * std[k]
        assert judged(robot, values, std).failed == failed


def test_small_parameters_of_a_body_may_be_unknown():
    """A difference counts where it matters beside the robot's mass and length: p10 L²."""
    robot = load_robot("palida")
    k = robot.parameter_names.index("p1")
    whole = robot.description.parameters["p10"] * robot.characteristic_length**2
    for share, failed in ((0.08, False), (20.0, True)):
        values, std = robot.parameters.copy(), 0.001 * robot.scales
        values[k] += share * whole
        assert judged(robot, values, std).failed == failed


@pytest.mark.parametrize("name", robot_files())
def test_bodies_are_judged_together(name):
    """A mass farther from the origin than the inertia about it allows, each fine by itself."""
    robot = load_robot(name)
    names, values = robot.parameter_names, robot.parameters.copy()
    std = 1e-4 * robot.scales
    k, mass = names.index("p9"), values[names.index("p10")]
    about_x, about_y, about_z = (values[names.index(p)] for p in ("p6", "p7", "p8"))
    most = np.sqrt(mass * (about_x + about_y - about_z) / 2)
    for share, failed in ((0.99, False), (1.6, True)):
        values[k] = np.copysign(share * most, robot.parameters[k] or 1.0)
        finding = judged(robot, values, std)
        assert finding.failed == failed
    assert "(p6 … p10)" in finding.contradiction
    # With less known of it the noise may have made it.
    assert not judged(robot, values, 1e4 * std).failed


def test_sliders_that_weigh_more_than_all_that_moves():
    robot = load_robot("palida")
    names, values = robot.parameter_names, robot.parameters.copy()
    k = names.index("p5")
    inertia = (values[names.index("p2")] + values[names.index("p3")]) / 2
    most = np.sqrt(inertia * values[names.index("p10")] / 6)
    for share, failed in ((-0.99, False), (-1.3, True), (0.5, True)):
        values[k] = share * most
        finding = judged(robot, values, 0.005 * robot.scales)
        assert finding.failed == failed
        assert not failed or "p5" in finding.contradiction


def test_the_level_of_bodies_together():
    """Bodies at the bound, a point mass: p is below a level in no more draws than it states."""
    about = load_robot("palida").description
    mass, arm = about.parameters["p10"], 0.1
    point = {"p6": mass * arm**2, "p7": mass * arm**2, "p8": 1e-3 * mass * arm**2, "p9": mass * arm}
    # The a-priori values are those of a point mass, so that no parameter is doubted alone.
    robot = Robot(replace(about, parameters=about.parameters | point))
    rng, std = np.random.default_rng(3), 0.01 * robot.scales
    p = np.array(
        [
            judged(robot, robot.parameters + std * rng.standard_normal(len(std)), std).p
            for _ in range(300)
        ]
    )
    assert np.min(p) < 0.5
    for level in (0.001, 0.05, 0.3, 0.5):
        assert np.mean(p < level) <= level


@pytest.mark.parametrize(("wrong", "removed"), [("mu3", True), ("p10", False)])
def test_an_added_term_with_impossible_parameters_is_to_be_removed(wrong, removed, tmp_path):
    about = yaml.safe_load(robot_files()["palida"].read_text())
    file = tmp_path / "robot.yaml"
    file.write_text(yaml.safe_dump({**about, "terms": [*DEFAULT, "load_friction"]}))
    robot = load_robot(file)
    values = robot.parameters.copy()
    for name in {"mu3", wrong}:
        values[robot.parameter_names.index(name)] = -1.0
    finding = judged(robot, values, np.full(len(values), 1e-3))
    assert finding.failed
    assert wrong in finding.contradiction
    advice = "remove `load_friction` from the robot's `terms`"
    assert finding.advice.startswith(advice) is removed
