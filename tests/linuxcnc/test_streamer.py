"""The strut table in the real HAL of LinuxCNC, by the commands that its README prints."""

import re

import numpy as np
import pytest

from expdesign.configuration import export_section
from expdesign.export.exporting import export_table
from expdesign.export.result import exported_table
from expdesign.machines.genhexkins import setp_lines
from tests.linuxcnc.machine import run_linuxcnc
from tests.linuxcnc.test_planner import motion

DRIVE = "halcmd net drive-{0} table-cmd-{0}.out table-fb-{0}.in0"
"""A drive that is where it is commanded to be."""
BODY = """
def shell(words):
    print(subprocess.run(words, shell=True, check=True, capture_output=True, text=True).stdout)

subprocess.Popen({feed!r}.removesuffix("&"), shell=True)
time.sleep(0.3)
shell("echo depth $({depth})")
shell({start!r})
time.sleep({seconds})
shell("echo played $({played})")
for words in {afterwards!r}:
    shell(words)
shell("halcmd sets table-run 1")
time.sleep(0.1)
shell("echo runs $(halcmd gets table-on)")
command.state(linuxcnc.STATE_ESTOP); command.wait_complete()
time.sleep(0.1)
shell("echo allowed $(halcmd gets table-on)")
command.state(linuxcnc.STATE_ESTOP_RESET); command.wait_complete()
command.state(linuxcnc.STATE_ON); command.wait_complete()
time.sleep(0.1)
shell("echo again $(halcmd gets table-on)")
"""
LIMITS = {
    "SERVO_PERIOD": ["1000000"],
    "MAX_VELOCITY": ["1000"] * 6,
    "MAX_ACCELERATION": ["1000"] * 6,
}


def commands(guide, heading):
    """Return the commands that a guide prints under a heading."""
    part = re.search(rf"^{heading}\n~+\n(.*?)(?=^~|\Z)", guide, re.M | re.S)[1]
    return re.findall(r"^    (\S.*)$", part, re.M)


@pytest.mark.system("linuxcnc")
def test_the_printed_commands_play_every_row_from_the_measured_position_on(tmp_path):
    work = motion(1.0, 0.05, 2.0)
    made = export_table(
        export_section(format="linuxcnc-strut", tolerance="50 um"), work, tmp_path / "table.txt"
    )
    guide = exported_table(made).guide
    rows = np.array(
        [row.split() for row in made.path.read_text().splitlines() if row[0] != "#"], dtype=float
    )
    (loading,) = commands(guide, "Before you start")
    feed, depth = commands(guide, "Load")
    start, played, stop = commands(guide, "Run")
    drives = [DRIVE.format(joint) for joint in range(6)]
    drives += [f"halcmd net drive-{joint} sampler.0.pin.{joint}" for joint in range(6)]
    samples, text = run_linuxcnc(
        work.robot,
        LIMITS,
        "\n".join(setp_lines(work.robot.description, "mm")),
        [],
        BODY.format(
            feed=feed,
            depth=depth,
            start=start,
            played=played,
            seconds=len(rows) * 1e-3 + 1.0,
            afterwards=[stop, *commands(guide, "Afterwards")],
        ),
        tmp_path,
        first=[loading, *drives],
    )
    assert f"depth {min(len(rows), 3999)}" in text
    assert float(re.search(r"played (\S+)", text)[1]) == pytest.approx(len(rows))
    # The emergency stop ends the table, and switching the machine on does not go on with it.
    assert "runs TRUE" in text
    assert "allowed FALSE" in text
    assert "again FALSE" in text
    # The motors count from where they were homed. Nothing moves before the first row.
    held = np.zeros(6)
    np.testing.assert_allclose(samples[0], held, rtol=0, atol=2e-6)
    moved = np.flatnonzero(np.abs(samples - held).max(axis=1) > 4e-6)
    begin = moved[0] - np.flatnonzero(np.abs(rows - rows[0]).max(axis=1) > 4e-6)[0]
    table = samples[begin : begin + len(rows)]
    np.testing.assert_allclose(table - held, rows - rows[0], rtol=0, atol=4e-6)
    np.testing.assert_allclose(samples[begin + len(rows) :] - held, 0, atol=4e-6)
