"""`expdesign simulate --table`: the table that the controller gets is what is measured."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest

from expdesign.configuration import load_run, resolved_yaml
from tests.estimation.cases import ROBOT, trajectory
from tests.export.motions import spline_motion_of

EXPERIMENT = {"periods": 2, "sampling": 200}


@pytest.fixture
def run_file(tmp_path):
    def write(name="input.yaml", robot="palida", **experiment):
        path = tmp_path / name
        data = {"name": "test", "robot": robot, "experiment": EXPERIMENT | experiment}
        path.write_text(json.dumps(data), encoding="utf-8")
        return path

    return write


@pytest.fixture
def searches(monkeypatch):
    """Let ramps be polynomials, and count how often they are looked for."""
    found = []

    def ramped(configuration, design):
        found.append(configuration)
        return spline_motion_of(ROBOT, design, configuration.run.experiment.periods, 0.25)

    monkeypatch.setattr("expdesign.stages.export.executable_motion", ramped)
    return found


@pytest.fixture
def folder(tmp_path, run_file, searches):
    """Return a run folder with a design."""
    out = tmp_path / "run"
    out.mkdir()
    made = trajectory()
    data = {"harmonics": made.harmonics, "omega": made.omega}
    data |= {key: getattr(made, key).tolist() for key in ("lambda0", "mu", "nu")}
    (out / "design.json").write_text(json.dumps(data), encoding="utf-8")
    (out / "run.yaml").write_text(resolved_yaml(load_run(run_file())), encoding="utf-8")
    return out


TABLES = {
    "xps-pvt.trj": ("xps-pvt", "--sign", "-1", "--units", "um"),
    "ros2.yaml": ("ros2",),
}
COARSE = ("--segment", "25 ms", "--tolerance", "50 um")


@pytest.fixture(scope="module")
def exported():
    """Keep what was exported from the design of `folder`, by the table's name."""
    return {}


@pytest.fixture
def export(exported, folder, expdesign, searches, tmp_path):
    """Return a maker of a table in the folder, with its record: each is exported once."""

    def made(name):
        if name not in exported:
            status, _, messages = expdesign("export", folder, "--format", *TABLES[name], *COARSE)
            assert status == 0, messages
            assert len(searches) == 1
            searches.clear()
            written = (folder / "exports").iterdir()
            exported[name] = {path.name: path.read_bytes() for path in written}
        (folder / "exports").mkdir(exist_ok=True)
        for file, content in exported[name].items():
            (folder / "exports" / file).write_bytes(content)
        return folder / "exports" / name

    return made


@pytest.fixture
def table(export):
    return export("xps-pvt.trj")


def measured(folder):
    return pd.read_csv(folder / "measurement.csv")


def test_the_table_is_measured(expdesign, run_file, folder, table, tmp_path):
    out = tmp_path / "out"
    arguments = ("simulate", run_file(), "--design", folder, "--out")
    status, answer, messages = expdesign(*arguments, out, "--table", table)
    assert status == 0, messages
    assert (
        "controller table: xps-pvt.trj (xps-pvt, measured from 0.4000 s after its start" in answer
    )
    truth = json.loads((out / "truth.json").read_text())
    assert truth["table"]["file"] == "xps-pvt.trj"
    assert truth["table"]["window"] == [0.4, 2.4]
    assert 1e-7 < truth["table"]["position_error"] < 5e-5
    # The window begins where the ramp enters the orbit, 0.25 s after the design's own start.
    begun = trajectory().shifted(0.25)
    np.testing.assert_allclose(truth["design"]["mu"], begun.mu)
    found = measured(out)
    lengths = found[[f"q{j}" for j in range(1, 7)]].to_numpy()
    noise = lengths - ROBOT.inverse_kinematics(begun.sample(found["t"].to_numpy()).pose)
    std = np.sqrt(np.diag(ROBOT.description.noise.length_covariance))
    np.testing.assert_allclose(noise.std(axis=0) / std, 1, atol=0.15)
    # Not the design: the interpolated table differs, with the same noise, by its own error.
    assert expdesign(*arguments, tmp_path / "plain")[0] == 0
    assert not json.loads((tmp_path / "plain/truth.json").read_text())["table"]


def test_it_is_another_experiment_than_the_design(expdesign, run_file, folder, table, tmp_path):
    """Repetitions of the design do not stay beside a truth that says the table was executed."""
    out = tmp_path / "out"
    plain = ("simulate", run_file(), "--design", folder, "--out", out, "--repetitions")
    assert expdesign(*plain, 3)[0] == 0
    assert expdesign(*plain, 2, "--table", table)[0] == 0
    assert sorted(path.name for path in (out / "repetitions").iterdir()) == ["0001", "0002"]


def test_a_table_with_its_record_elsewhere(expdesign, run_file, folder, tmp_path):
    far = tmp_path / "far" / "table.pmc"
    export = ("export", folder, "--format", "pmac-pvt", "--out", far, "--offset", "home")
    assert expdesign(*export, *COARSE)[0] == 0
    arguments = ("--design", folder, "--out", tmp_path / "out", "--table", far, "--json")
    status, answer, messages = expdesign("simulate", run_file(), *arguments)
    assert status == 0, messages
    assert json.loads(answer)["table"] == "table.pmc"


def test_a_table_that_was_replaced(expdesign, run_file, folder, table, tmp_path):
    """Whatever says what the table was before does not count, wherever it stands."""
    stale = json.loads((table.parent / "exports.json").read_text())
    assert stale["files"]["xps-pvt.trj"]["options"]["units"] == "um"
    again = ("export", folder, "--format", "xps-pvt", "--segment", "25 ms", "--tolerance", "50 um")
    assert expdesign(*again, "--units", "mm", "--out", table)[0] == 0
    # The folder's own files tell of it, and no others.
    names = sorted(path.name for path in table.parent.iterdir())
    assert names == ["README.txt", "exports.json", "xps-pvt.trj"]
    record = json.loads((table.parent / "exports.json").read_text())
    assert record["files"]["xps-pvt.trj"]["options"]["units"] == "mm"
    assert "q1     mm" in (table.parent / "README.txt").read_text()
    # A record that was overtaken gives way to the one of this very file.
    shutil.copy(table.parent / "exports.json", table.with_name("xps-pvt.trj.json"))
    (table.parent / "exports.json").write_text(json.dumps(stale))
    arguments = ("--design", folder, "--out", tmp_path / "out", "--table", table)
    status, _, messages = expdesign("simulate", run_file(), *arguments)
    assert status == 0, messages
    assert "changed" not in messages


def test_a_table_that_was_changed_by_hand(expdesign, run_file, folder, table, tmp_path):
    lines = table.read_text().splitlines()
    cells = lines[70].split(", ")
    cells[1] = f"{float(cells[1]) + 0.01:.5f}"
    table.write_text("\n".join([*lines[:70], ", ".join(cells), *lines[71:]]) + "\n")
    arguments = ("--design", folder, "--out", tmp_path / "out", "--table", table, "--json")
    status, answer, messages = expdesign("simulate", run_file(), *arguments)
    assert status == 0, messages
    assert "xps-pvt.trj was changed after it was exported" in messages
    assert any("was not checked" in warning for warning in json.loads(answer)["warnings"])


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("table", ("--format", "csv", "--segment", "2 ms", "--tolerance", "1 mm")),
        ("table.xyz", ("--format", "mat", "--segment", "2 ms", "--tolerance", "1 mm")),
        ("table.mcap", ("--format", "ros2", *COARSE)),
        ("table.mcap", ("--format", "ros2", "--encoding", "mcap", *COARSE)),
    ],
)
def test_a_table_of_any_name_that_export_takes(
    name, options, expdesign, run_file, folder, tmp_path
):
    table = tmp_path / "far" / name
    status, _, messages = expdesign("export", folder, *options, "--out", table)
    assert status == 0, messages
    arguments = ("--design", folder, "--out", tmp_path / "out", "--table", table, "--json")
    status, answer, messages = expdesign("simulate", run_file(), *arguments)
    assert status == 0, messages
    assert json.loads(answer)["table"] == name


def _no_record(table):
    (table.parent / "exports.json").unlink()


def _changed(keys, value):
    def change(table):
        path = table.parent / "exports.json"
        data = json.loads(path.read_text())
        *first, last = keys
        part = data
        for key in first:
            part = part[key]
        part[last] = value
        path.write_text(json.dumps(data))

    return change


def _off_home(table):
    record = json.loads((table.parent / "exports.json").read_text())
    points = record["motion"]["leads"]["ramps"][0]["control_points"]
    points[0][2] += 0.05
    _changed(("motion", "leads", "ramps", 0, "control_points"), points)(table)


def _cut(table):
    table.write_text("\n".join(table.read_text().splitlines()[:60]) + "\n")


def _cut_under_two_records(table):
    text = (table.parent / "exports.json").read_text()
    table.with_name("xps-pvt.trj.json").write_text(text)
    _cut(table)


def _last_lines(table):
    lines = table.read_text().splitlines()
    table.write_text("\n".join(lines[:60] + lines[-1:]) + "\n")


def _other_element(table):
    lines = table.read_text().splitlines()
    lines[70], lines[80] = lines[80], lines[70]
    table.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (lambda table: table.unlink(), "there is no such table"),
        (_no_record, "the columns of this table are not described"),
        (
            lambda table: (table.parent / "exports.json").write_text("{"),
            "not JSON",
        ),
        (_changed(("motion", "leads"), None), "its motion is not that of the design"),
        (_changed(("motion", "leads", "periods"), 1.9), "motion.leads.periods"),
        (_off_home, "the ramps do not begin and end at rest at home"),
        (_changed(("motion", "sampling"), None), "motion.sampling"),
        (_changed(("motion", "sampling"), 0), "motion.sampling"),
        (_changed(("motion", "controller_period"), 10**399), "motion.controller_period"),
        (_changed(("motion", "controller_period"), "abc"), "motion.controller_period"),
        (_changed(("motion", "leads", "periods"), 10**399), "is not a number of a result"),
        (_changed(("files", "xps-pvt.trj", "options"), {"format": "none"}), "cannot be used"),
        (_changed(("files", "xps-pvt.trj", "options", "units"), "mm"), "does not hold the design"),
        (_changed(("files", "xps-pvt.trj", "options", "sign"), [1] * 6), "does not hold"),
        (lambda table: table.write_text("0.1, 0, x\n"), "would not read this table"),
        (_cut, "would not read this table: line 60: the last velocities are not 0"),
        (_cut, "it was changed after it was exported"),
        (_cut_under_two_records, "which of them holds for it is unknown"),
        (_changed(("files", "xps-pvt.trj", "sha256"), None), "sha256"),
        (_last_lines, "inside the measurement window"),
        (_other_element, "does not hold the design"),
        (_other_element, "it was changed after it was exported"),
    ],
)
def test_bad_tables(spoil, expected, expdesign, run_file, folder, table, tmp_path):
    spoil(table)
    out = tmp_path / "out"
    arguments = ("--design", folder, "--out", out, "--table", table)
    status, _, messages = expdesign("simulate", run_file(), *arguments)
    assert status == 2, messages
    assert expected in " ".join(messages.split())
    assert "Traceback" not in messages
    # It is not said to be executed.
    assert "warning: xps-pvt.trj" not in messages
    assert not (out / "measurement.csv").exists()


def _text(old, new):
    def change(table):
        text = table.read_text()
        assert old in text
        table.write_text(text.replace(old, new, 1))

    return change


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (
            _text("{sec: 1, nanosec", "{sec: 99999999999, nanosec"),
            "a value that is not a number",
        ),
        (_text("{sec: 1, nanosec", "{sec: -1, nanosec"), "a value that is not a number"),
        (lambda table: table.write_text("[" * 1000), "it is nested too deeply"),
        (lambda table: table.write_text("a: !!bool maybe"), "no YAML: 'maybe'"),
        (lambda table: table.write_text("a: " + "9" * 5000), "no YAML: Exceeds the limit"),
        (lambda table: table.write_text("a: !!timestamp 5"), "no YAML"),
        (lambda table: table.write_bytes(b"\xff"), "no plain text"),
    ],
)
def test_bad_messages(spoil, expected, expdesign, run_file, folder, export, tmp_path):
    table = export("ros2.yaml")
    spoil(table)
    arguments = ("--design", folder, "--out", tmp_path / "out", "--table", table)
    status, _, messages = expdesign("simulate", run_file(), *arguments)
    assert status == 2, messages
    assert expected in " ".join(messages.split())
    assert "would not read this table" in messages


def test_a_table_of_another_design_or_too_few_periods(expdesign, run_file, folder, table, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(folder, other)
    text = json.loads((other / "design.json").read_text())
    text["mu"][0][0] += 0.01
    (other / "design.json").write_text(json.dumps(text))
    arguments = ("--out", tmp_path / "out", "--table", table)
    status, _, messages = expdesign("simulate", run_file(), "--design", other, *arguments)
    assert (status, "not that of the design" in messages) == (2, True)
    long = run_file("long.yaml", periods=3)
    status, _, messages = expdesign("simulate", long, "--design", folder, *arguments)
    assert (status, "3 periods are to be measured" in messages) == (2, True)


# --- the motion is looked for once ----------------------------------------------------------------


def test_ways_are_looked_for_once(expdesign, folder, table, searches):
    first = table.read_bytes()
    status, _, messages = expdesign("export", folder, "--format", "ros2", *COARSE)
    assert status == 0, messages
    assert "are those of" in messages
    assert searches == []
    record = json.loads((folder / "exports/exports.json").read_text())
    assert set(record["files"]) == {"xps-pvt.trj", "ros2.yaml"}
    # The same table, whether its ways were found or read.
    (folder / "exports/exports.json").unlink()
    again = ("export", folder, "--format", *TABLES["xps-pvt.trj"], *COARSE)
    assert expdesign(*again)[0] == 0
    assert len(searches) == 1
    assert expdesign(*again)[0] == 0
    assert len(searches) == 1
    assert table.read_bytes() == first


@pytest.mark.parametrize(
    "what", ["design", "limits", "periods", "record", "recorded periods", "home"]
)
def test_ways_of_something_else_are_not_taken(what, expdesign, folder, table, searches, run_file):
    if what == "design":
        text = json.loads((folder / "design.json").read_text())
        text["mu"][0][0] *= 1 + 1e-12
        (folder / "design.json").write_text(json.dumps(text))
    elif what == "record":
        _changed(("motion", "leads", "ramps"), [])(table)
    elif what == "recorded periods":
        _changed(("motion", "leads", "periods"), 3)(table)
    elif what == "home":
        _off_home(table)
    else:
        data = json.loads(run_file().read_text())
        data |= {"limits": {"strut_speed": 1.9}} if what == "limits" else {}
        data["experiment"]["periods"] = 2 + (what == "periods")
        (folder / "run.yaml").write_text(resolved_yaml(load_run(data)), encoding="utf-8")
    status, _, messages = expdesign("export", folder, "--format", "ros2", *COARSE)
    assert status == 0, messages
    assert len(searches) == 1
    assert "are those of" not in messages
