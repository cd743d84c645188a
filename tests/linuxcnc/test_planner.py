"""G-code in the real LinuxCNC: its planner does what the export says of it."""

import sys
from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from expdesign.configuration import export_section, load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.export.execution import ExecutedTable
from expdesign.export.exporting import ExportError, export_table
from expdesign.export.read_back import read_back
from expdesign.robot import robot_from
from expdesign.trajectory import FourierTrajectory
from tests.export.motions import spline_motion_of, task
from tests.linuxcnc.machine import play

MICROMETRE = 1e-6


def hexapod(size):
    """Return the shipped robot of LinuxCNC, larger or smaller."""
    mapping = load_robot_description("linuxcnc").description.model_dump(mode="json", by_alias=True)
    for key in ("base_joints", "platform_joints"):
        mapping[key] = (size * np.array(mapping[key])).tolist()
    mapping["home"] = [*(size * np.array(mapping["home"][:3])), 0, 0, 0]
    mapping["limits"] = {}
    return robot_from(load_run({"name": "n", "robot": mapping}).robot)


def motion(size, amplitude, frequency, turn=2):
    """Return a task: one period of two harmonics in all coordinates between short ramps."""
    robot = hexapod(size)
    rng = np.random.default_rng(3)
    sizes = np.repeat([size, turn], 3)
    scale = sizes[:, None] * amplitude * np.array([1, 0.4])
    sine, cosine = (scale * rng.uniform(-1, 1, (6, 2)) for _ in range(2))
    trajectory = FourierTrajectory.from_displacements(
        2 * np.pi * frequency, robot.home, sine, cosine
    )
    return replace(task("linuxcnc"), robot=robot, motion=spline_motion_of(robot, trajectory))


HEXAPODS = {
    "linuxcnc": (1.0, 0.05, 1.0),
    "small": (0.2, 0.08, 1.0),
    "large": (3.0, 0.01, 1.0),
    "without rotation": (1.0, 0.05, 1.0, 0),
}
QUICK = [("linuxcnc", 1.0), ("small", 0.3), ("large", 1.0)]
LEVEL = ("without rotation", 1.0)
CASES = [
    *QUICK,
    *(
        pytest.param(*case, marks=[pytest.mark.slow, pytest.mark.full])
        for case in (*product(("linuxcnc", "small", "large"), (1.0, 0.3, 0.1)), LEVEL)
        if case not in QUICK
    ),
]


@pytest.mark.system("linuxcnc")
@pytest.mark.parametrize(("name", "scale"), CASES)
def test_the_planner_does_what_the_export_says(name, scale, tmp_path):
    """Also prints a row of the table in docs/controller-tables.md (`pytest -s`)."""
    work = motion(*HEXAPODS[name])
    made = export_table(
        export_section(format="linuxcnc-gcode", scale=scale), work, tmp_path / "table.ngc"
    )
    lengths, said = play(made, tmp_path), made.check.controller
    duration = said.cycle * (len(lengths) - 1)
    assert duration == pytest.approx(said.duration, rel=0.01)
    designed = made.settings.task.motion.duration
    assert duration == pytest.approx(designed, rel=0.01)
    acceleration = np.abs(np.diff(lengths, 2, axis=0)).max() / said.cycle**2
    assert acceleration == pytest.approx(said.acceleration, rel=0.01, abs=0.01)
    apart, played, times = compare(lengths, made)
    assert apart < 0.1 * MICROMETRE
    struts = work.robot.inverse_kinematics(made.settings.task.motion.sample(times).pose)
    off, stated = np.abs(played - struts).max(), made.check.position_error
    assert off == pytest.approx(stated, abs=MICROMETRE)
    sys.stdout.write(
        f"\n| {name} | {scale:g} | {designed:.3f} s | {duration:.3f} s | {1e3 * off:.3f} mm | "
        f"{1e3 * stated:.3f} mm | {acceleration:.2f} m/s² | {said.acceleration:.2f} m/s² | "
        f"{1e9 * apart:.0f} nm |\n"
    )


def compare(played, made):
    """Return the largest distance from the model in a cycle, m, the samples and their times, s."""
    rows = made.settings.form.read(made.path, made.settings)
    table = ExecutedTable.of(made.settings, rows)
    table = replace(table, rows=table.rows.expanded(), motion=made.settings.task.motion)
    found = []
    for late in range(-5, 30):
        samples, times = played[max(0, -late) :], table.rows.times[max(0, late) :]
        count = min(len(samples), len(times))
        samples, times = samples[:count], times[:count]
        found.append((np.abs(samples - table.lengths(times)).max(), samples, times))
    best = min(found, key=lambda one: one[0])
    assert len(best[1]) > 0.98 * len(played)
    return best


@pytest.mark.system("linuxcnc")
def test_it_repeats_a_period(tmp_path):
    work = motion(*HEXAPODS["linuxcnc"])
    work = replace(work, motion=work.motion.with_periods(5))
    made = export_table(
        export_section(format="linuxcnc-gcode", repeat="controller"), work, tmp_path / "table.ngc"
    )
    assert made.check.rows > 4 * made.path.read_text().count("G1 ") / 2
    lengths = play(made, tmp_path)
    duration = made.check.controller.cycle * (len(lengths) - 1)
    assert duration == pytest.approx(made.check.controller.duration, abs=0.01)
    apart, *_ = compare(lengths, made)
    assert apart < 0.1 * MICROMETRE


def test_a_motion_that_the_planner_cannot_follow_is_refused(tmp_path):
    work = motion(1.0, 0.05, 1.0)
    asked = export_section(
        format="linuxcnc-gcode", linear_acceleration="2 m/s^2", angular_acceleration="200 deg/s^2"
    )
    with pytest.raises(ExportError, match=r"the controller takes .* at least ten servo cycles"):
        export_table(asked, work, tmp_path / "table.ngc")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("cycles", [1, 2])
def test_rows_of_a_few_cycles_are_refused(cycles, tmp_path):
    asked = export_section(format="linuxcnc-gcode", segment=f"{cycles} ms")
    with pytest.raises(ExportError, match="linuxcnc-strut"):
        export_table(asked, motion(1.0, 0.05, 1.0), tmp_path / "table.ngc")


def test_a_program_of_years_is_not_executed(tmp_path):
    made = export_table(
        export_section(format="linuxcnc-gcode"), motion(1.0, 0.02, 1.0), tmp_path / "table.ngc"
    )
    lines = made.path.read_text().splitlines()
    lines[20] = lines[20].partition(" F")[0] + " F0.000001"
    made.path.write_text("\n".join(lines) + "\n")
    (failure,) = read_back(made.path, made.settings).failures
    assert "the program lasts" in failure


def test_limits_that_take_hours_are_refused_at_once(tmp_path):
    asked = export_section(format="linuxcnc-gcode", linear_acceleration="1 um/s^2")
    with pytest.raises(ExportError, match="times as long"):
        export_table(asked, motion(1.0, 0.02, 1.0), tmp_path / "table.ngc")
