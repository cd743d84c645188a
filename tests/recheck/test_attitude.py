"""A motion towards the attitude at which the angles are singular: judged and stopped."""

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.recheck.certificate import recheck
from expdesign.recheck.reach import reach
from expdesign.robot import LimitModel, load_robot, robot_from
from expdesign.trajectory import FourierTrajectory


def robot_of(theta=0.0, **limits):
    """Return PaLiDA with these limits alone, and θ of home in degrees."""
    mapping = load_robot("palida").description.description.model_dump(mode="json", by_alias=True)
    mapping["limits"] = {"characteristic_length": 0.1, "rotation": "none", **limits}
    mapping["home"] = [0, 0, -0.654, 0, f"{theta} deg", 0]
    return robot_from(load_run({"name": "n", "robot": mapping}).robot)


def swinging(robot, amplitude):
    """Return a motion about home with one sine of θ, degrees."""
    sine = np.zeros((6, 1))
    sine[4, 0] = np.radians(amplitude)
    return FourierTrajectory.from_displacements(1.0, robot.home, sine, np.zeros((6, 1)))


@pytest.mark.parametrize(
    ("theta", "amplitude", "largest", "bound"),
    [(0, 79, -79, -80), (0, 81, -81, -80), (40, 35, 75, 80), (170, 71, -81, -80), (10, 90, 90, 80)],
)
def test_it_is_judged_as_the_other_limits_are(theta, amplitude, largest, bound):
    robot = robot_of(theta)
    (check,) = recheck(LimitModel.of(robot), swinging(robot, amplitude)).limits
    assert check.key == "attitude"
    assert np.degrees(abs(check.value)) == pytest.approx(abs(largest), abs=1e-4)
    assert np.degrees(abs(check.bound)) == pytest.approx(abs(bound))
    assert check.kept == (abs(largest) <= abs(bound))
    assert check.violation == pytest.approx((abs(largest) - abs(bound)) / 160, abs=1e-6)


def test_whoever_keeps_a_tighter_limit_keeps_it():
    robot = robot_of(tilt="60 deg")
    for amplitude, kept in ((59, True), (61, False)):
        (check,) = recheck(LimitModel.of(robot), swinging(robot, amplitude)).limits
        assert (check.key, check.kept) == ("tilt", kept)


def test_it_stops_a_coordinate():
    found = {one.coordinate: one for one in reach(robot_of(30))}
    theta = found["theta"]
    assert theta.back.limit == "attitude"
    assert np.degrees(theta.back.travel) == pytest.approx(110, abs=1e-3)
    assert np.degrees(theta.ahead.travel) < 50  # a singular pose of the struts comes first


def test_the_optimiser_sees_the_sine():
    robot = robot_of(attitude=["-60 deg", "70 deg"])
    model = LimitModel.of(robot)
    states = np.zeros((4, 18))
    states[:, :6] = robot.home
    states[:, 4] = np.radians([-61, -59, 69, 71])
    smooth = model.smooth_violations(states, 0.1)[:, 0]
    np.testing.assert_array_equal(smooth > 0, [True, False, False, True])
    np.testing.assert_array_equal(model.violations(states)[:, 0] > 0, smooth > 0)
