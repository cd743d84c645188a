"""An output that a table switches: on when the measurement window begins, off when it ends."""

import re

import numpy as np
import pytest
from pydantic import ValidationError

from expdesign.configuration import export_section
from expdesign.export.exporting import export_table, file_name
from expdesign.export.read_back import read_back
from expdesign.export.result import exported_table
from tests.export.motions import task
from tests.export.test_rs274 import PRINTED, interpret

SECTIONS = {
    "linuxcnc-gcode": {"trigger": 3},
    "pmac-pvt": {"segment": "4 ms", "tolerance": "50 um", "trigger": 12},
    "xps-pvt": {"segment": "4 ms", "tolerance": "50 um", "trigger": 4},
}
COMMANDS = {"linuxcnc-gcode": ("M62 P3", "M63 P3"), "pmac-pvt": ("M12==1", "M12==0")}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Return a table of each format that switches an output."""
    folder = tmp_path_factory.mktemp("made")
    sections = [export_section(format=name, **options) for name, options in SECTIONS.items()]
    return {s.format: export_table(s, task(), folder / file_name(s)) for s in sections}


def _behind_moves(path, of_format):
    """Return the time at which each command takes effect, by the moves before it."""
    time, found = 0.0, {}
    moves = 0
    for line in path.read_text().splitlines():
        if of_format == "linuxcnc-gcode" and line.startswith("G1"):
            # The first move goes to where the machine stands.
            time += 60 / float(line.rpartition("F")[2]) if moves else 0.0
            moves += 1
        elif line.startswith("PVT"):
            time += float(line[3:]) / 1e3
        elif line in COMMANDS[of_format]:
            found[line] = time
    return tuple(found[command] for command in COMMANDS[of_format])


def _of_events(path):
    """Return when the elements begin that the events name: mask, then the value."""
    text = path.with_name("xps-pvt.events.txt").read_text()
    elements = [int(k) for k in re.findall(r"ElementNumberStart, (\d+), 0", text)]
    actions = re.findall(r"DOSet, (\d+), (\d+), 0, 0\)", text)
    assert actions == [("8", "8"), ("8", "0")]
    assert text.count("EventExtendedStart (int *)") == 2
    starts = np.concatenate([[0.0], np.cumsum(np.loadtxt(path, delimiter=",")[:, 0])])
    return tuple(starts[k - 1] for k in elements)


@pytest.mark.parametrize("name", SECTIONS)
def test_it_is_on_in_the_measurement_window(name, made):
    one = made[name]
    found = _of_events(one.path) if name == "xps-pvt" else _behind_moves(one.path, name)
    half = one.check.longest_step / 2 + 1e-6
    np.testing.assert_allclose(found, task().motion.window, rtol=0, atol=half)
    # LinuxCNC's planner reaches the rows some cycles earlier or later.
    planned = 10e-3 if name == "linuxcnc-gcode" else 1e-7
    np.testing.assert_allclose(one.check.trigger, found, rtol=0, atol=planned)
    entry = exported_table(one)
    assert entry.trigger == one.check.trigger
    assert f"{one.check.trigger[0]:.6f}" in entry.guide
    assert ("xps-pvt.events.txt" in entry.companions) == (name == "xps-pvt")


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_at_another_place_is_found(name, made, tmp_path):
    one = made[name]
    on, off = COMMANDS[name]
    lines = one.path.read_text().splitlines()
    late = [line for line in lines if line != on]
    late.insert(lines.index(on) + 8, on)
    turned = [{on: off, off: on}.get(line, line) for line in lines]
    gone = [line for line in lines if line not in (on, off)]
    for edited in (late, turned, gone, [line for line in lines if line != off]):
        path = tmp_path / one.path.name
        path.write_text("\n".join(edited) + "\n")
        assert any("switched" in failure for failure in read_back(path, one.settings).failures)


def test_events_of_another_element_are_found(made, tmp_path):
    one = made["xps-pvt"]
    path = tmp_path / one.path.name
    path.write_bytes(one.path.read_bytes())
    (failure,) = read_back(path, one.settings).failures
    assert "not switched" in failure
    text = one.path.with_name("xps-pvt.events.txt").read_text()
    element = re.search(r"Start, (\d+)", text)[1]
    for old, new in ((element, str(int(element) + 2)), ("8, 8,", "8, 0,"), ("GPIO1", "GPIO2")):
        path.with_name("xps-pvt.events.txt").write_text(text.replace(old, new))
        assert read_back(path, one.settings).failures


def test_a_table_without_trigger_takes_the_events_of_the_one_before_away(tmp_path):
    path = tmp_path / "table.trj"
    options = SECTIONS["xps-pvt"]
    export_table(export_section(format="xps-pvt", **options), task(), path)
    assert path.with_name("table.events.txt").is_file()
    made = export_table(
        export_section(format="xps-pvt", **options | {"trigger": None}), task(), path
    )
    assert [file.name for file in tmp_path.iterdir()] == ["table.trj"]
    assert made.check.trigger is None
    assert made.companions == ()


@pytest.mark.parametrize(
    ("name", "number"),
    [("linuxcnc-gcode", 64), ("pmac-pvt", 8192), ("xps-pvt", 0), ("xps-pvt", 9), ("csv", 1)],
)
def test_an_output_that_the_controller_does_not_have(name, number):
    with pytest.raises(ValidationError, match=r"output|trigger"):
        export_section(format=name, trigger=number)


@pytest.mark.system("rs274")
def test_linuxcnc_switches_before_the_move_that_begins_in_the_window(made, tmp_path):
    one = made["linuxcnc-gcode"]
    printed = interpret(one.path, tmp_path).stdout
    seen = {}
    for command, name in (
        ("on", "SET_MOTION_OUTPUT_BIT(3)"),
        ("off", "CLEAR_MOTION_OUTPUT_BIT(3)"),
    ):
        before, _, after = printed.partition(name)
        assert name not in after
        seen[command] = len(PRINTED.findall(before))
    times = np.cumsum(60 / np.array(re.findall(r"F(\S+)$", one.path.read_text(), re.M), float)) - 10
    found = [times[seen[command] - 1] for command in ("on", "off")]
    np.testing.assert_allclose(found, one.check.trigger, rtol=0, atol=10e-3)
