"""The `setp` lines beside G-code: the controller's kinematics are the robot's."""

import numpy as np
import pytest

from expdesign.configuration import ExportSection
from expdesign.export.exporting import export_table
from expdesign.robotfile.importing import read_machine
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
    asked = ExportSection(format="linuxcnc-gcode", segment="2 ms", tolerance="50 um", units=unit)
    made = export_table(asked, work, tmp_path / "table.ngc")
    assert [path.name for path in made.beside] == ["table.genhexkins.hal"]
    ini = tmp_path / "machine.ini"
    ini.write_text(INI.format(unit=in_ini))
    machine = read_machine("machine", [ini, *made.beside])
    robot = work.robot.description
    np.testing.assert_allclose(machine.base_joints, robot.base_joints, rtol=0, atol=1e-12)
    np.testing.assert_allclose(machine.platform_joints, robot.platform_joints, rtol=0, atol=1e-12)
    # What the table says in its own unit is the motion.
    times, poses, _ = gcode(made.path, None)
    wanted = work.motion.sample(times).pose[:, :3]
    np.testing.assert_allclose(poses[:, :3] * metres, wanted, rtol=0, atol=0.6e-6 * metres)
    assert ("G20" if unit == "in" else "G21") in made.path.read_text().splitlines()[1]


def test_a_unit_that_g_code_does_not_have():
    with pytest.raises(ValueError, match="lengths in um"):
        ExportSection(format="linuxcnc-gcode", units="um")
