"""Attitudes near which the angles of the pose are singular: not at home, and in no motion."""

import math

import numpy as np
import pytest

from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.limits import defaults_in_words, held_in_words, open_rows
from expdesign.library import robot_files
from expdesign.robot import robot_from

KEY = "attitude"
FREE = {"characteristic_length": 0.1, "rotation": "none"}


@pytest.fixture
def of(robot_mapping):
    """Load PaLiDA with other limits, and θ of home in degrees."""

    def load(limits=None, theta=0.0, of_the_run=None, **keys):
        home = [0, 0, -0.654, 0, f"{theta} deg", 0]
        robot = robot_mapping | {"home": home, "limits": limits or FREE}
        return load_run({"name": "n", "robot": robot, "limits": of_the_run or {}, **keys})

    return load


@pytest.fixture
def refused(of):
    """Return the problems of a robot, loaded and built."""

    def problems(*args, **keys):
        with pytest.raises(InputError) as caught:
            robot_from(of(*args, **keys).robot)
        return {problem.key: problem for problem in caught.value.problems}

    return problems


def bounds(configuration):
    """Return the bounds on θ, deg; None where the limit has no rows of its own."""
    limit = configuration.robot.limits.get(KEY)
    if limit is None:
        return None
    return np.degrees([limit.lower[0], limit.upper[0]]).round(9).tolist()


# --- home -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("theta", [90, -90, 86, -89.9999, 94, 270, 450])
def test_a_home_that_is_singular_or_nearly_so_is_refused(refused, theta):
    problem = refused(theta=theta)["robot.home"]
    assert "85 deg" in problem.allowed
    assert "base frame" in problem.message


@pytest.mark.parametrize("theta", [82, -84, 98])
def test_a_home_beyond_the_default_bound_is_refused_unless_it_is_wider(refused, of, theta):
    problem = refused(theta=theta)[f"limits.{KEY}"]
    assert "base frame" in problem.message
    assert "80 deg" in problem.allowed
    assert f"limits.{KEY}: 85 deg" in problem.message, (
        "how far it may be widened, and with which key"
    )
    robot_from(of(FREE | {KEY: "85 deg"}, theta).robot)


@pytest.mark.parametrize("theta", [0, 45, 79, -79, 101, 170, 185, -190])
def test_other_homes_are_not(of, theta):
    robot_from(of(theta=theta).robot)


def test_a_turned_base_frame_is_the_remedy(of, robot_mapping):
    """The machine of θ = 90°, described in a frame whose z axis is along the platform's."""
    turn = np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]])  # about y, by 90°
    robot = robot_mapping | {"limits": FREE}
    position = np.array([0, 0, -0.654])
    for key in ("base_joints", "alpha_axes"):
        robot[key] = (np.array(robot[key]) @ turn.T).tolist()
    robot["gravity"] = (turn @ np.array(robot["gravity"])).tolist()
    singular = robot | {"home": [*(turn @ position).tolist(), 0, "90 deg", 0]}
    with pytest.raises(InputError) as caught:
        load_run({"name": "n", "robot": singular})
    assert [problem.key for problem in caught.value.problems] == ["robot.home"]
    back = singular | {"home": [*position.tolist(), 0, 0, 0]}
    for key in ("base_joints", "alpha_axes"):
        back[key] = (np.array(singular[key]) @ turn).tolist()
    back["gravity"] = (turn.T @ np.array(singular["gravity"])).tolist()
    found = robot_from(load_run({"name": "n", "robot": back}).robot)
    assert found.inverse_kinematics(found.home) == pytest.approx([0.676162] * 6, abs=1e-6)


def test_a_singular_pose_of_the_struts_is_refused_as_before(robot_mapping, the_problem):
    """Joints that are equally spaced on two circles, θ = 0: no matter of the angles."""
    around = np.radians(60 * np.arange(6))
    circle = np.stack([np.cos(around), np.sin(around), 0 * around], axis=1)
    robot_mapping["base_joints"] = (0.4 * circle).tolist()
    robot_mapping["platform_joints"] = (0.2 * circle).tolist()
    robot_mapping["limits"] = FREE
    problem = the_problem({"name": "n", "robot": robot_mapping})
    assert problem.key == "robot.home"
    assert "condition number" in problem.message


# --- the limit ------------------------------------------------------------------------------------


def test_robots_that_ship_have_tighter_limits():
    assert robot_files()
    for name in robot_files():
        robot = load_run({"name": "n", "robot": name}).robot
        assert KEY not in robot.limits
        (said,) = held_in_words(robot.limits)
        assert "limits.tilt" in said or "limits.rotation" in said


@pytest.mark.parametrize(
    ("limits", "found"),
    [
        ({}, [-80, 80]),
        ({"tilt": "80 deg"}, None),
        ({"tilt": "81 deg"}, [-80, 80]),
        ({"rotation": {"theta": ["-80 deg", "10 deg"]}}, None),
        ({"rotation": {"theta": ["-81 deg", "10 deg"]}}, [-80, 80]),
        ({"rotation": {"theta": ["-20 deg", "200 deg"]}}, [-80, 80]),
        ({"rotation": {"phi": ["-20 deg", "20 deg"], "theta": "none"}}, [-80, 80]),
        ({KEY: "70 deg"}, [-70, 70]),
        ({KEY: ["-20 deg", "85 deg"]}, [-20, 85]),
        # What is given has rows, whatever else is.
        ({KEY: "70 deg", "tilt": "20 deg"}, [-70, 70]),
    ],
)
def test_it_stands_unless_another_limit_is_tighter(of, tmp_path, limits, found):
    made = of(FREE | limits)
    assert bounds(made) == found
    assert (held_in_words(made.robot.limits) != ()) == (found is None)
    file = tmp_path / "run.yaml"
    file.write_text(resolved_yaml(made), encoding="utf-8")
    again = load_run(file)
    assert bounds(again) == found
    assert again.run == made.run


def test_the_default_of_rotations_holds_it_about_a_home_that_is_level(of):
    assert bounds(of({"characteristic_length": 0.1})) is None
    assert bounds(of({"characteristic_length": 0.1}, theta=170)) is None
    # 30° on from 60° is where the angles are singular.
    assert bounds(of({"characteristic_length": 0.1}, theta=60)) == [-80, 80]


@pytest.mark.parametrize("bound", ["none", "86 deg", ["-86 deg", "10 deg"], -0.1, 0, "1 m"])
def test_it_is_neither_lifted_nor_too_wide(refused, bound):
    assert f"robot.limits.{KEY}" in refused(FREE | {KEY: bound})
    assert f"limits.{KEY}" in refused(of_the_run={KEY: bound})


def test_it_is_no_limit_that_is_left_open(of):
    made = of()
    assert KEY not in {one.definition.key for one in open_rows(made.robot.limits, ())}
    (said,) = defaults_in_words(made.robot.limits)
    assert f"limits.{KEY}" in said


def test_the_jacobian_of_the_angles_stays_well_conditioned_within_it(of):
    """What the bound is for: 1/cos θ, by which the angles turn faster than the platform."""
    assert 1 / math.cos(math.radians(bounds(of())[1])) < 6
