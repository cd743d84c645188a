"""Machines of other programs, from their files to a run that passes `check`."""

import math
from pathlib import Path

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.robot import robot_from
from tests.docs.pages import ROOT
from tests.machines import simulated

INCH = 0.0254
LINUXCNC = Path("/usr/share/doc/linuxcnc/examples/sample-configs/sim/axis/vismach/hexapod-sim")
PI = ROOT / "tests/machines/machines/h811.yaml"


def _mujoco(folder):
    file = folder / "model.xml"
    file.write_text(simulated.mjcf())
    return file


def _linuxcnc(_folder):
    if not LINUXCNC.is_dir():
        pytest.skip("LinuxCNC is there without its examples")
    return LINUXCNC / "hexapod.ini"


# axis_0 of the file
_BASE_0, _PLATFORM_0 = (0.055773843, 0.012801635, -0.088326097), (0.029355221, 0.025682309, 0.0)

# Where the file is, and what its struts have at home by the source's own numbers.
SOURCES = {
    "pi": (lambda _folder: PI, np.full(6, math.dist(_BASE_0, _PLATFORM_0)), 2e-9),
    "mujoco": (_mujoco, simulated.LENGTHS, 1e-9),
    # [JOINT_N]HOME, of coordinates with three decimals
    "linuxcnc": (_linuxcnc, np.full(6, 29.7466 * INCH), 1e-3 * INCH),
}
_AS_PROGRAM = {"linuxcnc": pytest.mark.system("rs274")}


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=_AS_PROGRAM.get(name, ())) for name in SOURCES]
)
def test_from_a_file_to_a_run_that_passes_check(name, expdesign, tmp_path, monkeypatch):
    place, lengths, apart = SOURCES[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)
    status, _, err = expdesign("init", name, "--from", place(tmp_path))
    assert status == 0, err
    status, out, err = expdesign("check", f"{name}-run.yaml")
    assert status == 0, err
    assert f"name: {name}" in out
    # What the source does not have is a question beside an assumption.
    text = Path(f"{name}.yaml").read_text(encoding="utf-8")
    assert "assumed" in text
    assert text.count("# ?") > 1
    robot = robot_from(load_run(f"{name}-run.yaml").robot)
    found = robot.inverse_kinematics(robot.home)
    np.testing.assert_allclose(found, lengths, rtol=0, atol=apart)
