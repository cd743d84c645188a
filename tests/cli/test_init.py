import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from expdesign.cli import init
from expdesign.cli.options import INIT_OPTIONS
from expdesign.configuration import load_run
from expdesign.machines.assumed import points
from expdesign.machines.importing import read_machine
from tests.docs.pages import ROOT

MACHINES = ROOT / "tests/machines/machines"

TOLD = (
    *("--base-radius", "450 mm", "--base-half-angle", "8 deg"),
    *("--platform-radius", "250 mm", "--platform-half-angle", "12 deg", "--platform-z", "-50 mm"),
    *("--home-height", "700 mm", "--strut-length", "600 mm, 900 mm"),
    *("--strut-speed", "300 mm/s", "--strut-acceleration", "5 m/s^2"),
    *("--actuator-force", "2 kN", "--mass", "64 kg", "--drive", "screw", "--lead", "5 mm"),
    *("--inertia", "6e-5 kg m^2"),
    *("--force-std", "20 N", "--length-std", "5 um"),
)


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin.isatty", lambda: False, raising=False)


@pytest.fixture
def answers(monkeypatch):
    """Let a terminal answer what the command asks."""

    def answered(**texts):
        asked = []

        def prompt(text, *_, **__):
            option = next(k for k, o in INIT_OPTIONS.items() if text.startswith(o.help[:-1]))
            asked.append(option)
            given = texts.get(option, "")
            return given.pop(0) if isinstance(given, list) else given

        monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
        monkeypatch.setattr(init.typer, "prompt", prompt)
        return asked

    return answered


def test_what_init_writes_passes_check(expdesign, tmp_path):
    status, out, err = expdesign("init", "mine")
    assert (status, out) == (0, "written to mine.yaml and mine-run.yaml\n")
    assert "defaults to check" in err
    status, _, err = expdesign("check", "mine-run.yaml")
    assert status == 0
    # Nothing is odd; what the template leaves open is said.
    assert err.count("warning") == err.count("no limit is set on") + err.count("assumed, to be")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["mine-run.yaml", "mine.yaml"]


def test_what_is_told_stands_in_the_files(expdesign, tmp_path):
    status, out, err = expdesign("init", "mine", *TOLD, "--out", "robots", "--json")
    assert (status, err) == (0, "")
    data = json.loads(out)
    assert data["run"] == str(tmp_path / "robots" / "mine-run.yaml")
    assert not {"base_joints", "home", "strut_length", "force_std"} & set(data["assumed"])
    assert {"tilt", "parameters"} <= set(data["assumed"])
    robot = load_run(data["run"]).robot
    # Strut 2 goes from 8° to 48° of the base's circle: 60° less the half-angle of a pair above.
    first, second = np.radians([8.0, 60.0 - 12.0])
    base = [0.45 * np.cos(first), 0.45 * np.sin(first), 0]
    platform = [0.25 * np.cos(second), 0.25 * np.sin(second), -0.05]
    np.testing.assert_allclose(robot.base_joints[1], base)
    np.testing.assert_allclose(robot.platform_joints[1], platform)
    np.testing.assert_array_equal(robot.home, [0, 0, 0.7, 0, 0, 0])
    limits = robot.limits
    np.testing.assert_array_equal(limits["strut_length"].lower, 0.6)
    np.testing.assert_array_equal(limits["strut_length"].upper, 0.9)
    assert limits["strut_speed"].upper[0] == 0.3
    assert limits["strut_acceleration"].upper[0] == 5
    assert limits["actuator_force"].upper[0] == 2000
    assert robot.parameters["p10"] == pytest.approx(64 * (1 + 6 * 0.04))
    assert robot.description.noise.force_std == (20.0,) * 6
    assert robot.description.noise.length_std == (5e-6,) * 6
    screw = robot.drive.screw
    assert (screw.lead, screw.inertia) == (5e-3, 6e-5)
    assert robot.parameters["m_drive"] == pytest.approx(6e-5 * (2 * np.pi / 5e-3) ** 2)


def test_every_command_lists_assumed_values_until_their_questions_are_deleted(expdesign):
    assert expdesign("init", "mine", "--force-std", "3 N")[0] == 0

    def listed():
        _, _, err = expdesign("check", "mine-run.yaml")
        found = re.findall(r"assumed, to be checked \(`# \?` in mine.yaml\): (.*)", err)
        return found[0].split(", ") if found else []

    first = listed()
    assert {"home", "bodies", "parameters", "length_std", "strut_speed", "tolerances"} <= set(first)
    assert not {"force_std", "name", "noise", "platform"} & set(first)
    file = Path("mine.yaml")
    confirmed = re.sub(r"( *# \?.*\n)+(?= *strut_speed:)", "", file.read_text())
    file.write_text(confirmed)
    assert set(first) - set(listed()) == {"strut_speed"}
    file.write_text(re.sub(r" *# \?.*\n", "", confirmed))
    assert listed() == []


def test_tolerances_are_those_of_the_robot(expdesign):
    given = ("--joint-tolerance", "0.3 mm", "--length-tolerance", "0.1mm")
    given += ("--gravity-tolerance", "0.1 deg", "--delay-tolerance", "0.2 ms")
    given += ("--force-tolerance", "2 %", "--force-tolerance-each", "1 %")
    assert expdesign("init", "mine", *given)[0] == 0
    tolerances = load_run("mine-run.yaml").robot.description.tolerances
    np.testing.assert_array_equal(tolerances.base_joints, 3e-4)
    np.testing.assert_array_equal(tolerances.platform_joints, 3e-4)
    assert tolerances.strut_length == (1e-4,) * 6
    assert tolerances.force_constant.common == 0.02
    assert tolerances.force_constant.each == (0.01,) * 6
    assert (tolerances.gravity, tolerances.delay) == (pytest.approx(np.radians(0.1)), 2e-4)
    status, _, err = expdesign("init", "other", "--force-tolerance", "2")
    assert (status, "did you mean '2 %'?" in err) == (2, True)


def test_joints_as_lists_and_a_stroke(expdesign):
    base = "300 mm,0,0; 0.2,0.3,0; -0.1,0.3,0; -0.3,0,0; -0.2,-0.3,0; 0.2,-0.3,0"
    platform = "0.1,-0.1,0; 0.1,0.1,0; 0,0.14,0; -0.1,0.1,0; -0.1,-0.1,0; 0,-0.14,0;"
    joints = ("--base-joints", base, "--platform-joints", platform)
    status, _, err = expdesign("init", "m", *joints, "--home-height", "-0.4", "--stroke", "10 cm")
    assert status == 0, err
    robot = load_run("m-run.yaml").robot
    np.testing.assert_array_equal(robot.base_joints[0], [0.3, 0, 0])
    lengths = np.linalg.norm(robot.platform_joints - robot.base_joints - [[0, 0, 0.4]], axis=1)
    bounds = robot.limits["strut_length"]
    np.testing.assert_allclose(bounds.lower, np.min(lengths) - 0.05, atol=1e-6)
    np.testing.assert_allclose(bounds.upper, np.max(lengths) + 0.05, atol=1e-6)


@pytest.mark.parametrize(
    ("options", "key"),
    [
        (["--base-radius", "1"], "--base-half-angle"),
        (["--platform-half-angle", "10 deg"], "--platform-radius"),
        (["--base-radius", "1", "--base-half-angle", "9 deg"], "--platform-joints"),
        (["--base-radius", "1", "--base-half-angle", "70 deg"], "--base-half-angle"),
        (["--base-radius", "0", "--base-half-angle", "9 deg"], "--base-radius"),
        (["--platform-z", "1"], "--platform-z"),
        (["--base-joints", "1,2,3"], "--base-joints"),
        (["--platform-joints", "0,0,0; " * 6, *TOLD[:4]], "--platform-joints"),
        ([*TOLD[:8], "--home-height", "0"], "--home-height"),
        (["--stroke", "1"], "--stroke"),
        (["--mass", "1e-62 kg"], "--mass"),
        (["--mass", "1e12 kg"], "--mass"),
        ([*TOLD, "--stroke", "1"], "--stroke"),
        ([*TOLD[:12], "--stroke", "3 m"], "--stroke"),
        (["--strut-length", "0.9, 0.6"], "--strut-length"),
        (["--strut-length", "-0.1, 0.6"], "--strut-length[1]"),
        ([*TOLD[:12], "--strut-length", "0.1, 0.2"], "--strut-length"),
        ([*TOLD[:8], "--home-height", "3 m", "--strut-length", "0.6, 0.9"], "--home-height"),
        ([*TOLD[:8], "--strut-length", "200 mm, 250 mm"], "--strut-length"),
        ([*TOLD[:12], "--actuator-force", "1 N", "--mass", "1 t"], "--actuator-force"),
        (["--strut-speed", "fast"], "--strut-speed"),
        (["--mass", "-3 kg"], "--mass"),
        (["--drive", "belt"], "--drive"),
        (["--lead", "5 mm"], "--lead"),
        (["--drive", "gear", "--inertia", "1"], "--inertia"),
        (["--drive", "direct", "--inertia", "1"], "--inertia"),
        (["--force-std", "0"], "--force-std"),
    ],
)
def test_bad_input_is_told_by_its_option_and_writes_nothing(expdesign, tmp_path, options, key):
    status, out, _ = expdesign("init", "mine", "--json", *options)
    problems = json.loads(out)["problems"]
    assert status == 2
    assert key in [problem["key"] for problem in problems]
    assert list(tmp_path.iterdir()) == []


def test_heights_of_home_that_fit_are_stated(expdesign):
    lengths = ("--strut-length", "600 mm, 900 mm")
    status, _, err = expdesign("init", "mine", *TOLD[:8], *lengths, "--home-height", "3 m")
    low, high = re.search(r"allowed: ([\d.]+) m to ([\d.]+) m", " ".join(err.split())).groups()
    assert status == 2
    for height in (float(low) + 0.01, float(high) - 0.01):
        told = (*TOLD[:8], *lengths, "--home-height", f"{height} m")
        status, _, err = expdesign("init", f"mine{round(1e3 * height)}", *told)
        assert status == 0, err
    status, _, err = expdesign("init", "mine", *TOLD[:8], "--strut-length", "200 mm, 250 mm")
    assert "no height of home fits: struts of at most 0.25 m" in " ".join(err.split())
    assert "home lie elsewhere" not in err


def test_an_empty_name_is_refused(expdesign, tmp_path):
    status, _, err = expdesign("init", "")
    assert status == 2
    assert err.startswith("error: ")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["my robot", "../up", "x" * 101])
def test_a_name_has_to_be_one_of_a_file(expdesign, tmp_path, name):
    status, _, err = expdesign("init", name)
    assert status == 2
    assert err.startswith("error: NAME: ")
    assert list(tmp_path.iterdir()) == []


def test_files_are_not_written_over(expdesign, tmp_path):
    expdesign("init", "mine")
    before = (tmp_path / "mine.yaml").read_bytes()
    status, _, err = expdesign("init", "mine", *TOLD)
    assert status == 2
    assert "mine.yaml: the file is there already" in err
    assert (tmp_path / "mine.yaml").read_bytes() == before


def test_a_folder_that_is_none_is_refused(expdesign, tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    status, _, err = expdesign("init", "mine", "--out", "file")
    assert status == 2
    assert "--out: cannot write there" in err


def test_a_terminal_is_asked_for_what_is_not_given(expdesign, answers):
    asked = answers(
        base_radius="450 mm",
        base_half_angle=["", "8 kg", "8 deg"],  # needed, wrong, right
        platform_radius="250 mm",
        platform_half_angle="12 deg",
        home_height="650 mm",
        drive="screw",
        lead="5 mm",
    )
    status, _, err = expdesign("init", "mine", "--mass", "64 kg")
    assert status == 0, err
    assert "'8 kg' is a mass, not an angle" in err
    assert asked.count("base_half_angle") == 3
    assert "mass" not in asked
    assert asked[-2:] == ["lead", "inertia"]
    robot = load_run("mine-run.yaml").robot
    np.testing.assert_allclose(np.linalg.norm(robot.base_joints, axis=1), 0.45)
    assert robot.home[2] == 0.65


@pytest.mark.parametrize(
    ("key", "text", "said"),
    [
        ("base_radius", "1e200 m", "1e+200 m is not plausible for a machine"),
        ("base_radius", "1e-200", "1e-200 m is not plausible for a machine"),
        ("base_radius", "720 m", "720 m is not plausible for a machine"),
        ("base_radius", "720", "720 without a unit is 720 m"),
        ("base_half_angle", "7", "7 without a unit is 7 rad"),
        ("base_joints", "450,0,0;" * 6, "450 without a unit is 450 m"),
        ("platform_z", "-300", "-300 without a unit is -300 m"),
        ("home_height", "300", "300 without a unit is 300 m"),
        ("strut_length", "600, 900", "600 without a unit is 600 m"),
        ("stroke", "1e300 m", "1e+300 m is not plausible for a machine"),
        ("strut_speed", "200 m/s", "200 m/s is not plausible for a machine"),
        ("strut_speed", "300", "300 without a unit is 300 m/s"),
        ("strut_acceleration", "1e200", "1e+200 m/s^2 is not plausible for a machine"),
        ("actuator_force", "1e-200 N", "1e-200 N is not plausible for a machine"),
        ("lead", "1e-200 mm", "1e-203 m is not plausible for a machine"),
        ("lead", "5", "5 without a unit is 5 m"),
        ("inertia", "1e200", "1e+200 kg m^2 is not plausible for a machine"),
        ("force_std", "1e200", "1e+200 N is not plausible for a machine"),
        ("length_std", "5", "5 without a unit is 5 m"),
    ],
)
def test_values_of_no_machine_are_refused(expdesign, tmp_path, key, text, said):
    status, _, err = expdesign("init", "mine", f"--{key.replace('_', '-')}={text}")
    assert status == 2
    assert f"--{key.replace('_', '-')}" in err
    assert said in err
    assert list(tmp_path.iterdir()) == []


def test_a_number_without_a_unit_is_confirmed(expdesign, answers, monkeypatch):
    answers(
        base_radius="720",
        base_half_angle=["7", "8"],
        platform_radius="250 mm",
        platform_half_angle="12 deg",
        home_height="650 mm",
    )
    questions, replies = [], [True, False, True]
    monkeypatch.setattr(
        init.typer, "confirm", lambda text, **_: questions.append(text.strip()) or replies.pop(0)
    )
    status, _, err = expdesign("init", "mine")
    assert status == 0, err
    assert questions == ["720 mm?", "7 deg?", "8 deg?"]
    robot = load_run("mine-run.yaml").robot
    np.testing.assert_allclose(np.linalg.norm(robot.base_joints, axis=1), 0.72)


def test_nothing_is_asked_for_files_that_exist(expdesign, answers):
    asked = answers()
    expdesign("init", "mine")
    asked.clear()
    status, _, err = expdesign("init", "mine")
    assert status == 2
    assert "the file is there already" in err
    assert asked == []


def test_answers_that_contradict_are_asked_for_again(expdesign, answers):
    circles = {
        "base_radius": "450 mm",
        "base_half_angle": "8 deg",
        "platform_radius": "250 mm",
        "platform_half_angle": "12 deg",
        "home_height": "700 mm",
    }
    asked = answers(**circles)
    options = ("--stroke", "3 m", "--mass", "64 kg")
    assert expdesign("init", "mine", *options, "--json")[0] == 2  # it needs the joints
    status, _, err = expdesign("init", "mine", *options)
    assert status == 0, err
    assert "the struts have" in err
    assert asked.count("stroke") == 1
    assert asked.count("base_radius") == 1


def test_answers_are_kept_when_the_command_ends(expdesign, answers, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("FORCE_COLOR", "1")
    answers(actuator_force="2 kN", strut_length="600 mm, 900 mm")
    status, _, err = expdesign("init", "mine", "--platform-joints", "0.1,0,0;" * 6)
    assert status == 2
    err = re.sub(r"\x1b\[[\d;]*m", "", err)
    # The command is one line, so that it can be pasted.
    (line,) = re.findall("the answers so far: expdesign init mine .*", err)
    assert "--strut-length '600 mm, 900 mm'" in line
    assert "--platform-joints '0.1, 0, 0; " in line


def test_empty_answers_leave_everything_open(expdesign, answers):
    asked = answers()
    status, _, err = expdesign("init", "mine")
    assert status == 0, err
    assert not {"base_half_angle", "platform_radius", "lead"} & set(asked)
    warnings = load_run("mine-run.yaml").warnings
    assert all(text.startswith("assumed, to be checked") for text in warnings)


def test_a_file_of_a_controller_is_taken_and_overridden(expdesign, tmp_path):
    source = MACHINES / "h811.yaml"
    status, out, err = expdesign("init", "mine", "--from", source, "--mass", "5 kg", "--json")
    assert (status, err) == (0, "")
    assert not {"base_joints", "platform_joints"} & set(json.loads(out)["assumed"])
    known = read_machine("mine", [source])
    robot = load_run("mine-run.yaml").robot
    np.testing.assert_array_equal(robot.base_joints, points(known.base_joints))
    assert robot.parameters["p10"] == pytest.approx(5 * (1 + 6 * 0.04))


def test_a_terminal_is_not_asked_for_what_a_file_says(expdesign, answers):
    asked = answers()
    status, _, err = expdesign("init", "mine", "--from", MACHINES / "h811.yaml")
    assert status == 0, err
    assert "mass" in asked
    assert not {"base_radius", "platform_radius"} & set(asked)


def test_a_file_of_no_machine_is_refused(expdesign, tmp_path):
    (tmp_path / "notes.txt").write_text("hexapod", encoding="utf-8")
    status, _, err = expdesign("init", "mine", "--from", "notes.txt")
    assert status == 2
    assert err.startswith("error: notes.txt: ")
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
