"""LinuxCNC's INI and HAL files of a hexapod."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from expdesign.configuration import InputError, load_run
from expdesign.machines.importing import read_machine
from expdesign.machines.writing import write_files
from expdesign.robot import robot_from
from tests.machines.machines_of import FOLDER, asked, fixed_axes, lengths, moving_axes

SAMPLE = Path(
    "/usr/share/doc/linuxcnc/examples/sample-configs/sim/axis/vismach/hexapod-sim/hexapod.ini"
)
MM = 1e-3
# As they stand in mill.hal; genhexkins adds the spindle offset of 30 mm to z of both.
BASE_4 = (-267.652, -297.258, 1.5)
PLATFORM_0 = (106.066, -106.066, -2.0)
SPINDLE = np.array([0, 0, 30.0])


@pytest.fixture(scope="module")
def mill():
    return read_machine("mill", [FOLDER / "mill.ini"])


def changed(folder, old, new, file="mill.ini"):
    for name in ("mill.ini", "mill.hal"):
        shutil.copy(FOLDER / name, folder)
    path = folder / file
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    return folder / "mill.ini"


def test_the_joints_are_those_of_the_hal_file(mill):
    np.testing.assert_allclose(mill.base_joints[4], (np.array(BASE_4) + SPINDLE) * MM, atol=1e-15)
    np.testing.assert_allclose(
        mill.platform_joints[0], (np.array(PLATFORM_0) + SPINDLE) * MM, atol=1e-15
    )
    assert mill.alpha_axes[1] == (-0.207912, 0.978148, 0.0)


def _pins():
    text = (FOLDER / "mill.hal").read_text()
    pins = {
        words[1].removeprefix("genhexkins."): words[-1]
        for line in text.splitlines()
        if (words := line.split("#")[0].replace("=", " ").split())[:1] == ["setp"]
    }
    kinds = ("base", "platform", "base-n", "platform-n")
    return [
        np.array([[float(pins[f"{kind}.{j}.{k}"]) for k in "xyz"] for j in range(6)])
        for kind in kinds
    ]


def _poses(count=20):
    rng = np.random.default_rng(3)
    for _ in range(count):
        position, angles = np.add([0, 0, 620], rng.uniform(-40, 40, 3)), rng.uniform(-20, 20, 3)
        turned = fixed_axes(angles, degrees=True)
        yield position, turned, np.array([*position * MM, *moving_axes(turned)])


def test_distances_of_joints_are_those_of_the_controller_in_millimetres_and_degrees(mill):
    base, platform, *_ = _pins()
    for position, turned, pose in _poses():
        ends = position + turned.apply(platform + SPINDLE) - base - SPINDLE
        expected = np.linalg.norm(ends, axis=1)
        np.testing.assert_allclose(lengths(mill, pose), expected * MM, rtol=0, atol=1e-12)


def _corrections(position, turned, base, platform, base_axes, platform_axes, lead):
    """Return what genhexkins adds to the lengths: its StrutLengthCorrection, written anew."""
    struts = position + turned.apply(platform) - base
    u = struts / np.linalg.norm(struts, axis=1, keepdims=True)
    third = np.cross(u, np.cross(base_axes, u))
    second = np.cross(turned.apply(platform_axes), u)
    third, second = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (third, second))
    return lead * np.arcsin(np.sum(third * second, axis=1)) / (2 * np.pi)


@pytest.mark.parametrize(("sense", "lead"), [(1, "5.0"), (-1, "5.0"), (1, "-4.0")])
def test_lengths_are_corrected_for_the_turn_of_the_screws_as_the_controller_does(
    sense, lead, tmp_path
):
    ini = changed(tmp_path, "LEAD = 5.0", f"LEAD = {lead}")
    base, platform, base_axes, platform_axes = _pins()
    text = (tmp_path / "mill.hal").read_text()
    for j in range(6):
        for k, letter in enumerate("xyz"):
            line = f"setp genhexkins.platform-n.{j}.{letter} "
            text += f"{line}{sense * platform_axes[j, k]}\n"
    (tmp_path / "mill.hal").write_text(text)
    machine = read_machine("mill", [ini])
    assert machine.drive.screw.thread == ("right" if sense * float(lead) > 0 else "left")
    assert machine.drive.screw.lead == pytest.approx(abs(float(lead)) * MM)
    files = write_files(machine, tmp_path)
    robot = robot_from(load_run(files.run).robot)
    largest = 0.0
    for position, turned, pose in _poses():
        added = _corrections(
            position,
            turned,
            base + SPINDLE,
            platform + SPINDLE,
            base_axes,
            sense * platform_axes,
            float(lead),
        )
        expected = lengths(machine, pose) + added * MM
        np.testing.assert_allclose(robot.inverse_kinematics(pose), expected, rtol=0, atol=1e-12)
        largest = max(largest, np.abs(added).max())
    assert largest > 0.1


def test_axes_of_another_sense_in_one_strut_are_asked_for(tmp_path):
    file = changed(tmp_path, "platform-n.2.x 0.951057", "platform-n.2.x -0.951057", "mill.hal")
    text = (tmp_path / "mill.hal").read_text()
    (tmp_path / "mill.hal").write_text(text.replace("platform-n.2.y 0.3", "platform-n.2.y -0.3"))
    machine = read_machine("mill", [file])
    assert machine.platform_cardan_axes is None
    assert machine.drive.screw.lead == pytest.approx(5e-3)
    assert "drive" in asked(machine)


def test_a_screw_without_lines_of_its_axes_has_those_that_are_built_in(tmp_path):
    file = changed(tmp_path, "setp genhexkins.platform-n.4.z 0.1\n", "", "mill.hal")
    machine = read_machine("mill", [file])
    assert [axis[2] for axis in machine.platform_cardan_axes] == [0.1] * 4 + [0, 0.1]
    assert "platform_cardan_axes" in asked(machine)


def test_home_is_a_pose_about_moving_axes(mill):
    expected = moving_axes(fixed_axes([2, -3, 4], degrees=True))
    np.testing.assert_allclose(mill.home, [0.005, -0.01, 0.62, *expected], rtol=0, atol=1e-15)


def test_limits_are_in_si_units_and_per_joint_where_they_differ(mill):
    assert mill.limits["strut_length"][4:] == ((0.5, 0.8), (0.5, 0.81))
    assert mill.limits["strut_speed"] == (0.04,) * 5 + (0.035,)
    assert mill.limits["strut_acceleration"] == 0.25


def test_a_placeholder_is_no_limit(mill, tmp_path):
    assert mill.limits["position"] == {"x": (-0.12, 0.12)}
    assert "limits.strut_length" not in asked(mill)
    for low, high in ((-1000, 1000), (-1e99, 1e99), (500, 1e6)):
        file = changed(
            tmp_path, "MIN_LIMIT = 500\nMAX_LIMIT = 800", f"MIN_LIMIT = {low}\nMAX_LIMIT = {high}"
        )
        machine = read_machine("mill", [file])
        assert "strut_length" not in machine.limits
        assert "limits.strut_length" in asked(machine)


def test_what_the_robot_file_cannot_say_is_a_question(mill):
    assert {"drive", "platform_cardan_axes", "limits.rotation", "platform_joints"} <= asked(mill)


def test_a_home_that_the_joints_contradict_is_a_question(mill, tmp_path):
    length = lengths(mill, mill.home) / MM
    for error, there in ((0, False), (9, True)):
        joints = "".join(f"[JOINT_{j}]\nHOME = {length[j] + error:.3f}\n" for j in range(6))
        file = changed(tmp_path, "[AXIS_X]", joints + "[AXIS_X]")
        assert ("home" in asked(read_machine("mill", [file]))) == there


@pytest.mark.parametrize(
    ("unit", "metres"),
    [("inch", 0.0254), ("imperial", 0.0254), ("metric", 1e-3), ("0.03937007874015748", 0.0254)],
)
def test_units_of_length(unit, metres, tmp_path):
    file = changed(tmp_path, "LINEAR_UNITS = mm", f"LINEAR_UNITS = {unit}")
    machine = read_machine("mill", [file])
    assert machine.base_joints[0][0] == pytest.approx(391.259 * metres, rel=1e-12)


def test_files_that_are_named_are_the_ones_that_count(tmp_path):
    for name in ("mill.ini", "mill.hal"):
        shutil.copy(FOLDER / name, tmp_path)
    other = tmp_path / "other.hal"
    other.write_text("setp genhexkins.base.0.x 390\n")
    files = [tmp_path / "mill.ini", tmp_path / "mill.hal", other]
    assert read_machine("mill", files).base_joints[0][0] == 0.39
    # Alone, the other coordinates are what genhexkins has built in.
    alone = read_machine("mill", [files[0], other])
    assert alone.base_joints[1] == (0.02295, 0.01325, 0.0)
    assert {"base_joints", "platform_joints"} <= asked(alone)


@pytest.mark.parametrize(
    ("old", "new", "file", "key"),
    [
        ("LINEAR_UNITS = mm", "LINEAR_UNITS = furlong", "mill.ini", "[TRAJ]LINEAR_UNITS"),
        ("LINEAR_UNITS = mm", "LINEAR_UNITS = 0", "mill.ini", "[TRAJ]LINEAR_UNITS"),
        ("LINEAR_UNITS = mm", "", "mill.ini", "[TRAJ]LINEAR_UNITS"),
        ("genhexkins sparm", "trivkins sparm", "mill.ini", "[KINS]KINEMATICS"),
        ("ANGULAR_UNITS = degree", "ANGULAR_UNITS = gon", "mill.ini", "[TRAJ]ANGULAR_UNITS"),
        ("HOME = 5", "HOME = five", "mill.ini", "[TRAJ]HOME"),
        ("HOME = 5", "HOME = 1 2 5", "mill.ini", "[TRAJ]HOME"),
        ("MAX_LIMIT = 810", "MAX_LIMIT = 81", "mill.ini", "[JOINT_5]MIN_LIMIT"),
        ("MIN_LIMIT = -120", "MIN_LIMIT = 120", "mill.ini", "[AXIS_X]MIN_LIMIT"),
        ("MAX_VELOCITY = 35", "MAX_VELOCITY = -35", "mill.ini", "[JOINT_5]MAX_VELOCITY"),
        ("LEAD = 5.0", "LEAD = nan", "mill.ini", "[SCREW]LEAD"),
        ("LEAD = 5.0", "OTHER = 5.0", "mill.hal", "genhexkins.screw-lead"),
        ("x 391.259", "x 391,259", "mill.hal", "genhexkins.base.0.x"),
        ("base.0.x 391.259", "base.0.x", "mill.hal", "genhexkins.base.0.x"),
        ("[TRAJ]", "TRAJ", "mill.ini", ""),
    ],
)
def test_what_is_wrong_is_told_with_its_place(old, new, file, key, tmp_path):
    edited = "mill.ini" if old == "LEAD = 5.0" else file
    with pytest.raises(InputError) as caught:
        read_machine("mill", [changed(tmp_path, old, new, edited)])
    (problem,) = caught.value.problems
    assert problem.file.name == file
    assert problem.key == key
    if new:
        assert problem.line is not None


@pytest.mark.parametrize(
    "content",
    [b"", b"\0\1\2", b"[TRAJ\nLINEAR_UNITS = mm", b"\xff\xfe", b"[TRAJ]\nLINEAR_UNITS = mm\n"],
)
def test_a_file_that_describes_no_hexapod_is_refused(content, tmp_path):
    file = tmp_path / "damaged.ini"
    file.write_bytes(content)
    with pytest.raises(InputError):
        read_machine("damaged", [file])


def test_a_hal_file_needs_its_ini_file():
    with pytest.raises(InputError):
        read_machine("mill", [FOLDER / "mill.hal"])


@pytest.mark.system("rs274")
@pytest.mark.skipif(not SAMPLE.is_file(), reason="LinuxCNC is there without its examples")
def test_the_configuration_that_linuxcnc_ships():
    machine = read_machine("hexapod", [SAMPLE])
    inch = 0.0254
    np.testing.assert_allclose(machine.base_joints[3], [0, -26.5 * inch, 0], atol=1e-12)
    np.testing.assert_allclose(
        machine.platform_joints[2], [10.459 * inch, -4.884 * inch, 0], atol=1e-12
    )
    # [JOINT_N]HOME of the same file; the coordinates have three decimals.
    np.testing.assert_allclose(
        lengths(machine, machine.home), np.full(6, 29.7466 * inch), atol=1e-3 * inch
    )
    assert machine.limits == {"strut_speed": 20 * inch, "strut_acceleration": 200 * inch}
    assert {"limits.strut_length", "limits.position"} <= asked(machine)


def _split(folder, line="source joints.hal"):
    """Move the joints of the mill into a file of their own, which a line executes."""
    ini = changed(folder, "", "")
    hal = folder / "mill.hal"
    lines = hal.read_text().splitlines(keepends=True)
    joints = [one for one in lines if "genhexkins.base." in one or "genhexkins.platform." in one]
    (folder / "joints.hal").write_text("".join(joints))
    hal.write_text("".join([one for one in lines if one not in joints] + [f"{line}\n"]))
    return ini


def test_a_file_that_a_hal_file_executes_is_read(mill, tmp_path):
    found = read_machine("mill", [_split(tmp_path)])
    assert found.base_joints == mill.base_joints
    assert found.platform_joints == mill.platform_joints


def test_a_missing_source_and_one_that_executes_itself_are_refused(tmp_path):
    ini = _split(tmp_path, "source elsewhere.hal")
    with pytest.raises(InputError, match=r"'elsewhere.hal' is not here"):
        read_machine("mill", [ini])
    hal = tmp_path / "mill.hal"
    hal.write_text(hal.read_text().replace("source elsewhere.hal", "source mill.hal"))
    with pytest.raises(InputError, match="executes itself"):
        read_machine("mill", [ini])


def test_halcmd_counts_after_the_files(mill, tmp_path):
    line = "HALFILE = mill.hal\nHALCMD = setp genhexkins.platform.0.x 107.5"
    found = read_machine("mill", [changed(tmp_path, "HALFILE = mill.hal", line)])
    assert found.platform_joints[0][0] == 0.1075
    assert found.platform_joints[1:] == mill.platform_joints[1:]


def test_joints_and_screws_may_be_in_the_ini_file(mill, tmp_path):
    lines = (FOLDER / "mill.hal").read_text().splitlines()
    commands = "\n".join(f"HALCMD = {line}" for line in lines if line.startswith("setp"))
    (tmp_path / "mill.ini").write_text(
        (FOLDER / "mill.ini").read_text().replace("HALFILE = mill.hal", commands)
    )
    found = read_machine("mill", [tmp_path / "mill.ini"])
    for name in ("base_joints", "platform_joints", "drive", "alpha_axes", "home", "limits"):
        assert getattr(found, name) == getattr(mill, name)


@pytest.mark.parametrize(
    "line", ["loadusr -w halcmd -f more.hal", "alias pin genhexkins.base.0.x left"]
)
def test_what_may_set_pins_elsewhere_is_refused_by_name(line, tmp_path):
    ini = changed(tmp_path, "loadrt motmod", f"{line}\nloadrt motmod", "mill.hal")
    with pytest.raises(InputError, match=line.split()[-1]):
        read_machine("mill", [ini])


def test_tcl_that_names_pins_is_refused_and_missing_files_are_asked_for(tmp_path):
    ini = changed(tmp_path, "HALFILE = mill.hal", "HALFILE = mill.hal\nHALFILE = more.hal")
    texts = [one.text for one in read_machine("mill", [ini]).questions if not one.key]
    assert [text.split(" is not read")[0] for text in texts] == [
        "[HAL]HALFILE = more.hal",
        "[HAL]HALFILE = elsewhere.tcl",
    ]
    (tmp_path / "elsewhere.tcl").write_text("setp genhexkins.base.0.x 400\n")
    with pytest.raises(InputError, match=r"elsewhere.tcl names pins of genhexkins"):
        read_machine("mill", [ini])


def test_joints_with_some_coordinates_built_in_are_asked_for_at_the_top(tmp_path):
    ini = changed(tmp_path, "setp genhexkins.platform.3.z  -2 # below the plate\n", "", "mill.hal")
    (found,) = [one.text for one in read_machine("mill", [ini]).questions if "mix" in one.text]
    assert "joints 3 of platform" in found


def test_a_platform_much_smaller_than_the_base_is_doubted(tmp_path):
    ini = changed(tmp_path, "", "")
    hal = tmp_path / "mill.hal"
    lines = hal.read_text().splitlines(keepends=True)
    hal.write_text("".join(one for one in lines if "genhexkins.platform." not in one))
    text = hal.read_text().replace("391.259", "1391.259")
    hal.write_text(text)
    machine = read_machine("mill", [ini])
    assert any("are all of them set" in one.text for one in machine.questions if not one.key)
    (tmp_path / "robots").mkdir()
    texts = write_files(machine, tmp_path / "robots").robot.read_text()
    assert texts.index("are all of them set") < texts.index("base_joints:")


def test_the_run_file_proposes_g_code_with_the_limits_of_the_planner(tmp_path):
    axes = "".join(
        f"[AXIS_{letter}]\nMAX_VELOCITY = {speed}\nMAX_ACCELERATION = 900\n"
        for letter, speed in zip("XYZABC", (50, 50, 40, 30, 30, 30), strict=True)
    )
    more = f"{axes}[EMCMOT]\nSERVO_PERIOD = 500000\n[SCREW]"
    ini = changed(tmp_path, "[SCREW]", more)
    text = ini.read_text()
    ini.write_text(text.replace("HOME = 5", "MAX_LINEAR_VELOCITY = 60\nHOME = 5"))
    (tmp_path / "run").mkdir()
    run = write_files(read_machine("mill", [ini]), tmp_path / "run").run
    found = [line for line in run.read_text().splitlines() if line.startswith("# export: ")]
    run.write_text(run.read_text().replace(found[0], found[0].removeprefix("# ")))
    (section,) = load_run(run).run.export
    assert section.servo_period == pytest.approx(5e-4)
    np.testing.assert_allclose(section.linear_speed, [0.05, 0.05, 0.04], rtol=1e-12)
    np.testing.assert_allclose(section.angular_speed, np.radians([30] * 3), rtol=1e-12)
    np.testing.assert_allclose(section.linear_acceleration, [0.9] * 3, rtol=1e-12)
    np.testing.assert_allclose(section.angular_acceleration, np.radians([900] * 3), rtol=1e-12)
    assert section.path_speed == pytest.approx(0.06)
