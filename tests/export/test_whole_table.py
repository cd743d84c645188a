"""Reasons against a table as the whole motion."""

from dataclasses import replace

import numpy as np
import pytest

from expdesign.configuration import export_section
from expdesign.export.definition import Interpolation, Rows
from expdesign.export.execution import ExecutedTable
from expdesign.export.exporting import resolve_settings
from expdesign.export.row_times import chosen_times, ideal_rows, whole_motion
from expdesign.export.whole_table import departure, find_faults, wrong_columns
from tests.export.motions import spline_motion_of, task
from tests.recheck.test_unlimited import robot_of

DYNAMIC = ("strut_acceleration", "actuator_force")


def settings_of(form="linuxcnc-strut", drop=()):
    about = task()
    robot = robot_of(drop=drop) if drop else about.robot
    trajectory = about.motion.trajectory.scaled(0.5, robot.home)
    section = export_section(format=form, segment="2 ms", tolerance="1 mm")
    work = replace(about, robot=robot, motion=spline_motion_of(robot, trajectory))
    return resolve_settings(section, work)


def rows_of(settings):
    """Return the rows of the design, as a file of the format has them."""
    rows = ideal_rows(settings, chosen_times(settings))
    linear = settings.form.interpolation is Interpolation.LINEAR
    return replace(rows, rate=None, acceleration=None) if linear else rows


def faults_of(settings, rows, **more):
    return find_faults(settings, ExecutedTable.of(settings, rows), **more)


def part(rows, which, times=None):
    """Return some of the rows, at their times or at others."""
    rate = None if rows.rate is None else rows.rate[which]
    return Rows(rows.times[which] if times is None else times, rows.position[which], rate)


@pytest.mark.parametrize("form", ["linuxcnc-strut", "pi-wave", "xps-pvt", "pvt-csv"])
@pytest.mark.parametrize("drop", [(), DYNAMIC])
def test_the_whole_motion_has_none(form, drop):
    settings = settings_of(form, drop)
    rows = rows_of(settings)
    assert faults_of(settings, rows, longest_step=2e-3) == []
    off, _ = departure(settings, ExecutedTable.of(settings, rows))
    assert off < 1e-12


@pytest.mark.parametrize("drop", [(), DYNAMIC])
def test_the_ends_of_a_table_without_times(drop):
    settings = settings_of(drop=drop)
    rows = rows_of(settings)
    fastest = int(np.argmax(np.abs(np.diff(rows.position, axis=0)).max(axis=1)))
    late = part(rows, slice(fastest, None), rows.times[:-fastest])
    lasts, begins, jumps = faults_of(settings, late)
    assert lasts.startswith("the table lasts")
    assert begins.startswith("the table begins at")
    assert jumps.startswith("row 1: the speed of strut")
    assert faults_of(settings, late, piece=True) == []
    early = part(rows, slice(None, -100))
    assert "the table ends at" in " ".join(faults_of(settings, early))


@pytest.mark.parametrize("drop", [(), DYNAMIC])
@pytest.mark.parametrize("piece", [False, True])
def test_a_hole_is_a_jump_of_speed(drop, piece):
    settings = settings_of(drop=drop)
    rows = rows_of(settings)
    every = np.delete(np.arange(len(rows.times)), slice(200, 220))
    found = faults_of(settings, part(rows, every, rows.times[: len(every)]), piece=piece)
    assert found[-1].startswith(("row 200: the speed", "row 201: the speed"))
    found = faults_of(settings, part(rows, every), piece=piece)
    assert "row 201 follows after 0.042 s where rows are 0.002 s apart" in found


def test_a_hole_between_rows_with_velocities():
    settings = settings_of("pvt-csv")
    rows = rows_of(settings)
    every = np.delete(np.arange(len(rows.times)), slice(200, 220))
    (hole,) = faults_of(settings, part(rows, every), longest_step=2e-3)
    assert hole.endswith("where rows are at most 0.002 s apart")
    moving = replace(part(rows, slice(None)), rate=rows.rate + 1.0)
    assert [text[:18] for text in faults_of(settings, moving)] == [
        "the table begins w",
        "the table ends wit",
    ]


def test_further_columns():
    settings = settings_of("csv")
    rows = rows_of(settings)
    columns = whole_motion(settings.task, rows.times)
    assert wrong_columns(settings, replace(rows, columns=columns)) == []
    for name, change in (("x", 0.5), ("dq1", 100.0), ("window", 1.0)):
        changed = columns | {name: columns[name] + change}
        (text,) = wrong_columns(settings, replace(rows, columns=changed))
        assert text.startswith(f"column {name} is not that of the design")
