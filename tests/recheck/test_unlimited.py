"""What is not limited is known, and what a motion does there."""

import itertools

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from expdesign.configuration import load_run
from expdesign.configuration.limits import open_in_words, open_rows
from expdesign.recheck.limit_check import unlimited, unlimited_warning
from expdesign.robot import load_robot, robot_from
from expdesign.trajectory import FourierTrajectory

PALIDA = load_robot("palida")
POSES = 8


def _open(robot):
    return open_rows(robot.limits, robot.shared_joint_pairs)


def robot_of(name="palida", drop=(), **limits):
    run = load_run({"name": "n", "robot": name, "limits": limits})
    data = run.run.robot.model_dump(mode="json", by_alias=True, exclude_none=True)
    data["limits"] = {key: value for key, value in data["limits"].items() if key not in drop}
    return robot_from(load_run({"name": "n", "robot": data}).robot)


def turning(robot, *amplitudes):
    """Return a motion about home with one sine of the three rotations, rad."""
    sine = np.zeros((6, 1))
    sine[3 : 3 + len(amplitudes), 0] = amplitudes
    return FourierTrajectory.from_displacements(1.0, robot.home, sine, np.zeros((6, 1)))


def found_in(robot, motion, points=400):
    times = motion.sample_times(points)
    return {(one.key, one.row): one for one in unlimited(robot, motion, times)}


def test_limits_that_are_not_set_are_named():
    left = _open(PALIDA.description)
    assert [str(one) for one in left] == ["platform_joint_angle", "rotation (phi, theta, psi)"]
    some = robot_of(rotation={"phi": ["-20 deg", "20 deg"]}, platform_joint_angle="40 deg")
    assert [str(one) for one in _open(some.description)] == ["rotation (theta, psi)"]
    whole = {name: ["-20 deg", "20 deg"] for name in ("phi", "theta", "psi")}
    every = robot_of(rotation=whole, platform_joint_angle="40 deg")
    assert _open(every.description) == ()
    assert open_in_words(()) == ""
    assert found_in(every, turning(every, 0.1)) == {}
    assert unlimited_warning(()) == ""


def test_rotations_are_told_from_home():
    found = found_in(PALIDA, turning(PALIDA, 0.1, 0.0, -0.3))
    rotations = {row: one.value for (key, row), one in found.items() if key == "rotation"}
    assert rotations == pytest.approx({"phi": 0.1, "theta": 0.0, "psi": 0.3}, abs=1e-4)
    text = unlimited_warning(list(found.values()))
    assert text.startswith(open_in_words(_open(PALIDA.description)))
    # In the unit in which angles are read, to three digits.
    assert f"psi {np.degrees(0.3):.3g} deg from home" in text


def segments_apart(first, second):
    """Return the distance of two segments, each (2, 3): s and t in [0, 1] by least squares."""
    matrix = np.stack([first[1] - first[0], second[0] - second[1]], axis=1)
    return np.sqrt(2 * lsq_linear(matrix, second[0] - first[0], (0, 1), tol=1e-14).cost)


@pytest.mark.parametrize("name", ["palida", "linuxcnc"])
def test_the_closest_struts_and_the_largest_joint_angle(name):
    robot = robot_of(name, drop=("strut_clearance", "beta"))
    motion = turning(robot, 0.0, 0.0, 0.5)
    found = found_in(robot, motion, POSES)
    poses = motion.sample(motion.sample_times(POSES)).pose
    about, pairs = robot.description, list(itertools.combinations(range(6), 2))
    apart, angle = {}, []
    for pose in poses:
        turn, place = pose[5], pose[:3]
        rotation = np.array(
            [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
        )
        tips = place + about.platform_joints @ rotation.T
        struts = np.stack([about.base_joints, tips], axis=1)
        for i, j in pairs:
            if (i, j) not in about.shared_joint_pairs:
                gap = segments_apart(struts[i], struts[j])
                apart[i, j] = min(gap, apart.get((i, j), np.inf))
        axes = about.platform_joint_axes @ rotation.T
        along = struts[:, 1] - struts[:, 0]
        along /= np.linalg.norm(along, axis=1)[:, None]
        angle.append(np.arccos(np.clip(np.sum(axes * along, axis=1), -1, 1)))
    (clearance,) = (one for (key, _), one in found.items() if key == "strut_clearance")
    assert clearance.value == pytest.approx(min(apart.values()), abs=1e-7)
    largest = [one.value for (key, _), one in found.items() if key == "platform_joint_angle"]
    assert largest == pytest.approx([np.max(angle)], abs=1e-6)
    struts = robot.strut_motion(poses, np.zeros_like(poses), np.zeros_like(poses))
    off = np.abs(struts.beta - struts.beta[0])
    (beta,) = (one for (key, _), one in found.items() if key == "beta")
    assert beta.value == pytest.approx(off.max(), abs=1e-9)
    assert beta.row == f"strut {np.argmax(off.max(axis=0)) + 1}"


def test_struts_that_share_a_joint_have_no_distance():
    points = PALIDA.description.base_joints.copy()
    points[1] = points[0]
    data = {"name": "p", **_described(PALIDA), "base_joints": points.tolist()}
    data["limits"].pop("strut_clearance")
    robot = robot_from(load_run({"name": "n", "robot": data}).robot)
    assert robot.description.shared_joint_pairs
    found = found_in(robot, turning(robot, 0.01))
    assert all(one.value > 0 for (key, _), one in found.items() if key == "strut_clearance")


def _described(robot):
    run = load_run({"name": "n", "robot": robot.name})
    return run.run.robot.model_dump(mode="json", by_alias=True, exclude_none=True)
