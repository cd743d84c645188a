import json

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.configuration.quantity import SHARE
from expdesign.configuration.run import add_terms, resolved_yaml
from expdesign.robot import robot_from
from expdesign.robot.deviation import deviations, toleranced_deviations


def _tolerances(run):
    return load_run(run).robot.tolerances


def test_one_value_is_that_of_every_coordinate(run_mapping):
    run_mapping["robot"]["tolerances"] = {"base_joints": "0.3 mm", "platform_joints": [1e-4] * 6}
    found = _tolerances(run_mapping)
    np.testing.assert_allclose(found.base_joints, np.full((6, 3), 3e-4), rtol=1e-15)
    np.testing.assert_allclose(found.platform_joints, np.full((6, 3), 1e-4), rtol=1e-15)


def test_every_coordinate_may_have_its_own(run_mapping):
    rows = [[f"{j} mm", 0, "50 um"] for j in range(6)]
    run_mapping["robot"]["tolerances"] = {"base_joints": rows}
    expected = np.array([[1e-3 * j, 0, 5e-5] for j in range(6)])
    np.testing.assert_allclose(_tolerances(run_mapping).base_joints, expected, rtol=1e-15)


def test_shares_in_percent_and_parts_per_million(run_mapping):
    run_mapping["tolerances"] = {
        "force_constant": {"common": "2 %", "each": ["1%", 0.02, "300 ppm", 0, 0, 0]},
        "clock": "20 ppm",
    }
    found = _tolerances(run_mapping)
    assert found.force_constant.common == 0.02
    assert found.force_constant.each == (0.01, 0.02, 3e-4, 0, 0, 0)
    assert found.clock == 2e-5
    assert SHARE.parse(0.5) == SHARE.parse("0.5") == SHARE.parse("50 %")


def test_a_run_overrides_the_robot_key_by_key(run_mapping):
    run_mapping["robot"]["tolerances"] = {
        "delay": "1 ms",
        "gravity": "1 deg",
        "force_constant": {"common": 0.02, "each": 0.01},
    }
    run_mapping["tolerances"] = {"delay": "2 ms", "force_constant": {"each": 0}}
    found = _tolerances(run_mapping)
    assert found.delay == 2e-3
    assert found.gravity == pytest.approx(np.radians(1))
    assert found.force_constant.common == 0.02
    assert found.force_constant.each == (0,) * 6


def test_the_resolved_configuration_has_them(run_mapping):
    import yaml

    terms = {"load_friction": "1 %", "stribeck": {"std": 2, "velocity": 0.05}}
    run_mapping["tolerances"] = {"base_joints": "0.1 mm", "clock": "20 ppm", "terms": terms}
    configuration = load_run(run_mapping)
    again = load_run(yaml.safe_load(resolved_yaml(configuration)))
    assert again.robot.tolerances == configuration.robot.tolerances
    assert again.run.tolerances is None


def test_a_lacking_term_has_the_standard_deviation_of_its_parameters(run_mapping):
    run_mapping["robot"]["tolerances"] = {"terms": {"load_friction": "2 %"}}
    run_mapping["tolerances"] = {
        "terms": {
            "load_friction": {"mu2": 0.03},
            "drive_inertia": "20 g",
            "stribeck": {"std": "2 N", "velocity": "50 mm/s"},
            "platform_spring": 0,
        }
    }
    robot = robot_from(load_run(run_mapping).robot)
    found = {each.name: (each.group, each.tolerance) for each in toleranced_deviations(robot)}
    # In the order of the catalogue.
    assert list(found)[:2] == ["drive_inertia_m_drive", "stribeck_s1"]
    assert found["drive_inertia_m_drive"] == ("terms.drive_inertia", 0.02)
    assert found["stribeck_s6"] == ("terms.stribeck", 2.0)
    assert [found[f"load_friction_mu{j}"][1] for j in (1, 2, 6)] == [0.02, 0.03, 0.02]
    assert len(found) == 1 + 6 + 6
    assert robot.description.tolerances.terms["platform_spring"] == {"std": 0.0}
    assert list(robot.description.lacking_terms) == ["drive_inertia", "stribeck", "load_friction"]
    assert "load_friction" not in [term.name for term in robot.terms]
    assert robot.extended.description.constants == (*robot.description.constants, 0.05)


def test_none_given(run_mapping):
    configuration = load_run(run_mapping)
    assert configuration.robot.tolerances is None
    robot = robot_from(configuration.robot)
    assert toleranced_deviations(robot) == ()
    assert {each.tolerance for each in deviations(robot)} == {0.0}


def test_entries_have_the_standard_deviations_given(run_mapping):
    run_mapping["tolerances"] = {
        "platform_joints": [[0, 0, 0]] * 5 + [[0, 2e-3, 0]],
        "strut_length": [1e-4, 0, 0, 0, 0, 0],
        "force_constant": {"each": [0, 0, 0, 0, 0.01, 0]},
        "gravity": 0.01,
        "delay": 1e-3,
    }
    robot = robot_from(load_run(run_mapping).robot)
    assert {each.name: each.tolerance for each in toleranced_deviations(robot)} == {
        "platform_joint_6_y": 2e-3,
        "gravity_1": 0.01,
        "gravity_2": 0.01,
        "strut_length_1": 1e-4,
        "force_constant_5": 0.01,
        "delay": 1e-3,
    }
    assert len({each.name for each in deviations(robot)}) == len(deviations(robot))


def test_a_robots_tolerances_are_refused_in_its_file(tmp_path, run_mapping, the_problem):
    path = tmp_path / "robot.yaml"
    robot = run_mapping["robot"] | {"tolerances": {"base_joints": "2 m"}}
    path.write_text(json.dumps(robot), encoding="utf-8")
    # Also where the run states a better one.
    problem = the_problem({"name": "n", "robot": str(path), "tolerances": {"base_joints": 1e-4}})
    assert (problem.file, problem.key) == (path, "tolerances.base_joints")


@pytest.mark.parametrize(
    ("tolerances", "estimators", "problems"),
    [
        (None, ["ml"], 1),
        ({"delay": 0, "base_joints": 0}, ["ml"], 1),
        ({"delay": "1 ms"}, ["ls", "gm"], 1),
        (None, ["gm"], 2),
    ],
)
def test_estimating_what_is_exact_or_without_ml_is_refused(
    run_mapping, problems_of, tolerances, estimators, problems
):
    run_mapping["estimate"] = {"systematic": "estimated", "estimators": estimators}
    run_mapping["tolerances"] = tolerances
    found = problems_of(run_mapping)
    assert [problem.key for problem in found] == ["estimate.systematic"] * problems
    run_mapping["estimate"]["systematic"] = "budget"
    load_run(run_mapping)


def test_estimating_what_has_a_tolerance(run_mapping):
    run_mapping["estimate"] = {"systematic": "estimated", "estimators": ["gm", "ml"]}
    run_mapping["tolerances"] = {"delay": "1 ms"}
    assert load_run(run_mapping).run.estimate.systematic == "estimated"


def test_a_term_that_is_added_has_no_tolerance_any_more(run_mapping):
    run_mapping["tolerances"] = {"terms": {"load_friction": "1 %", "drive_inertia": "1 g"}}
    run_mapping["estimate"] = {"select": {"candidates": ["load_friction"]}}
    configuration = load_run(run_mapping)
    added = add_terms(configuration, configuration.run.estimate.select.candidates)
    assert list(added.robot.lacking_terms) == ["drive_inertia"]
    assert list(added.run.robot.tolerances.terms) == ["drive_inertia"]
