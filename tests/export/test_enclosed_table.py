"""Tables over cells of time: what their controllers execute lies within what is proved."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from expdesign.configuration import export_section, load_run
from expdesign.export.certification import certify_table, enclose_table
from expdesign.export.definition import Rows
from expdesign.export.execution import ExecutedTable
from expdesign.export.exporting import resolve_settings
from expdesign.export.row_times import divided_times, ideal_rows
from expdesign.robot import load_robot, robot_from
from expdesign.trajectory import FourierTrajectory
from tests.export.motions import spline_motion_of, task

STRUTS = {"sign": (1, -1, 1, 1, -1, 1), "order": (2, 1, 4, 3, 6, 5), "offset": "home"}
TABLES = {
    "cubic struts": {"format": "xps-pvt", **STRUTS},
    "cubic poses": {"format": "xps-pvt", "space": "pose"},
    "counts": {"format": "pmac-pvt", "counts_per_metre": 2e6, "order": (6, 5, 4, 3, 2, 1)},
    "quintic struts": {"format": "ros2"},
    "quintic poses": {"format": "ros2", "space": "pose"},
    "lines of struts": {"format": "linuxcnc-strut", **STRUTS},
    "lines of poses": {"format": "pi-wave"},
    "lines of roll, pitch, yaw": {"format": "linuxcnc-gcode"},
}


@cache
def small_task():
    """Return the task of a motion that keeps all limits by far."""
    about = task()
    trajectory = about.motion.trajectory.scaled(0.5, about.robot.home)
    return replace(about, motion=spline_motion_of(about.robot, trajectory))


@cache
def turned_task():
    """Return a task about a home pose with ψ = 180°, of which roll, pitch and yaw jump there."""
    mapping = load_robot("linuxcnc").description.description.model_dump(mode="json", by_alias=True)
    mapping["platform_joints"] = [[-x, -y, z] for x, y, z in mapping["platform_joints"]]
    mapping["home"][5] = np.pi
    mapping["limits"]["rotation"] = {"psi": [np.pi - 0.4, np.pi + 0.4]}
    robot = robot_from(load_run({"name": "turned", "robot": mapping}).robot)
    sine = np.array([0.03, 0.02, 0.01, 0.05, 0.05, 0.1])[:, None]
    trajectory = FourierTrajectory.from_displacements(2.0, robot.home, sine, 0.5 * sine)
    motion = spline_motion_of(robot, trajectory)
    return replace(
        task(),
        robot=robot,
        motion=motion,
        force_covariance=robot.description.noise.force_covariance,
    )


def executed(kind, step=1e-2, rounded=True, about=None):
    settings = resolve_settings(export_section(**TABLES[kind]), about or small_task())
    motion = settings.task.motion
    rows = ideal_rows(settings, divided_times(motion, [step] * len(motion.segments)))
    if rounded and settings.digits is not None:
        rows = replace(rows, position=np.round(rows.position, settings.digits))
    return ExecutedTable.of(settings, rows)


ABOUT = [(kind, small_task) for kind in TABLES]
ABOUT += [(kind, turned_task) for kind in TABLES if TABLES[kind].get("space") == "pose"]
ABOUT += [(kind, turned_task) for kind in ("lines of poses", "lines of roll, pitch, yaw")]


@pytest.mark.parametrize(("kind", "about"), ABOUT)
def test_what_is_executed_is_within_what_is_proved(kind, about):
    table = executed(kind, about=about())
    motion = enclose_table(table)
    rng = np.random.default_rng(0)
    places = np.sort(rng.choice(len(motion.breaks) - 1, 60, replace=False))
    start, end = motion.breaks[places], motion.breaks[places + 1]
    low, high = np.sort(rng.uniform(0, 1, (2, 60)), axis=0)
    edges = np.stack([start + low * (end - start), start + high * (end - start)], axis=1)
    tau = rng.uniform(-1, 1, 60)
    times = edges.mean(axis=1) + tau * np.diff(edges, axis=1)[:, 0] / 2

    models = motion.models(edges)
    states = table.between(times).states

    # Straight lines have no acceleration.
    known = 2 if kind.startswith("lines") else 3
    for k, part in enumerate(states[:known]):
        for column, model in zip(part.T, models[6 * k : 6 * k + 6], strict=True):
            # The interpolator's own numbers have about twelve digits.
            computed = 1e-9 * (1 + np.abs(column))
            assert np.all(np.isfinite(model.radius))
            assert np.all(np.abs(model.at(tau) - column) <= model.radius + computed)


@pytest.mark.parametrize(("kind", "about"), ABOUT)
def test_a_table_that_keeps_its_limits_is_certified(kind, about):
    found = certify_table(executed(kind, about=about()))

    assert found.certified
    assert bool(found.sampled) == kind.startswith("lines")
    assert [limit.key for limit in found.limits] == [limit.key for limit in about().robot.limits]


@pytest.mark.parametrize("kind", ["cubic struts", "cubic poses", "quintic struts"])
def test_a_spike_between_two_rows_is_never_certified(kind):
    table = executed(kind, rounded=False)
    good = certify_table(table)
    row = len(table.rows.times) // 2 + 1
    rates = table.rows.velocities.copy()
    # At one row alone 0.15 m/s more than its neighbours have: 60 m/s² on the way there.
    rates[row, 2] += 0.15 * abs(table.axes.factor[2])
    spiked = replace(table, rows=replace(table.rows, rate=rates))

    found = certify_table(spiked)

    assert good.certified
    assert not found.certified
    broken = {check.key for check in found.limits if not check.certified}
    assert "strut_acceleration" in broken
    (check,) = [one for one in found.limits if one.key == "strut_acceleration"]
    assert check.violation > 1e-6
    near = table.rows.times[[row - 1, row + 1]]
    assert near[0] <= check.time <= near[1]


def late(table, rows=40):
    """Return the table without its first rows."""
    parts = {
        "position": table.rows.position[rows:],
        "rate": table.rows.velocities[rows:],
    }
    return replace(table, rows=Rows(table.rows.times[rows:] - table.rows.times[rows], **parts))


def test_a_table_that_begins_elsewhere_is_certified_as_a_piece_only():
    moved = late(executed("cubic struts"))

    found = certify_table(moved)

    assert not found.certified
    assert found.unproved_from == 0
    assert all(check.proved == np.inf for check in found.limits)

    piece = certify_table(moved, piece=True)
    assert piece.certified
    rates = moved.rows.velocities.copy()
    rates[30, 2] += 0.15 * abs(moved.axes.factor[2])
    spiked = replace(moved, rows=replace(moved.rows, rate=rates))
    found = certify_table(spiked, piece=True)
    assert "strut_acceleration" in {check.key for check in found.broken}
