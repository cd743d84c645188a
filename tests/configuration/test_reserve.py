"""`limits.reserve`: which bounds motions are planned with, from robot and run."""

import math

import numpy as np
import pytest

from expdesign.configuration import InputError, load_run, resolved_yaml
from expdesign.configuration.limits import reserve_in_words
from expdesign.robot import robot_from
from expdesign.stages.execution import sections_text


def _run(reserve=None, robot=None, **limits):
    """Load PaLiDA with reserves of robot and run."""
    given = {} if reserve is None else {"reserve": reserve}
    source = "palida"
    if robot is not None:
        source = load_run({"name": "n", "robot": "palida"}).run.robot.model_dump(mode="json")
        source["limits"]["reserve"] = robot
    return load_run({"name": "n", "robot": source, "limits": given | limits})


def _shares(configuration):
    return {key: limit.reserve for key, limit in configuration.robot.limits.items()}


def test_bounds_are_drawn_in_by_the_share_of_their_range():
    limits = _run("3 %", strut_clearance="10 mm").robot.limits
    np.testing.assert_allclose(limits["strut_speed"].upper, 2 - 0.03 * 4)
    np.testing.assert_allclose(limits["strut_speed"].lower, -(2 - 0.03 * 4))
    np.testing.assert_allclose(limits["position"].lower, [-0.188, -0.188, -0.795])
    np.testing.assert_allclose(limits["position"].upper, [0.188, 0.188, -0.513])
    assert limits["tilt"].upper == pytest.approx(math.radians(20) * 0.97)
    assert np.isinf(limits["tilt"].lower)
    assert limits["jacobian_condition"].upper == pytest.approx(9.7)
    np.testing.assert_allclose(limits["strut_clearance"].lower, 0.0103)
    stated = _run().robot.limits
    for key, limit in limits.items():
        if key != "strut_clearance":
            for found, side in zip(
                limit.stated_bounds, (stated[key].lower, stated[key].upper), strict=True
            ):
                np.testing.assert_array_equal(found, side)


@pytest.mark.parametrize("nothing", [None, 0, "0 %", {}, {"tilt": 0}])
def test_without_a_reserve_nothing_changes(nothing):
    found, plain = _run(nothing), _run()
    assert found.run == plain.run
    assert resolved_yaml(found) == resolved_yaml(plain)
    assert "reserve" not in resolved_yaml(plain)
    for key, limit in found.robot.limits.items():
        np.testing.assert_array_equal(limit.lower, plain.robot.limits[key].lower)
        np.testing.assert_array_equal(limit.upper, plain.robot.limits[key].upper)
    whole = {"name": True, "robot": True}
    assert sections_text(found, whole) == sections_text(plain, whole)
    assert reserve_in_words(found.robot.limits) == ""


@pytest.mark.parametrize(
    ("robot", "run", "tilt", "speed"),
    [
        (None, 0.05, 0.05, 0.05),
        ("5 %", None, 0.05, 0.05),
        ("5 %", {"tilt": "8 %"}, 0.08, 0.05),
        ({"tilt": 0.1}, "2 %", 0.02, 0.02),
        ({"tilt": 0.1}, {"strut_speed": 0.01}, 0.1, 0.01),
        ("5 %", {"tilt": 0}, 0, 0.05),
        ("5 %", {}, 0.05, 0.05),
        (0.05, 0, 0, 0),
    ],
)
def test_that_of_the_run_overrides(robot, run, tilt, speed, tmp_path):
    found = _run(run, robot)
    shares = _shares(found)
    assert (shares["tilt"], shares["strut_speed"]) == (tilt, speed)
    # Resolved it is the same, and so are the bounds, to the last bit.
    file = tmp_path / "run.yaml"
    file.write_text(resolved_yaml(found), encoding="utf-8")
    again = load_run(file)
    assert again.run == found.run
    assert _shares(again) == shares
    for key, limit in found.robot.limits.items():
        np.testing.assert_array_equal(limit.lower, again.robot.limits[key].lower)
        np.testing.assert_array_equal(limit.upper, again.robot.limits[key].upper)


def test_a_wrong_share_is_told_where_it_stands(tmp_path):
    run = tmp_path / "run.yaml"
    run.write_text(
        "name: n\nrobot: palida\nlimits:\n  reserve:\n    tilt: 3 %\n    strut_speed: 60 %\n"
    )
    with pytest.raises(InputError) as caught:
        load_run(run)
    (problem,) = caught.value.problems
    assert (problem.line, problem.key) == (6, "limits.reserve.strut_speed")
    assert "60 %" in problem.message


def test_an_unknown_limit_is_answered_with_the_nearest():
    with pytest.raises(InputError) as caught:
        _run({"strut_sped": "3 %"})
    (problem,) = caught.value.problems
    assert (problem.key, problem.nearest) == ("limits.reserve.strut_sped", "strut_speed")


def test_a_reserve_of_what_is_not_limited_is_told():
    said = [w for w in _run({"platform_joint_angle": "3 %"}).warnings if "reserve" in w]
    assert len(said) == 1
    assert "platform_joint_angle" in said[0]
    assert not any("reserve" in w for w in _run({"tilt": "3 %"}).warnings)


def test_a_reserve_that_leaves_no_room_at_home_is_refused():
    robot_from(_run("30 %").robot)
    with pytest.raises(InputError) as caught:
        robot_from(_run({"actuator_force": "45 %"}).robot)  # ±23 N are left; home takes 28 N
    (problem,) = caught.value.problems
    assert problem.key == "limits.actuator_force"
    assert "limits.reserve" in problem.message


def test_how_fast_is_slow_does_not_depend_on_it():
    assert _run("10 %").run.design.smoothing == _run().run.design.smoothing


def test_it_is_said_in_words():
    assert "7 % of every limit" in reserve_in_words(_run("7 %").robot.limits)
    assert "7 % of tilt" in reserve_in_words(_run({"tilt": "7 %"}).robot.limits)
