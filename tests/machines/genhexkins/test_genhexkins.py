"""Lengths and poses against LinuxCNC's own kinematics, for machines that are read and exported."""

import numpy as np
import pytest

from expdesign.configuration import export_section, load_run
from expdesign.configuration.geometry import geometry_at
from expdesign.export.exporting import export_table
from expdesign.machines.genhexkins import screw_turns, setp_lines, turn_errors
from expdesign.machines.importing import read_machine
from expdesign.machines.writing import write_files
from expdesign.robot import robot_from
from tests.export.motions import task
from tests.export.reading import gcode
from tests.machines.genhexkins.module import Genhexkins
from tests.machines.machines_of import FOLDER, fixed_axes, moving_axes

pytestmark = pytest.mark.system("rs274", "cc")

POSES = 1000
NANOMETRE = 1e-9


# A process cannot load it twice: the second one would find the pins of the first.
@pytest.fixture(scope="session")
def genhexkins(tmp_path_factory):
    return Genhexkins(tmp_path_factory.mktemp("genhexkins"))


def _imported(folder, unit, lead):
    """Return the robot of a HAL and INI file in a unit, and the lines that the controller reads."""
    ini = (FOLDER / "mill.ini").read_text().replace("LINEAR_UNITS = mm", f"LINEAR_UNITS = {unit}")
    hal = (FOLDER / "mill.hal").read_text().replace("[SCREW]LEAD", lead)
    files = folder / "mill.ini", folder / "mill.hal"
    for path, text in zip(files, (ini, hal), strict=True):
        path.write_text(text)
    written = write_files(read_machine("mill", files), folder)
    return robot_from(load_run(written.run).robot), hal.splitlines()


def _poses(robot, metres):
    """Return random poses of a robot, (N, 6) in SI, and as the controller has them."""
    rng = np.random.default_rng(1)
    place = robot.home[:3] + rng.uniform(-0.05, 0.05, (POSES, 3))
    turned = fixed_axes(rng.uniform(-20, 20, (POSES, 3)), degrees=True)
    controller = np.hstack([place / metres, turned.as_euler("xyz", degrees=True)])
    return np.hstack([place, moving_axes(turned)]), controller


def test_a_screw_turns_by_a_part_of_its_lead(genhexkins, tmp_path):
    robot, lines = _imported(tmp_path, "mm", "5")
    _, controller = _poses(robot, 1e-3)
    genhexkins.set(lines)
    turned = genhexkins.lengths(controller)
    genhexkins.set(["setp genhexkins.screw-lead 0"])
    assert 0.1 < np.abs(turned - genhexkins.lengths(controller)).max() < 2.5  # mm


@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("inch", 0.0254)])
@pytest.mark.parametrize("lead", ["0", "5", "-4"])
def test_lengths_and_poses_of_an_imported_machine(unit, metres, lead, genhexkins, tmp_path):
    robot, lines = _imported(tmp_path, unit, lead)
    genhexkins.set(lines)
    poses, controller = _poses(robot, metres)
    lengths = genhexkins.lengths(controller)
    ours = robot.inverse_kinematics(poses)
    np.testing.assert_allclose(ours, lengths * metres, rtol=0, atol=NANOMETRE)
    # Its own lines, with the axes in a sense of their own, say the same.
    genhexkins.set(["setp genhexkins.spindle-offset 0"])
    genhexkins.set(setp_lines(robot.description, "in" if unit == "inch" else unit))
    again = genhexkins.lengths(controller)
    np.testing.assert_allclose(again, lengths, rtol=0, atol=NANOMETRE / metres)
    # And back: both find the pose from the lengths, from 1 mm and 1 degree beside it.
    for pose, there, length in zip(poses[::20], controller[::20], lengths[::20], strict=True):
        beside = there + np.repeat([1e-3 / metres, 1.0], 3)
        found = genhexkins.pose(length, beside)
        assert not genhexkins.failed
        np.testing.assert_allclose(found[:3] * metres, pose[:3], rtol=0, atol=NANOMETRE)
        np.testing.assert_allclose(found[3:], there[3:], rtol=0, atol=1e-6)
        guess = pose + np.repeat([1e-3, 0.02], 3)
        again = robot.forward_kinematics(length * metres, guess=guess)
        np.testing.assert_allclose(again, pose, rtol=0, atol=10 * NANOMETRE)


@pytest.mark.parametrize(("unit", "metres"), [(None, 1e-3), ("in", 0.0254)])
def test_a_table_with_its_geometry_moves_the_struts_as_designed(unit, metres, genhexkins, tmp_path):
    work = task()
    asked = export_section(format="linuxcnc-gcode", units=unit, digits=9)
    made = export_table(asked, work, tmp_path / "table.ngc")
    genhexkins.set(["setp genhexkins.spindle-offset 0", "setp genhexkins.screw-lead 0"])
    genhexkins.set(made.companions[0].read_text().splitlines())
    times, rows, _ = gcode(made.path, None)
    designed = work.robot.inverse_kinematics(work.motion.sample(times).pose)
    lengths = genhexkins.lengths(rows) * metres
    np.testing.assert_allclose(lengths, designed, rtol=0, atol=NANOMETRE)


def test_corrections_are_those_of_its_source_and_ambiguous_axes_are_told(genhexkins, tmp_path):
    robot, lines = _imported(tmp_path, "mm", "5")
    # Platform axes a quarter turn about the struts from where they usually are.
    home = geometry_at(robot.home, robot.description.base_joints, robot.description.platform_joints)
    turned = np.cross(home.directions, robot.description.alpha_axes) @ home.rotation
    pins = [
        f"setp genhexkins.platform-n.{j}.{letter} {value:.12g}"
        for j, axis in enumerate(turned)
        for letter, value in zip("xyz", axis, strict=True)
    ]
    genhexkins.set(lines + pins)
    poses, controller = _poses(robot, 1e-3)
    lengths = genhexkins.lengths(controller) * 1e-3
    joints = robot.description.base_joints, robot.description.platform_joints
    axes = robot.description.alpha_axes, turned
    struts = [geometry_at(pose, *joints) for pose in poses]
    sines = [screw_turns(*axes, one)[0] for one in struts]
    ours = [one.lengths for one in struts] + 5e-3 / (2 * np.pi) * np.arcsin(sines)
    np.testing.assert_allclose(ours, lengths, rtol=0, atol=NANOMETRE)
    errors = turn_errors(5e-3, *axes, robot.home, poses, *joints)
    assert 0.2 < np.mean(errors.max(axis=1) > 1e-6) < 1.0
    assert 0.2e-3 < errors.max() < 2.5e-3
    # Of the axes that stand there, none is ambiguous.
    usual = robot.description.alpha_axes, -robot.description.platform_cardan_axes
    assert turn_errors(5e-3, *usual, robot.home, poses, *joints).max() == 0
