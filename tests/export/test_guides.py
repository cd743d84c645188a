"""README: the same headings for every format, and commands that run as they are printed."""

import json
import os
import shlex
import subprocess
import sys
from importlib import import_module
from textwrap import dedent
from types import SimpleNamespace

import numpy as np
import pytest

from expdesign.configuration import export_section
from expdesign.export.exporting import export_table, file_name
from expdesign.export.formats import ros2, table_formats
from expdesign.export.result import ExportResult, exported_motion, exported_table, readme
from tests.export.test_repetition import work

COARSE = {"segment": 4e-3, "tolerance": "1 mm"}
HEADINGS = ["Before you start", "Load", "First slow run", "Run", "Record", "Afterwards"]
LONGEST_ARGUMENT = 128 * 1024


def exported(folder, name, **options):
    section = export_section(format=name, **(COARSE | options))
    return export_table(section, work(2), folder / file_name(section))


def sections(made):
    """Return heading → paragraphs of the instructions."""
    found = {}
    for paragraph in exported_table(made).guide.split("\n\n"):
        title, _, line = paragraph.partition("\n")
        if line and not line.strip("~"):
            found[title] = []
        else:
            found[title if title in found else [*found][-1]].append(paragraph)
    return found


def commands(made, heading):
    parts = [part for part in sections(made)[heading] if part.startswith("    ")]
    return [dedent(part) for part in parts]


def run(command, folder, **environment):
    """Run a printed command as a shell does, with this interpreter for python3."""
    words = [sys.executable if word == "python3" else word for word in shlex.split(command)]
    assert max(map(len, words)) < LONGEST_ARGUMENT
    return subprocess.run(
        words,
        cwd=folder,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )


PLANNED = ("linuxcnc-gcode",)
"""Formats whose rows the controller's planner chooses: their own tests execute the guides."""


@pytest.mark.parametrize("name", [n for n in table_formats() if n not in PLANNED])
def test_every_guide_has_the_same_headings(name, tmp_path):
    counts = {"counts_per_metre": 1e8} if name == "galil-contour" else {}
    made = exported(tmp_path, name, scale=0.5, **counts)
    assert [*sections(made)] == HEADINGS
    assert all(sections(made).values())
    text = readme(ExportResult(exported_motion(work(2)), {made.path.name: exported_table(made)}))
    assert "-0.000000" not in text
    assert "{" not in text.replace("data: {start", "")
    assert max(map(len, (line for line in text.splitlines() if line[:4] != "    "))) <= 96


STUBS = {
    "rclpy/__init__.py": """
        import json, os
        class Publisher:
            waits = 0
            def get_subscription_count(self):
                self.waits += 1
                return self.waits - 1
            def publish(self, message):
                with open(os.environ["PUBLISHED"], "w") as file:
                    json.dump([self.topic, type(message).__name__, message.__dict__], file)
            def wait_for_all_acked(self): pass
        class Node:
            def create_publisher(self, kind, topic, depth):
                publisher = Publisher()
                publisher.topic = topic
                return publisher
        def init(): pass
        def shutdown(): pass
        def create_node(name): return Node()
        def spin_once(node, timeout_sec): pass
    """,
    "rosidl_runtime_py/__init__.py": """
        def set_message_fields(message, values):
            for key, value in values.items():
                setattr(message, key, value)
    """,
    "rosidl_runtime_py/utilities.py": """
        def get_message(name):
            return type(name, (), {})
    """,
    "yaml.py": """
        from ruamel.yaml import YAML
        class SafeLoader: pass
        def load(file, loader):
            return YAML(typ="safe", pure=True).load(file)
    """,
}
"""The calls of a ROS 2 installation that the client makes; the message is built by rosbags."""


@pytest.fixture
def ros_path(tmp_path):
    for name, text in STUBS.items():
        path = tmp_path / "ros" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(dedent(text))
    return tmp_path / "ros"


@pytest.mark.parametrize("space", ["strut", "pose"])
def test_the_message_of_ros_2_is_published_whole(space, ros_path, tmp_path):
    made = exported(tmp_path, "ros2", space=space, segment=6e-3)
    assert made.path.stat().st_size > LONGEST_ARGUMENT
    sent = tmp_path / "sent.json"
    place = {"PYTHONPATH": str(ros_path), "PUBLISHED": str(sent)}
    (check,) = commands(made, "Load")
    printed = run(check.strip(), tmp_path, **place).stdout
    assert f"{made.check.rows} points" in printed
    assert not sent.exists()
    (publish,) = commands(made, "Run")
    assert "waiting for a subscriber" in run(publish.strip(), tmp_path, **place).stdout
    topic, kind, message = json.loads(sent.read_text())
    assert topic in ros2.TOPICS.values()
    (asked,) = commands(made, "Before you start")
    assert asked.split()[-1] == topic
    # The real message type takes every value.
    store = ros2._store()
    message["header"]["stamp"] = {"sec": 0, "nanosec": 0}
    for point in message["points"]:
        point.setdefault("effort", [])
    raw = store.serialize_cdr(ros2._built(store, kind, message), kind)
    again = store.deserialize_cdr(raw, kind)
    assert len(again.points) == made.check.rows
    end = again.points[-1].time_from_start
    assert end.sec + 1e-9 * end.nanosec == pytest.approx(made.check.duration, abs=1e-9)


def test_zabers_library_runs_the_printed_program(tmp_path, monkeypatch):
    ascii_ = import_module("zaber_motion.ascii")
    made = exported(tmp_path, "pvt-csv")
    moved, submitted, waited = {}, [], []
    sequence = SimpleNamespace(
        setup_live=lambda *axes: submitted.append(axes),
        submit_sequence_data=submitted.extend,
        wait_until_idle=lambda: waited.append(True),
    )
    # Calls that the real ones take.
    assert all(hasattr(ascii_.PvtSequence, name) for name in vars(sequence))
    assert hasattr(ascii_.Axis, "move_absolute")
    assert hasattr(ascii_.Pvt, "get_sequence")
    device = SimpleNamespace(
        get_axis=lambda k: SimpleNamespace(
            move_absolute=lambda value, unit: moved.update({k: (value, unit.value)})
        ),
        pvt=SimpleNamespace(get_sequence=lambda _number: sequence),
    )
    monkeypatch.chdir(tmp_path)
    names = {"device": device}
    for heading in ("Load", "Run"):
        for program in commands(made, heading):
            exec(program, names)
    axes, *points = submitted
    assert axes == (1, 2, 3, 4, 5, 6)
    assert len(points) == made.check.rows - 1
    assert waited
    starts = [moved[k][0] for k in range(1, 7)]
    np.testing.assert_allclose(starts, made.settings.start, atol=1e-8)
    assert {unit for _, unit in moved.values()} == {"Length:millimetres"}


def test_pandas_describes_a_csv(tmp_path):
    made = exported(tmp_path, "csv")
    (program,) = commands(made, "Load")
    assert f"{made.check.rows}.0" in run(program.strip(), tmp_path).stdout
