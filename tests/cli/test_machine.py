"""`expdesign check --machine`: the machine at home, its reach, and the drawing."""

import json

import numpy as np
import pytest

from expdesign.recheck.reach import reach
from expdesign.robot import load_robot

UNEQUAL = """limits:
  strut_length:
    [[0.45, 0.95], [0.45, 0.95], [0.45, 0.95], [0.45, 0.95], [0.45, 0.95], [0.5, 0.7]]
  rotation: {psi: [-1, 1]}
"""


@pytest.fixture
def run_file(tmp_path, monkeypatch):
    """Write a run of a robot that ships, in a folder that is the current one."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("expdesign.cli.activity._SILENT", 600)  # a slow machine shows progress

    def write(robot, text=""):
        path = tmp_path / "a.yaml"
        path.write_text(f"name: a\nrobot: {robot}\n{text}", encoding="utf-8")
        return path

    return write


def test_it_is_computed_drawn_and_told_to_machines(expdesign, run_file, tmp_path):
    robot = load_robot("linuxcnc")
    status, out, err = expdesign("check", run_file("linuxcnc"), "--machine", "--json")
    assert (status, err) == (0, "")
    machine = json.loads(out)["machine"]
    at_home = {key: one["values"] for key, one in machine["at_home"].items()}
    np.testing.assert_allclose(at_home["strut_length"], robot.inverse_kinematics(robot.home))
    forces = robot.actuator_forces(robot.home, np.zeros(6), np.zeros(6))
    np.testing.assert_allclose(at_home["actuator_force"], forces)
    condition = robot.description.struts_at(robot.home).condition(robot.characteristic_length)
    assert at_home["jacobian_condition"] == pytest.approx([condition])
    for one in reach(robot):
        for side in ("back", "ahead"):
            found, stop = machine["reach"][one.coordinate][side], getattr(one, side)
            assert (found["travel"], found["limit"]) == (pytest.approx(stop.travel), stop.limit)
    drawn = [tmp_path / "runs/a/figures" / f"machine.{ending}" for ending in ("png", "svg")]
    assert machine["files"] == [str(file) for file in drawn]
    assert all(file.is_file() for file in drawn)


@pytest.mark.parametrize("limits", ["", UNEQUAL])
def test_it_is_read_in_a_terminal_of_80_columns(expdesign, run_file, monkeypatch, tmp_path, limits):
    monkeypatch.setenv("COLUMNS", "80")
    place = tmp_path / "elsewhere"
    status, out, err = expdesign("check", run_file("palida", limits), "--machine", "--out", place)
    assert status == 0
    assert max(len(line.rstrip()) for line in out.splitlines()) <= 80
    lines = [line.split() for line in out.splitlines()]
    rows = {line[0]: line[1:] for line in lines if line}
    for strut in "123456":
        assert rows[strut][0] == "676.2"
        assert "−28.43" in rows[strut]
    assert "450 … 950" in out
    assert {"x", "y", "z", "phi", "theta", "psi"} <= set(rows)
    assert rows["z"][0:2] == (["−29.06", "mm"] if limits else ["−150", "mm"])
    assert (place / "figures/machine.svg").is_file()
    assert not (tmp_path / "runs").exists()
    # Warnings and remarks are those of a check without it.
    assert expdesign("check", run_file("palida", limits))[2] == err


def test_a_place_without_a_drawing_is_refused(expdesign, run_file, tmp_path):
    status, out, err = expdesign("check", run_file("palida"), "--out", tmp_path / "elsewhere")
    assert (status, out) == (2, "")
    assert "--machine" in err
    assert not (tmp_path / "elsewhere").exists()


def test_a_place_that_cannot_be_written_to_is_refused(expdesign, run_file, tmp_path):
    (tmp_path / "file").write_text("")
    status, out, err = expdesign(
        "check", run_file("palida"), "--machine", "--out", tmp_path / "file"
    )
    assert status != 0
    assert out == ""
    assert "Traceback" not in err
