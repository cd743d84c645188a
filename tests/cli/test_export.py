"""`expdesign export` and the stage of `run`; the motion is that of the tests of the exports."""

import json
import shutil

import pytest

from expdesign.configuration import load_run, resolved_yaml
from expdesign.export.formats import table_formats
from expdesign.motion.ramp_search import NoRampError
from expdesign.runfolder.lock import one_writer_to
from expdesign.runfolder.manifest import file_hash
from expdesign.stages.registry import reported_stages
from expdesign.trajectory import FourierTrajectory
from results.views.folder import RunFolder
from tests.export.motions import motion_of, spline_motion_of, task

COARSE = {"segment": "4 ms", "tolerance": "0.2 mm"}
# Segments that are given need no search, which the tests of the exports and of one table here see.
GIVEN = {"segment": "10 ms", "tolerance": "50 um"}
BY_HAND = ("--segment", "10 ms", "--tolerance", "50 um")
READ = {"segment": 0.01, "tolerance": 5e-5}


@pytest.fixture(autouse=True)
def analytic_ramps(monkeypatch):
    """Let the ways from and to rest be analytic: how they are found is another test's."""

    def ramped(configuration, trajectory):
        assert isinstance(trajectory, FourierTrajectory)
        return motion_of(task().robot, trajectory, configuration.run.experiment.periods)

    monkeypatch.setattr("expdesign.stages.export.executable_motion", ramped)


@pytest.fixture
def run_file(tmp_path):
    def write(export):
        path = tmp_path / "input.yaml"
        data = {
            "name": "test",
            "robot": "palida",
            "experiment": {"periods": 1, "sampling": 500},
            "export": export,
        }
        path.write_text(json.dumps(data), encoding="utf-8")
        return path

    return write


@pytest.fixture
def folder(tmp_path, run_file):
    """Return a run folder with a design and a resolved run that names one export."""
    out = tmp_path / "run"
    out.mkdir()
    made = task().motion.trajectory
    data = {"harmonics": made.harmonics, "omega": made.omega}
    data |= {key: getattr(made, key).tolist() for key in ("lambda0", "mu", "nu")}
    (out / "design.json").write_text(json.dumps(data), encoding="utf-8")
    configuration = load_run(run_file([{"format": "xps-pvt", "units": "um", "digits": 5}]))
    (out / "run.yaml").write_text(resolved_yaml(configuration), encoding="utf-8")
    return out


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_the_formats_are_listed(expdesign, tmp_path, monkeypatch):
    status, answer, _ = expdesign("export", "--format", "list", "--json")
    assert status == 0
    assert [form["name"] for form in json.loads(answer)] == list(table_formats())
    status, answer, _ = expdesign("export", "--format", "list")
    assert status == 0
    assert all(name in answer for name in table_formats())
    # So does what comes to mind first, unless there is a folder of that name.
    monkeypatch.chdir(tmp_path)
    assert expdesign("export", "list") == (0, answer, "")
    (tmp_path / "list").mkdir()
    status, _, messages = expdesign("export", "list")
    assert (status, "run.yaml is missing" in messages) == (2, True)


def test_without_a_format_the_tables_of_the_run_are_written(expdesign, folder):
    status, answer, messages = expdesign("export", folder, "--json")
    assert status == 0, messages
    assert list(json.loads(answer)["files"]) == [str(folder / "exports/xps-pvt.trj")]
    found = json.loads((folder / "exports/exports.json").read_text())["files"]["xps-pvt.trj"]
    assert (found["axes"][0]["unit"], found["digits"]) == ("um", 5)
    status, _, messages = expdesign("export", folder, "--digits", "6")
    assert (status, "--format" in messages) == (2, True)


def test_a_format_that_is_missing(expdesign, folder, run_file):
    (folder / "run.yaml").write_text(resolved_yaml(load_run(run_file([]))), encoding="utf-8")
    status, _, messages = expdesign("export", folder)
    messages = " ".join(messages.split())
    assert status == 2
    assert "--format: no format is given allowed: csv | " in messages
    assert all(name in messages for name in table_formats())
    assert not (folder / "exports").exists()


def test_a_table_with_the_runs_options(expdesign, folder):
    status, answer, messages = expdesign("export", folder, "--format", "xps-pvt")
    assert status == 0, messages
    assert "read back" in answer
    exports = folder / "exports"
    assert names(exports) == ["README.txt", "exports.json", "xps-pvt.trj"]
    record = json.loads((exports / "exports.json").read_text())
    found = record["files"]["xps-pvt.trj"]
    assert found["axes"][0]["unit"] == "um"
    assert found["digits"] == 5
    assert found["read_back"]["position_error"] < 1e-6
    assert found["read_back"]["limits"]["strut_speed"]["violation"] < 0
    assert abs(found["read_back"]["information"]["log_det_change"]) < 0.05
    assert record["motion"]["window"] == list(task().motion.window)
    text = (exports / "README.txt").read_text()
    reached = {(one["key"], one["row"]) for one in record["motion"]["unlimited"]}
    assert {("rotation", name) for name in ("phi", "theta", "psi")} < reached
    for part in (
        "What nothing limits",
        "1.200000 s",
        "500 Hz",
        "R = Rx(phi) Ry(theta) Rz(psi)",
        "Newport",
        "q1     um",
    ):
        assert part in text, part


def test_a_second_table_is_added(expdesign, folder):
    for name, more in (
        ("xps-pvt", BY_HAND),
        ("pi-wave", ("--segment", "4 ms", "--tolerance", "0.2 mm")),
    ):
        status, _, messages = expdesign("export", folder, "--format", name, *more)
        assert status == 0, messages
    record = json.loads((folder / "exports/exports.json").read_text())
    assert set(record["files"]) == {"xps-pvt.trj", "pi-wave.txt"}
    text = (folder / "exports/README.txt").read_text()
    assert "xps-pvt.trj" in text
    assert "pi-wave.txt" in text


def test_a_table_for_the_first_run(expdesign, folder, monkeypatch):
    monkeypatch.setattr(
        "expdesign.stages.export.executable_motion",
        lambda _, trajectory: spline_motion_of(task().robot, trajectory, 1),
    )
    arguments = ("export", folder, "--format", "xps-pvt", *BY_HAND)
    for more in (("--scale", "0.2"), ()):
        status, answer, messages = expdesign(*arguments, *more)
        assert status == 0, (answer, messages)
    exports = folder / "exports"
    assert names(exports) == ["README.txt", "exports.json", "xps-pvt-scale-0.2.trj", "xps-pvt.trj"]
    record = json.loads((exports / "exports.json").read_text())
    files = record["files"]
    scaled, whole = files["xps-pvt-scale-0.2.trj"], files["xps-pvt.trj"]
    assert (scaled["scale"], whole["scale"]) == (0.2, 1.0)
    assert scaled["duration"] == pytest.approx(5 * whole["duration"], abs=1e-6)
    # The motion of the folder is that of the design, whatever else is exported.
    assert record["motion"]["duration"] == pytest.approx(whole["duration"], abs=1e-6)
    assert "scaled by 0.2 for a first run" in (exports / "README.txt").read_text()
    status, _, messages = expdesign(*arguments, "--scale", "1.5")
    assert (status, "--scale" in messages) == (2, True)


def test_what_belongs_to_a_table_lies_beside_it(expdesign, folder, tmp_path):
    arguments = ("export", folder, "--format", "xps-pvt", *BY_HAND, "--trigger", "2")
    status, answer, messages = expdesign(*arguments)
    assert status == 0, messages
    assert "xps-pvt.events.txt" in answer
    exports = folder / "exports"
    assert names(exports) == ["README.txt", "exports.json", "xps-pvt.events.txt", "xps-pvt.trj"]
    found = json.loads((exports / "exports.json").read_text())["files"]["xps-pvt.trj"]
    assert found["companions"] == ["xps-pvt.events.txt"]
    assert found["trigger"] == pytest.approx(list(task().motion.window), abs=5e-3)
    readme = " ".join((exports / "README.txt").read_text().split())
    assert "Output 2 of GPIO1 is on from 1.2" in readme
    out = tmp_path / "elsewhere" / "table.ngc"
    options = ("--servo-period", "1 ms", "--units", "in", "--out", out)
    status, answer, messages = expdesign("export", folder, "--format", "linuxcnc-gcode", *options)
    assert status == 1, messages
    words = "in single servo cycles strut acceleration of strut 5 is -33.5729 m/s^2"
    assert f"the machine breaks limits: table.ngc: {words}" in " ".join(messages.split())
    assert f"table.ngc breaks limits: {words}" in " ".join(answer.split())
    assert answer.startswith("Controller tables: beyond limits.")
    assert (out.parent / "table.genhexkins.hal").is_file()
    assert "table.genhexkins.hal" in (out.parent / "table.ngc.README.txt").read_text()
    status, _, messages = expdesign(*arguments[:-1], "9")
    assert (status, "--trigger" in messages) == (2, True)


def test_options_of_the_command_line(expdesign, folder, tmp_path):
    out = tmp_path / "elsewhere" / "table.pmc"
    status, answer, messages = expdesign(
        *("export", folder, "--format", "pmac-pvt", "--out", out, "--axes", "A,B,C,X,Y,Z"),
        *("--order", "2,1,3,4,5,6", "--sign", "-1", "--offset", "home"),
        *("--counts-per-metre", "1000000", "--digits", "2", "--segment", "10 ms"),
        *("--tolerance", "20 um", "--json"),
    )
    assert status == 0, (answer, messages)
    (found,) = json.loads(answer)["files"].values()
    assert [axis["name"] for axis in found["axes"]] == list("ABCXYZ")
    assert [axis["moves"] for axis in found["axes"]][:2] == ["q2", "q1"]
    assert found["axes"][0]["unit"] == "counts"
    assert found["options"]["sign"] == [-1] * 6
    assert names(out.parent) == ["table.pmc", "table.pmc.README.txt", "table.pmc.json"]
    assert not (folder / "exports").exists()


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--format", "xps"), "'xps' is not a choice"),
        (("--format", "pi-wave", "--sign", "1"), "pi-wave has no option 'sign'"),
        (("--format", "ros2", "--units", "deg"), "option 'units': trajectories of ROS are in m"),
        (("--format", "xps-pvt", "--segment", "10 mm"), "is a length, not a duration"),
        (("--format", "xps-pvt", "--order", "1,2"), "2 numbers of struts where 6 are needed"),
        (("--format", "xps-pvt", "--counts-per-metre", "1,x"), "--counts-per-metre"),
        (("--format", "pmac-pvt", "--axes", "A,B,C,D,Y,Z"), "'D' is not an axis of a PMAC"),
        (("--format", "ros2", "--encoding", "mcap", "--digits", "3"), "all their digits"),
        (
            ("--format", "ros2", "--encoding", "mcap", "--out", "t.dat"),
            "--out: 't.dat' does not end",
        ),
        (("--format", "ros2", "--encoding", "mcap", "--out", "t.MCAP"), "the ending .mcap"),
    ],
)
def test_bad_options(arguments, expected, expdesign, folder):
    status, _, messages = expdesign("export", folder, *arguments)
    assert status == 2
    assert expected in messages
    assert "Traceback" not in messages
    assert not (folder / "exports").exists()


@pytest.fixture
def resolved(folder, run_file):
    """Return a maker of the folder's resolved run."""

    def write(export):
        text = resolved_yaml(load_run(run_file(export)))
        (folder / "run.yaml").write_text(text, encoding="utf-8")

    return write


ACTUATORS = {"order": [2, 1, 3, 4, 5, 6], "sign": -1, "offset": "home"}


@pytest.mark.parametrize(
    ("stated", "arguments", "left_out", "expected"),
    [
        (
            {"format": "xps-pvt", **ACTUATORS, "axes": list("abcdef")},
            ("--space", "pose"),
            "left out, since --space is given: axes, order, sign, offset of the run's export",
            {"format": "xps-pvt", "space": "pose"},
        ),
        (
            {"format": "pmac-pvt", "counts_per_metre": 1e6, "segment": "10 ms"},
            ("--space", "pose", "--tolerance", "50 um"),
            "--space is given: counts_per_metre of",
            {"format": "pmac-pvt", "space": "pose", "segment": 0.01, "tolerance": 5e-5},
        ),
        (
            {"format": "pmac-pvt", "counts_per_metre": 1e6},
            ("--space", "pose", "--units", "mm"),
            "counts_per_metre of",
            {"format": "pmac-pvt", "space": "pose", "units": "mm"},
        ),
        (
            {"format": "xps-pvt", "units": "um"},
            ("--counts-per-metre", "1e9"),
            "since --counts-per-metre is given: units of",
            {"format": "xps-pvt", "counts_per_metre": [1e9] * 6},
        ),
        (
            {"format": "ros2", "digits": 9},
            ("--encoding", "mcap"),
            "since --encoding is given: digits of",
            {"format": "ros2", "encoding": "mcap"},
        ),
        (
            {"format": "ros2", **ACTUATORS, "digits": 9},
            ("--space", "strut", "--encoding", "yaml"),
            None,
            {
                "format": "ros2",
                "digits": 9,
                "space": "strut",
                "encoding": "yaml",
                **ACTUATORS,
                "sign": [-1] * 6,
            },
        ),
    ],
)
def test_options_override_those_of_the_run(
    stated, arguments, left_out, expected, expdesign, folder, resolved
):
    if "segment" not in stated:
        stated, expected = stated | GIVEN, expected | READ
    resolved([stated])
    command = ("export", folder, "--format", stated["format"], *arguments, "--json")
    status, answer, messages = expdesign(*command)
    assert status == 0, (answer, messages)
    (found,) = json.loads(answer)["files"].values()
    assert found["options"] == expected
    assert ("left out" in messages) == (left_out is not None)
    assert (left_out or "") in " ".join(messages.split())


def test_one_of_several_tables_of_the_run_is_named(expdesign, folder, resolved):
    resolved(
        [
            "csv",
            {"format": "xps-pvt", **ACTUATORS, **GIVEN},
            {"format": "xps-pvt", "file": "b", "units": "um", **GIVEN},
        ]
    )
    command = ("export", folder, "--format", "xps-pvt")
    for more in ((), ("--file", "c"), ("--units", "mm")):
        status, _, messages = expdesign(*command, *more)
        assert (status, "--file: the run has 2 tables of xps-pvt" in messages) == (2, True)
        assert "allowed: xps-pvt | b" in messages
        assert not (folder / "exports").exists()
    assert expdesign(*command, "--file", "b")[0] == 0
    assert expdesign(*command, "--file", "xps-pvt")[0] == 0
    files = json.loads((folder / "exports/exports.json").read_text())["files"]
    assert files["b.trj"]["options"] == {"format": "xps-pvt", "file": "b", "units": "um", **READ}
    assert files["xps-pvt.trj"]["options"]["order"] == ACTUATORS["order"]
    # Where there is one, it lends its options to a table of another name.
    resolved([{"format": "xps-pvt", "units": "in", **GIVEN}])
    assert expdesign(*command, "--file", "c")[0] == 0
    files = json.loads((folder / "exports/exports.json").read_text())["files"]
    assert files["c.trj"]["options"] == {"format": "xps-pvt", "file": "c", "units": "in", **READ}


def test_folders_that_are_none(expdesign, folder, tmp_path):
    status, _, messages = expdesign("export", tmp_path, "--format", "csv")
    assert (status, "run.yaml is missing" in messages) == (2, True)
    (folder / "design.json").unlink()
    status, _, messages = expdesign("export", folder, "--format", "csv")
    assert (status, "design.json" in messages) == (2, True)
    status, _, messages = expdesign("export", "--format", "csv")
    assert (status, "no run folder" in messages) == (2, True)


def test_a_table_beyond_its_tolerance_is_not_kept(expdesign, folder):
    status, _, messages = expdesign("export", folder, "--format", "xps-pvt", "--segment", "80 ms")
    assert status == 1
    assert "more than the tolerance of 1 µm" in messages
    assert "was not kept" in messages
    assert not list((folder / "exports").iterdir())


@pytest.mark.parametrize(
    ("room", "options", "cause", "remedy"),
    [
        (
            2,
            ("--segment", "30 ms"),
            "more than the tolerance",
            "no segment, or a shorter segment, or a larger tolerance may help.",
        ),
        (
            1.001,
            ("--segment", "80 ms", "--tolerance", "5 mm"),
            "strut acceleration of strut",
            "no segment, or a shorter segment may help.",
        ),
        (
            1.001,
            ("--digits", "0", "--tolerance", "1 mm"),
            "of its limit's range from the design",
            "a shorter segment, or more digits may help.",
        ),
    ],
)
def test_what_may_help_fits_the_cause(room, options, cause, remedy, expdesign, folder, run_file):
    assert expdesign("export", folder, "--format", "xps-pvt", *BY_HAND)[0] == 0
    made = json.loads((folder / "exports/exports.json").read_text())["files"]["xps-pvt.trj"]
    largest = abs(made["read_back"]["limits"]["strut_acceleration"]["value"])
    run = json.loads(run_file(["xps-pvt"]).read_text())
    run["limits"] = {"strut_acceleration": room * largest}
    (folder / "run.yaml").write_text(json.dumps(run))
    status, _, messages = expdesign("export", folder, "--format", "xps-pvt", *options)
    messages = " ".join(messages.split())
    assert status == 1
    assert cause in messages
    assert f"was not kept; {remedy}" in messages


def test_no_way_into_the_motion(expdesign, folder, monkeypatch):
    def none(_configuration, _trajectory):
        raise NoRampError("ramp in", "strut_speed", "no ramp keeps strut_speed")

    monkeypatch.setattr("expdesign.stages.export.executable_motion", none)
    status, _, messages = expdesign("export", folder, "--format", "csv")
    assert (status, "no ramp keeps strut_speed" in messages) == (1, True)


@pytest.mark.slow
def test_the_stage_of_run(expdesign, folder, run_file):
    quick = {"format": "xps-pvt", **GIVEN}
    file = run_file([quick, {"format": "linuxcnc-strut", **COARSE}])
    text = json.loads(file.read_text())
    del text["experiment"]
    file.write_text(json.dumps(text | {"experiment": {"periods": 1, "sampling": 500}}))
    shutil.copy(file, folder / "input.yaml")
    data = json.loads(file.read_text())
    measured = folder.parent / "measured.csv"
    measured.write_text("t\n")
    data["data"] = {"file": str(measured)}  # so that `experiment` simulates nothing
    file.write_text(json.dumps(data))
    status, answer, messages = expdesign("run", file, "--out", folder, "--json")
    assert status == 0, messages
    assert json.loads(answer)["stages"]["export"]["resumed"] is False
    exports = folder / "exports"
    assert names(exports) == [
        *("README.txt", "exports.json", "linuxcnc-strut.streamer.hal", "linuxcnc-strut.txt"),
        "xps-pvt.trj",
    ]
    entry = json.loads((folder / "manifest.json").read_text())["stages"]["export"]
    assert entry["status"] == "done"
    assert set(entry["files"]) == {f"exports/{name}" for name in names(exports)}
    status, answer, _ = expdesign("run", file, "--out", folder, "--json")
    assert json.loads(answer)["resumed"] is True
    # Another list: what it no longer names goes.
    data["export"] = [quick]
    file.write_text(json.dumps(data))
    status, answer, _ = expdesign("run", file, "--out", folder, "--json")
    assert json.loads(answer)["resumed"] is False
    assert names(exports) == ["README.txt", "exports.json", "xps-pvt.trj"]


@pytest.mark.slow
def test_a_run_whose_table_breaks_a_limit_fails(expdesign, folder, run_file):
    file = measured_run(run_file(["linuxcnc-gcode"]), {"servo_period": "1 ms"})
    status, answer, _ = expdesign("run", file, "--out", folder, "--json")
    words = "in single servo cycles strut acceleration of strut 5 is -33.8114 m/s^2"
    assert (status, words in json.loads(answer)["message"]) == (1, True)
    entry = json.loads((folder / "manifest.json").read_text())["stages"]["export"]
    assert entry["status"] == "limits broken"
    (table,) = json.loads((folder / "exports/exports.json").read_text())["files"].values()
    assert any(words in text for text in table["read_back"]["broken"])
    readme = " ".join((folder / "exports/README.txt").read_text().split())
    assert "THE MACHINE BREAKS LIMITS: " in readme


def test_a_run_keeps_what_is_told_of_tables_exported_by_hand(expdesign, folder, run_file):
    file = measured_run(run_file(["linuxcnc-strut"]), COARSE)
    assert expdesign("run", file, "--out", folder)[0] == 0
    exports = folder / "exports"
    status, _, messages = expdesign("export", folder, "--format", "xps-pvt", *BY_HAND)
    assert status == 0, messages

    def described():
        record = json.loads((exports / "exports.json").read_text())
        text = (exports / "README.txt").read_text()
        assert all(f"{name}: " in text for name in record["files"])
        return set(record["files"])

    both = {"linuxcnc-strut.txt", "xps-pvt.trj"}
    assert described() == both
    # Nothing of the stage has changed.
    status, answer, _ = expdesign("run", file, "--out", folder, "--json")
    assert (status, json.loads(answer)["resumed"]) == (0, True)
    assert described() == both
    # Another table in the run: that of before goes, the one made by hand stays.
    again = measured_run(run_file(["linuxcnc-strut"]), COARSE | {"file": "other"})
    status, answer, _ = expdesign("run", again, "--out", folder, "--json")
    assert (status, json.loads(answer)["resumed"]) == (0, False)
    assert described() == {"other.txt", "xps-pvt.trj"}
    assert names(exports) == [
        *("README.txt", "exports.json", "other.streamer.hal", "other.txt", "xps-pvt.trj"),
    ]
    # One that fails takes nothing with it.
    bad = measured_run(run_file(["linuxcnc-strut"]), COARSE | {"segment": "80 ms"})
    assert expdesign("run", bad, "--out", folder)[0] == 1
    assert described() == {"xps-pvt.trj"}


def said_changes(folder):
    return set(RunFolder.open(folder, reported_stages()).changes.of("export"))


def test_neither_order_of_stage_and_command_is_a_change_by_hand(expdesign, folder, run_file):
    file = measured_run(run_file(["linuxcnc-strut"]), COARSE)
    by_hand = ("export", folder, "--format", "xps-pvt", *BY_HAND)
    assert expdesign("run", file, "--out", folder)[0] == 0
    assert said_changes(folder) == set()
    assert expdesign(*by_hand)[0] == 0
    assert said_changes(folder) == set()
    # The stage's own table, by the command, and by the stage again.
    assert expdesign("export", folder, "--format", "linuxcnc-strut", "--segment", "2 ms")[0] == 0
    assert said_changes(folder) == set()
    assert expdesign("run", file, "--out", folder)[0] == 0
    assert said_changes(folder) == set()
    # The stage's inputs count for its description also after the command has added to it.
    assert expdesign(*by_hand)[0] == 0
    run, text = folder / "run.yaml", (folder / "run.yaml").read_text(encoding="utf-8")
    run.write_text(text.replace("sampling: 500", "sampling: 250"), encoding="utf-8")
    assert "run.yaml has changed since exports/exports.json was made" in said_changes(folder)


def test_a_table_is_not_exported_into_another_run_folder(expdesign, folder, tmp_path):
    other = tmp_path / "other"
    shutil.copytree(folder, other)
    (other / "exports").mkdir()
    out = other / "exports" / "x.trj"
    status, _, messages = expdesign("export", folder, "--format", "xps-pvt", *BY_HAND, "--out", out)
    assert (status, "tables of another run folder" in " ".join(messages.split())) == (2, True)
    assert names(other / "exports") == []


@pytest.mark.parametrize("place", ["run/../run/exports", "link/exports"])
def test_the_folder_is_the_same_by_another_path(place, expdesign, folder, tmp_path):
    (tmp_path / "link").symlink_to(folder, target_is_directory=True)
    assert expdesign("export", folder, "--format", "xps-pvt", *BY_HAND)[0] == 0
    out = f"{tmp_path}/{place}/x.trj"
    status, _, messages = expdesign("export", folder, "--format", "xps-pvt", *BY_HAND, "--out", out)
    assert status == 0, messages
    assert names(folder / "exports") == ["README.txt", "exports.json", "x.trj", "xps-pvt.trj"]


def test_the_options_of_the_run_are_read_under_the_lock(expdesign, folder, run_file, monkeypatch):
    run = folder / "run.yaml"
    later = resolved_yaml(load_run(run_file([{"format": "xps-pvt", "units": "um", "digits": 7}])))

    def one_writer_after_another(*arguments):
        run.write_text(later, encoding="utf-8")
        return one_writer_to(*arguments)

    monkeypatch.setattr("expdesign.cli.exports.one_writer_to", one_writer_after_another)
    assert expdesign("export", folder, "--format", "xps-pvt", *BY_HAND)[0] == 0
    made = json.loads((folder / "exports/exports.json").read_text())["files"]["xps-pvt.trj"]
    assert made["digits"] == 7


def test_tables_of_another_motion_are_told_of_no_longer(expdesign, folder):
    assert expdesign("export", folder, "--format", "xps-pvt", *BY_HAND)[0] == 0
    data = json.loads((folder / "design.json").read_text())
    data["mu"][0][0] *= 1 - 1e-6
    (folder / "design.json").write_text(json.dumps(data))
    more = ("--segment", "4 ms", "--tolerance", "0.2 mm")
    status, _, messages = expdesign("export", folder, "--format", "pi-wave", *more)
    assert status == 0, messages
    assert "no longer in README.txt and exports.json: xps-pvt.trj" in " ".join(messages.split())
    assert set(json.loads((folder / "exports/exports.json").read_text())["files"]) == {
        "pi-wave.txt"
    }


def measured_run(file, options):
    """Give a run data of its own, so that `experiment` simulates nothing, and its table options."""
    data = json.loads(file.read_text())
    measured = file.parent / "measured.csv"
    measured.write_text("t\n")
    data["data"] = {"file": str(measured)}
    data["export"] = [{"format": name} | options for name in data["export"]]
    file.write_text(json.dumps(data))
    return file


@pytest.mark.slow
def test_tables_do_not_depend_on_the_number_of_workers(expdesign, folder, run_file):
    wanted = [{"format": "xps-pvt", **GIVEN}, {"format": "linuxcnc-strut", **COARSE}]
    measured, found = folder.parent / "measured.csv", {}
    measured.write_text("t\n")  # so that `experiment` simulates nothing
    for workers in (1, 2):
        more = {"data": {"file": str(measured)}, "workers": workers}
        file = run_file(wanted)
        file.write_text(json.dumps(json.loads(file.read_text()) | more))
        place = folder.with_name(f"by{workers}")
        shutil.copytree(folder, place)
        status, _, messages = expdesign("run", file, "--out", place)
        assert status == 0, messages
        # Nothing hidden is left behind either.
        found[workers] = {path.name: path.read_bytes() for path in (place / "exports").iterdir()}
    assert found[1] == found[2]
    tables = ["linuxcnc-strut.streamer.hal", "linuxcnc-strut.txt", "xps-pvt.trj"]
    assert sorted(found[2]) == ["README.txt", "exports.json", *tables]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_table_of_the_stage_is_described_though_the_next_one_fails(
    workers, expdesign, folder, run_file
):
    mine = {"format": "xps-pvt", "units": "mm", **GIVEN}
    file = run_file([mine, {"format": "csv", "segment": "80 ms"}])
    measured = folder.parent / "measured.csv"
    measured.write_text("t\n")
    data = json.loads(file.read_text()) | {"data": {"file": str(measured)}, "workers": workers}
    file.write_text(json.dumps(data))
    command = ("export", folder, "--format", "xps-pvt")
    assert expdesign(*command, "--units", "um", *BY_HAND)[0] == 0
    status, _, messages = expdesign("run", file, "--out", folder)
    assert (status, "csv.csv" in messages) == (1, True)
    exports = folder / "exports"
    found = json.loads((exports / "exports.json").read_text())["files"]["xps-pvt.trj"]
    assert found["options"]["units"] == "mm"
    assert found["sha256"] == file_hash(exports / "xps-pvt.trj")
    assert "q1     mm" in (exports / "README.txt").read_text()
    # By hand it is the same table, not one with the options of before.
    status, answer, _ = expdesign(*command, "--json")
    assert status == 0
    assert next(iter(json.loads(answer)["files"].values()))["options"]["units"] == "mm"


def test_the_options_of_a_run_that_was_changed_are_those_of_its_folder(expdesign, folder, run_file):
    for options in ({"units": "um"}, {"units": "mm", "sign": -1}):
        file = measured_run(run_file(["xps-pvt"]), options | GIVEN)
        status, _, messages = expdesign("run", file, "--out", folder)
        assert status == 0, messages
        assert (folder / "run.yaml").read_text() == resolved_yaml(load_run(file))
    table = folder / "exports" / "xps-pvt.trj"
    made = table.read_bytes()
    assert expdesign("export", folder, "--format", "xps-pvt")[0] == 0
    assert table.read_bytes() == made


def test_a_stage_that_fails_leaves_the_configuration_of_what_is_there(
    expdesign, folder, run_file, monkeypatch
):
    def none(_configuration, _trajectory):
        raise NoRampError("ramp in", "strut_speed", "no ramp keeps strut_speed")

    monkeypatch.setattr("expdesign.stages.export.executable_motion", none)
    before = (folder / "run.yaml").read_bytes()
    file = measured_run(run_file(["xps-pvt"]), {"units": "mm"})
    assert expdesign("run", file, "--out", folder)[0] == 1
    assert (folder / "run.yaml").read_bytes() == before


@pytest.mark.parametrize("name", ["README.txt", "exports.json", "readme.TXT"])
def test_a_table_does_not_take_the_place_of_its_description(name, expdesign, folder, run_file):
    out = folder / "exports" / name
    status, _, messages = expdesign("export", folder, "--format", "csv", "--out", out)
    assert (status, "describes the tables" in messages) == (2, True)
    assert not out.exists()


def test_the_name_of_the_description_is_taken(expdesign, folder):
    more = ("--format", "linuxcnc-strut", "--file", "README")
    status, _, messages = expdesign("export", folder, *more)
    assert (status, "--file: README.txt describes" in messages) == (2, True)


def test_a_table_of_the_run_does_not_take_the_place_of_the_description(expdesign, folder, run_file):
    file = run_file([{"format": "linuxcnc-strut", "file": "README"}])
    status, _, messages = expdesign("run", file, "--out", folder)
    assert (status, "export[1].file" in messages) == (2, True)


def test_a_bad_option_of_the_run_is_named_with_its_place(expdesign, folder, run_file):
    file = run_file(["csv", {"format": "pmac-pvt", "axes": ["A", "B", "C", "D", "Y", "Z"]}])
    status, _, messages = expdesign("run", file, "--out", folder)
    assert status == 2
    assert "export[2].axes" in messages
