"""LinuxCNC's own interpreter reads the G-code."""

import re
import subprocess
from dataclasses import replace

import numpy as np
import pytest

from expdesign.configuration import export_section
from expdesign.export.exporting import export_table
from tests.export.motions import CASES, task
from tests.export.reading import planned_times
from tests.export.test_formats import fixed_axes
from tests.linuxcnc.test_planner import HEXAPODS, motion

PRINTED = re.compile(r"STRAIGHT_FEED\(([^)]*)\)")
FEED = re.compile(r"SET_FEED_MODE\(0, 1\)|inverse time")
UNIT = np.repeat([1e3, 180 / np.pi], 3)
# It prints four decimals of what has six.
HALF = 0.5e-4 + 0.5e-6


def interpret(file, folder):
    for name in ("t.tbl", "t.var"):
        (folder / name).write_text("")
    return subprocess.run(
        ["rs274", "-g", "-t", folder / "t.tbl", "-v", folder / "t.var", file],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.system("rs274")
@pytest.mark.parametrize("case", CASES, ids=str)
def test_it_goes_to_the_poses_of_the_design(case, tmp_path):
    work = task(*case)
    asked = export_section(format="linuxcnc-gcode")
    made = export_table(asked, work, tmp_path / "file.ngc")
    done = interpret(made.path, tmp_path)
    assert done.returncode == 0, done.stderr
    assert FEED.search(done.stdout)
    found = [[float(v) for v in words.split(",")] for words in PRINTED.findall(done.stdout)]
    # A move to where the machine is already is printed as well.
    assert len(found) == made.check.rows
    feeds = re.findall(r"^G1 .* F(\S+)$", made.path.read_text(), re.M)
    times = planned_times(np.array(feeds[1:], dtype=float))
    wanted = fixed_axes(work.motion.sample(times).pose) * UNIT
    assert np.abs(np.array(found) - wanted).max() <= HALF


@pytest.mark.system("rs274")
def test_it_refuses_a_move_without_its_time(tmp_path):
    work = task()
    asked = export_section(format="linuxcnc-gcode")
    made = export_table(asked, work, tmp_path / "file.ngc")
    lines = made.path.read_text().splitlines()
    lines[20] = lines[20].partition(" F")[0]
    made.path.write_text("\n".join(lines) + "\n")
    done = interpret(made.path, tmp_path)
    assert "F word missing" in done.stdout + done.stderr


@pytest.mark.system("rs274")
def test_it_repeats_the_period_as_the_whole_program_does(tmp_path):
    work = motion(*HEXAPODS["linuxcnc"])
    work = replace(work, motion=work.motion.with_periods(4))
    printed = []
    for repeat in ("file", "controller"):
        section = export_section(format="linuxcnc-gcode", repeat=repeat)
        made = export_table(section, work, tmp_path / "file.ngc")
        done = interpret(made.path, tmp_path)
        assert done.returncode == 0, done.stderr
        printed.append(re.findall(r"(?:STRAIGHT|SET)_FEED\w*\([^)]*\)", done.stdout))
    assert len(PRINTED.findall("\n".join(printed[1]))) == made.check.rows
    assert printed[0] == printed[1]
