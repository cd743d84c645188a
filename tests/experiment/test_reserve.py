"""A design with reserves: what its limits are, and what tables and reports say of it."""

import csv
import json
from dataclasses import astuple

import numpy as np
import pytest

import expdesign
from expdesign.experiment import DesignResult
from expdesign.motion.planning import check_motion, executable_motion
from tests.experiment.off_the_grids import TOLERANCE, excess

pytestmark = pytest.mark.slow

RESERVE = {"position": "5 %", "strut_speed": "10 %", "attitude": "4 %"}
SHARES = {"position": 0.05, "strut_speed": 0.1, "attitude": 0.04}
LARGEST = np.radians(12)
"""Of θ."""


@pytest.fixture(scope="module")
def result(tiny, cheaper):
    """Return a design of a machine some of whose limits have a reserve."""
    limits = {"reserve": RESERVE, "attitude": LARGEST}
    run = tiny(
        limits=limits,
        trajectory={"controller_period": 0.001},
        design={"max_iterations": 160},
    )
    with cheaper():
        return expdesign.design(run)


def drawn_in(result):
    """Return the bounds that are left of the stated ones, by key."""
    stated = result.configuration.run.robot.limits
    x, y, z = (stated["position"][name] for name in "xyz")
    lower, upper = np.array([x, y, z]).T
    width = upper - lower
    speed = stated["strut_speed"] * (1 - 2 * SHARES["strut_speed"])
    angle = LARGEST * (1 - 2 * SHARES["attitude"])
    return {
        "position": (lower + 0.05 * width, upper - 0.05 * width),
        "strut_speed": (-speed, speed),
        "attitude": (-angle, angle),
    }


def moved(robot, motion):
    """Return what the reserves are of, along a motion."""
    struts = robot.strut_motion(motion.pose, motion.rate, motion.acceleration)
    theta = motion.pose[:, 4]
    return {
        "position": motion.pose[:, :3],
        "strut_speed": struts.length_rate,
        "attitude": np.arctan2(np.sin(theta), np.abs(np.cos(theta)))[:, None],
    }


def test_the_bounds_that_are_drawn_in_are_kept_between_all_grids(result):
    times = result.trajectory.period * np.random.default_rng(0).random(40_000)
    found = moved(result.robot, result.trajectory.sample(times))
    worst = {
        key: float(np.max(excess(found[key], *(np.atleast_1d(b) for b in bounds))))
        for key, bounds in drawn_in(result).items()
    }
    assert max(worst.values()) <= TOLERANCE
    assert max(worst.values()) > -0.005  # one of them at least holds the motion


def test_the_whole_motion_keeps_them(result):
    whole = executable_motion(result.configuration, result.trajectory)
    assert check_motion(result.configuration, whole).passed
    times = np.linspace(0.0, whole.duration, 20_011)
    found = moved(result.robot, whole.sample(times))
    for key, (lower, upper) in drawn_in(result).items():
        slack = TOLERANCE * np.max(np.subtract(upper, lower))
        assert np.all(found[key] >= lower - slack), key
        assert np.all(found[key] <= upper + slack), key


def test_tables_state_bound_reserve_and_what_was_planned_with(result, tmp_path):
    result.write(tmp_path)
    with (tmp_path / "tables/limits.csv").open(encoding="utf-8") as stream:
        rows = {row["limit"]: row for row in csv.DictReader(stream)}
    document = json.loads((tmp_path / "design.json").read_text(encoding="utf-8"))["limits"]
    assert set(rows) == set(document) == {limit.key for limit in result.robot.limits}
    for key, row in rows.items():
        share = SHARES.get(key, 0.0)
        for found in (row, document[key]):
            bound, stated = float(found["bound"]), float(found["stated"])
            assert float(found["reserve"]) == share
            assert (abs(bound) == abs(stated)) == (share == 0), key
    for key, half in (("strut_speed", 2.0), ("attitude", LARGEST)):
        assert abs(float(rows[key]["stated"])) == pytest.approx(half)
        assert abs(float(rows[key]["bound"])) == pytest.approx(half * (1 - 2 * SHARES[key]))
    found = DesignResult.read(tmp_path).checks
    np.testing.assert_equal(*([astuple(check) for check in one] for one in (found, result.checks)))


def test_quantities_are_those_of_the_recheck(result):
    """The judge's worst values are on the motion."""
    for check in result.check.limits:
        if check.key in SHARES:
            motion = result.trajectory.sample(np.array([check.time]))
            values = moved(result.robot, motion)[check.key]
            assert np.min(np.abs(values - check.value)) < 1e-9
