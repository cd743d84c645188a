"""The `setp` lines beside G-code: the controller's kinematics are the robot's."""

import numpy as np
import pytest

from expdesign.configuration import export_section, load_run
from expdesign.export.exporting import export_table
from expdesign.machines.genhexkins import setp_lines
from expdesign.machines.importing import read_machine
from expdesign.robot import load_robot, robot_from
from tests.export.motions import task
from tests.export.reading import gcode

INI = """[KINS]
KINEMATICS = genhexkins
[TRAJ]
LINEAR_UNITS = {unit}
HOME = 0 0 1
"""


@pytest.mark.parametrize(("unit", "in_ini", "metres"), [(None, "mm", 1e-3), ("in", "inch", 0.0254)])
def test_the_reader_of_hal_files_finds_the_joints_of_the_robot(unit, in_ini, metres, tmp_path):
    work = task()
    asked = export_section(format="linuxcnc-gcode", units=unit)
    made = export_table(asked, work, tmp_path / "table.ngc")
    assert [p.name for p in made.companions] == ["table.genhexkins.hal", "table.planner.ini"]
    ini = tmp_path / "machine.ini"
    ini.write_text(INI.format(unit=in_ini))
    machine = read_machine("machine", [ini, made.companions[0]])
    robot = work.robot.description
    np.testing.assert_allclose(machine.base_joints, robot.base_joints, rtol=0, atol=1e-12)
    np.testing.assert_allclose(machine.platform_joints, robot.platform_joints, rtol=0, atol=1e-12)
    # What the table says in its own unit is the motion.
    times, poses, _ = gcode(made.path, None)
    wanted = work.motion.sample(times).pose[:, :3]
    np.testing.assert_allclose(poses[:, :3] * metres, wanted, rtol=0, atol=0.6e-6 * metres)
    assert ("G20" if unit == "in" else "G21") in made.path.read_text().splitlines()[1]


@pytest.mark.parametrize("thread", ["right", "left"])
def test_the_reader_finds_the_thread_of_the_robot(thread, tmp_path):
    mapping = load_robot("linuxcnc").description.description.model_dump(mode="json", by_alias=True)
    axes = np.array(mapping["alpha_axes"]) + 0.2 * np.random.default_rng(0).normal(size=(6, 3))
    mapping["drive"] = {"screw": {"lead": 0.004, "thread": thread}}
    mapping["platform_cardan_axes"] = axes.tolist()
    robot = robot_from(load_run({"name": "n", "robot": mapping}).robot)
    ini, hal = tmp_path / "machine.ini", tmp_path / "machine.hal"
    home = [*(1e3 * robot.home[:3]), 0, 0, 0]
    text = INI.format(unit="mm").replace("0 0 1", " ".join(f"{v:g}" for v in home))
    ini.write_text(text)
    hal.write_text("\n".join(setp_lines(robot.description, "mm")) + "\n")
    machine = read_machine("machine", [ini, hal])
    assert machine.drive == robot.description.drive
    again = dict(mapping, platform_cardan_axes=machine.platform_cardan_axes)
    other = robot_from(load_run({"name": "n", "robot": again}).robot)
    pose = robot.home + np.array([0.01, 0.02, 0.01, 0.1, -0.1, 0.2])
    expected = robot.inverse_kinematics(pose)
    np.testing.assert_allclose(other.inverse_kinematics(pose), expected, rtol=0, atol=1e-12)


def test_a_unit_that_g_code_does_not_have():
    with pytest.raises(ValueError, match="lengths in um"):
        export_section(format="linuxcnc-gcode", units="um")
