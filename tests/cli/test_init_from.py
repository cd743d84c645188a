"""`expdesign init --from`: the files that it writes are the machine of another program's files."""

import json
import shlex

import numpy as np
import pytest

from expdesign.configuration import load_run
from expdesign.machines.importing import read_machine
from tests.machines import simulated
from tests.machines.machines_of import FOLDER, lengths
from tests.machines.test_matlab import ring


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)


def test_linuxcnc_and_options_that_count_before_it(expdesign, tmp_path):
    files = ("--from", str(FOLDER / "mill.ini"), "--from", str(FOLDER / "mill.hal"))
    told = ("--strut-speed", "30 mm/s", "--mass", "64 kg")
    status, _, err = expdesign("init", "mill", *files, *told)
    assert status == 0, err
    assert expdesign("check", "mill-run.yaml")[0] == 0
    robot = load_run("mill-run.yaml").robot
    mill = read_machine("mill", [FOLDER / "mill.ini"])
    np.testing.assert_allclose(robot.base_joints, mill.base_joints, rtol=0, atol=1e-12)
    np.testing.assert_allclose(robot.platform_joints, mill.platform_joints, rtol=0, atol=1e-12)
    np.testing.assert_allclose(robot.home, mill.home, rtol=0, atol=1e-9)
    np.testing.assert_allclose(robot.limits["strut_length"].upper, [0.8] * 5 + [0.81])
    assert robot.limits["strut_speed"].upper[0] == 0.03
    text = (tmp_path / "mill.yaml").read_text(encoding="utf-8")
    assert "drive: {screw: {lead: 5 mm}}" in text
    assert robot.drive.screw.thread == "right"
    assert text.count("Which inertia have motor, coupling and screw") == 1
    assert "genhexkins corrects the lengths" in " ".join(text.replace("# ?", " ").split())


@pytest.mark.parametrize("title", ["h811", "mjcf", "sdf"])
def test_other_formats_pass_check_and_keep_the_lengths(title, expdesign, tmp_path):
    file = FOLDER / "h811.yaml"
    if title != "h811":
        file = tmp_path / ("model.sdf" if title == "sdf" else "model.xml")
        file.write_text(getattr(simulated, title)())
    status, _, err = expdesign("init", "m", "--from", str(file))
    assert status == 0, err
    robot = load_run("m-run.yaml").robot
    machine = read_machine("m", [file])
    rng = np.random.default_rng(1)
    ends = [np.array(robot.base_joints), np.array(robot.platform_joints)]
    for _ in range(5):
        pose = np.array(machine.home) + rng.uniform(-0.005, 0.005, 6)
        written = machine.__class__("m", base_joints=ends[0], platform_joints=ends[1])
        np.testing.assert_allclose(
            lengths(written, pose), lengths(machine, pose), rtol=0, atol=1e-12
        )


def test_options_change_only_what_they_state(expdesign, tmp_path):
    file = tmp_path / "model.xml"
    file.write_text(simulated.mjcf())
    home = np.array(read_machine("m", [file]).home)
    options = ("--mass", "64 kg", "--home-height", "710 mm")
    status, _, err = expdesign("init", "m", "--from", str(file), *options)
    assert status == 0, err
    robot = load_run("m-run.yaml").robot
    home[2] = 0.71
    np.testing.assert_allclose(robot.home, home, rtol=0, atol=1e-9)
    assert robot.parameters["p10"] == pytest.approx(64 + 6 * 0.25)
    given = simulated.PLATE + simulated.PAYLOAD
    platform = robot.description.bodies.part("platform")
    assert platform.inertia[2, 2] == pytest.approx(64 / given * 0.4 * given * 0.1**2)
    assert "scaled to 64 kg" in (tmp_path / "m.yaml").read_text(encoding="utf-8")


def test_an_inertia_does_not_turn_a_left_handed_thread(expdesign, tmp_path):
    hal = (FOLDER / "mill.hal").read_text().replace("[SCREW]LEAD", "-5")
    (tmp_path / "mill.hal").write_text(hal)
    (tmp_path / "mill.ini").write_text((FOLDER / "mill.ini").read_text())
    drive = ("--drive", "screw", "--lead", "5 mm", "--inertia", "6e-5 kg m^2")
    status, _, err = expdesign("init", "mill", "--from", "mill.ini", *drive)
    assert status == 0, err
    robot = load_run("mill-run.yaml").robot
    assert robot.drive.screw.inertia == pytest.approx(6e-5)
    assert robot.thread_lead == pytest.approx(-0.005)


@pytest.mark.parametrize("drive", [("direct",), ("gear", "--lead", "10 mm")])
def test_a_stated_drive_without_a_screw_has_none_that_turns(drive, expdesign):
    status, _, err = expdesign("init", "m", "--from", str(FOLDER / "mill.ini"), "--drive", *drive)
    assert status == 0, err
    robot = load_run("m-run.yaml").robot
    assert (robot.drive.screw, robot.platform_cardan_axes) == (None, None)


def test_sets_of_joints_are_named_by_options(expdesign, tmp_path):
    platform = np.roll(ring(0.25, 60, 12, -0.05), 1, axis=0)
    points = [ring(0.45, 0, 8).tolist(), platform.tolist()]
    content = dict(zip(("Gelenke unten", "oben"), points, strict=True), h=0.7, unit="m")
    (tmp_path / "m.json").write_text(json.dumps(content))
    command = ("init", "m", "--from", "m.json")
    status, _, err = expdesign(*command)
    assert status == 2
    options = ["--base-joints", "Gelenke unten", "--platform-joints", "oben"]
    assert shlex.join(options) in " ".join(err.split())
    status, _, err = expdesign(*command, *options)
    assert status == 0, err
    np.testing.assert_allclose(load_run("m-run.yaml").robot.base_joints, points[0])
    status, _, err = expdesign("init", "k", "--from", str(FOLDER / "mill.ini"), *options)
    assert (status, "no sets of points with names" in " ".join(err.split())) == (2, True)


def test_a_terminal_is_asked_only_what_the_file_does_not_say(expdesign, monkeypatch):
    asked = []
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    monkeypatch.setattr(
        "expdesign.cli.init.typer.prompt", lambda text, *_, **__: asked.append(text) or ""
    )
    assert expdesign("init", "m", "--from", str(FOLDER / "mill.ini"))[0] == 0
    # Force and mass are what LinuxCNC does not know.
    assert len(asked) == 2


def test_a_file_that_is_wrong_is_bad_input_and_nothing_is_written(expdesign, tmp_path):
    (tmp_path / "other.ini").write_text("[TRAJ]\nLINEAR_UNITS = mm\n")
    status, _, err = expdesign("init", "m", "--from", "other.ini")
    assert status == 2
    assert "other.ini" in err
    assert [path.name for path in tmp_path.iterdir()] == ["other.ini"]
