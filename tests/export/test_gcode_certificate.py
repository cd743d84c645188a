"""G-code for LinuxCNC: single servo cycles, pieces, absurd feeds, and the files for the machine."""

import re
from dataclasses import replace

import numpy as np
import pytest

from expdesign.configuration import export_section, load_run
from expdesign.export.certification import BROKEN, PROVED
from expdesign.export.definition import TableError
from expdesign.export.exporting import export_table, resolve_settings
from expdesign.export.formats.linuxcnc_gcode import planner_limits
from expdesign.export.result import exported_table
from expdesign.export.table_file import certify_file, read_table_file
from expdesign.robot import load_robot, robot_from
from tests.export.wrong_tables import work_of

FEED = re.compile(r" F(\S+)$")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    path = tmp_path_factory.mktemp("gcode") / "table.ngc"
    section = export_section(format="linuxcnc-gcode", servo_period="1 ms")
    return export_table(section, work_of("palida"), path)


def piece_of(made, folder, change):
    """Return a copy of a table with changed moves, read again."""
    lines = made.path.read_text().splitlines()
    path = folder / made.path.name
    path.write_text("\n".join([*lines[:3], *change(lines[3:-1]), "M2"]) + "\n")
    for file in made.companions:
        (folder / file.name).write_bytes(file.read_bytes())
    return read_table_file(path, made.settings)


@pytest.mark.parametrize("robot", ["palida", "linuxcnc"])
def test_the_axes_may_by_default_be_twice_as_fast_as_the_motion(robot):
    section = export_section(format="linuxcnc-gcode", servo_period="1 ms")
    settings = resolve_settings(section, work_of(robot))
    motion = settings.task.motion
    rate = np.abs(motion.sample(np.linspace(0, motion.duration, 2000)).rate)
    metre = 1e3 if settings.axes.units[0] == "mm" else 1.0
    fastest = [metre * np.max(rate[:, :3])] * 3
    velocity = planner_limits(settings).velocity
    # Rounded up to two digits.
    np.testing.assert_array_less(1.99 * np.array(fastest), velocity[:3])
    np.testing.assert_array_less(velocity[:3], 2.25 * np.array(fastest))


def test_forces_of_single_cycles_are_judged_without_a_limit_on_accelerations(made, tmp_path):
    mapping = load_robot("palida").description.description.model_dump(mode="json", by_alias=True)
    del mapping["limits"]["strut_acceleration"]
    robot = robot_from(load_run({"name": "n", "robot": mapping}).robot)
    assert robot.limit("strut_acceleration") is None
    task = replace(made.settings.task, robot=robot)
    table = piece_of(made, tmp_path, lambda moves: moves[: len(moves) // 2])
    settings = replace(made.settings, task=task)
    # The planner stops at the end of the piece.
    proof = certify_file(read_table_file(table.path, settings), piece=True)
    assert any(one.startswith("in single servo cycles actuator force") for one in proof.faults), (
        proof.faults
    )
    assert proof.verdict == BROKEN


def test_the_planner_takes_no_longer_for_a_piece(made, tmp_path):
    whole = piece_of(made, tmp_path, list)
    assert certify_file(whole, piece=True).verdict == PROVED
    short = piece_of(made, tmp_path, lambda moves: moves[:20])
    assert not any("takes" in fault for fault in certify_file(short, piece=True).faults)

    def hasten(moves):
        """Let rows of n cycles last n // 2: faster than the axes may accelerate."""

        def feed(old):
            return f" F{60e3 / (int(60e3 / float(old[1])) // 2 + 0.002):.6f}"

        return [moves[0], *(FEED.sub(feed, move) for move in moves[1:])]

    proof = certify_file(piece_of(made, tmp_path, hasten), piece=True)
    assert any("the controller takes" in fault for fault in proof.faults), proof.faults
    assert proof.verdict == BROKEN


@pytest.mark.parametrize("feed", ["0", "5e-324", "1e-310", "1e-9", "60000", "1e300", "1e999"])
def test_a_feed_of_no_whole_number_of_cycles_is_refused(feed, made, tmp_path):
    with pytest.raises(TableError, match=r"line \d+"):
        piece_of(made, tmp_path, lambda moves: [*moves[:9], FEED.sub(f" F{feed}", moves[9])])


def test_the_servo_period_of_the_check_is_that_of_the_ini_file(tmp_path):
    section = export_section(format="linuxcnc-gcode", servo_period=1e-3 / 3)
    made = export_table(section, work_of("palida"), tmp_path / "table.ngc")
    (stated,) = re.findall(r"SERVO_PERIOD = (\d+)", made.companions[1].read_text())
    assert made.check.controller.cycle == pytest.approx(1e-9 * int(stated), rel=1e-9)


def test_the_instructions_name_every_offset(made):
    guide = " ".join(exported_table(made).guide.split())
    for code in ("G54", "G92.1", "G49", "G53 G1"):
        assert code in guide
