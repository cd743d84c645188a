"""How far the platform goes from home along one coordinate, and what stops it."""

import numpy as np
import pytest
from scipy.optimize import brentq

from expdesign.configuration import load_run
from expdesign.recheck.reach import SINGULAR, reach
from expdesign.robot import load_robot, robot_from

PALIDA = load_robot("palida")

UP = np.array([0, 0, 1])


def reach_of(robot="palida", **limits):
    """Return the reach by coordinate of PaLiDA, or another robot, with these limits alone."""
    mapping = load_robot(robot).description.description.model_dump(mode="json", by_alias=True)
    mapping["limits"] = {"characteristic_length": 0.1, "rotation": "none", **limits}
    found = reach(robot_from(load_run({"name": "n", "robot": mapping}).robot))
    return {one.coordinate: one for one in found}


def told(stop):
    return stop.limit, stop.rows, stop.bound


def test_a_bound_on_the_coordinate_itself_is_its_reach():
    found = reach_of(
        position={"x": [-0.1, 0.02], "z": [-0.7, -0.6]}, rotation={"psi": ["-5 deg", "1 deg"]}
    )
    assert found["x"].back.travel == pytest.approx(0.1, abs=1e-6)
    assert found["x"].ahead.travel == pytest.approx(0.02, abs=1e-6)
    assert told(found["x"].back) == ("position", ("x",), -0.1)
    # From home, which is at -0.654 m.
    assert found["z"].back.travel == pytest.approx(0.046, abs=1e-6)
    assert found["z"].ahead.travel == pytest.approx(0.054, abs=1e-6)
    assert np.degrees(found["psi"].back.travel) == pytest.approx(5, abs=1e-4)
    assert told(found["psi"].ahead) == ("rotation", ("psi",), np.radians(1))
    # Those of the rotation that nobody bounds stop where the default is.
    assert np.degrees(found["phi"].ahead.travel) == pytest.approx(30, abs=1e-4)


def test_struts_stop_where_their_lengths_say():
    found = reach_of(strut_length=[0.6, 0.7])
    about = PALIDA.description
    offset = about.platform_joints[0] + PALIDA.home[:3] - about.base_joints[0]

    def way(length):
        """Height of the TCP at which the struts, all alike, are that long."""
        return brentq(lambda z: np.linalg.norm(offset + z * UP) - length, -0.4, 0.4)

    assert found["z"].back.travel == pytest.approx(-way(0.7), abs=1e-6)
    assert found["z"].ahead.travel == pytest.approx(way(0.6), abs=1e-6)
    every = tuple(f"strut {j}" for j in range(1, 7))
    assert told(found["z"].back) == ("strut_length", every, 0.7)
    assert told(found["z"].ahead) == ("strut_length", every, 0.6)
    # Turned about z, every other strut is the longest.
    psi = found["psi"]
    assert {psi.back.rows, psi.ahead.rows} == {every[::2], every[1::2]}
    for stop, sign in ((psi.back, -1), (psi.ahead, 1)):
        turned = PALIDA.home + np.array([0, 0, 0, 0, 0, sign * stop.travel])
        assert np.max(PALIDA.inverse_kinematics(turned)) == pytest.approx(0.7, abs=1e-6)
        assert stop.travel == pytest.approx(psi.ahead.travel, abs=1e-6)


def test_one_strut_that_is_shorter_is_named():
    rows = [[0.5, 0.9]] * 6
    rows[3] = [0.5, 0.7]
    stop = reach_of(strut_length=rows)["z"].back
    assert told(stop) == ("strut_length", ("strut 4",), 0.7)


def test_where_nothing_is_limited_a_singular_pose_stops():
    """A hexapod whose base and platform are alike is singular when turned by 90° (Fichter)."""
    found = reach_of()
    for stop in (found["psi"].back, found["psi"].ahead):
        assert told(stop) == (SINGULAR, (), None)
        assert np.degrees(stop.travel) == pytest.approx(90, abs=1e-6)
    # Away from the base nothing ends: the struts are long.
    assert told(found["z"].back) == ("", (), None)
    assert found["z"].back.travel == pytest.approx(3 * 0.676162, abs=1e-5)


def test_gravity_alone_stops_where_the_forces_do():
    """At rest, with the forces that bear the machine."""
    most = 40.0
    stop = reach_of(actuator_force=most)["x"].ahead
    assert stop.limit == "actuator_force"
    there = PALIDA.home + np.array([stop.travel, 0, 0, 0, 0, 0])
    forces = PALIDA.actuator_forces(there, np.zeros(6), np.zeros(6))
    assert np.max(np.abs(forces)) == pytest.approx(most, abs=1e-3)
    (row,) = {int(name.split()[1]) - 1 for name in stop.rows[:1]}
    assert abs(forces[row]) == pytest.approx(most, abs=1e-3)
