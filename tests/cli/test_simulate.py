"""`expdesign simulate`, with a design written by hand."""

import json
import os
import signal

import numpy as np
import pandas as pd
import pytest

from estimation.twin import Twin
from estimation.twin import truth as truths
from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.robot import load_robot
from expdesign.runfolder.manifest import file_hash
from expdesign.trajectory import FourierTrajectory

COLUMNS = ["t", *(f"{name}{j}" for name in "qQ" for j in range(1, 7)), "period"]
DISTURBED = {
    "tracking_error": {"position": "1 mm", "angle": "0.1 deg"},
    "drift": "0.05 mm",
    "cogging": {"amplitude": [0, 0, 12, 12, 0, 0], "pitch": "30 mm", "phase": 0.3},
    "quantisation": {"length": "1 um", "force": 0.1},
    "outliers": {"share": 0.01, "force": 100, "length": "1 mm"},
}


def trajectory(frequency=0.6):
    return FourierTrajectory.from_displacements(
        2 * np.pi * frequency,
        [0, 0, -0.654, 0, 0, 0],
        [[0.05, 0], [0, 0.03], [0.02, 0.01], [0.05, 0], [0, 0.05], [0.08, 0]],
        [[0, 0.02], [0.05, 0], [0.01, 0.01], [0, 0.04], [0.06, 0], [0, 0.05]],
    )


def write_design(folder, made=None, **more):
    made = made or trajectory()
    folder.mkdir(parents=True, exist_ok=True)
    data = {
        "harmonics": made.harmonics,
        "omega": made.omega,
        **{key: getattr(made, key).tolist() for key in ("lambda0", "mu", "nu")},
    }
    (folder / "design.json").write_text(json.dumps(data | more), encoding="utf-8")
    return folder


@pytest.fixture
def design(tmp_path):
    return write_design(tmp_path / "design")


@pytest.fixture
def run_file(tmp_path):
    """Write a run file; keywords are those of `experiment`."""

    def write(name="input.yaml", **experiment):
        path = tmp_path / name
        section = {"periods": 3, "sampling": 200} | experiment
        data = {"name": "test", "robot": "palida", "experiment": section}
        path.write_text(json.dumps(data), encoding="utf-8")
        return path

    return write


def files(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def stage(folder):
    return json.loads((folder / "manifest.json").read_text(encoding="utf-8"))["stages"][
        "experiment"
    ]


# --- what is written ------------------------------------------------------------------------------


def test_one_measurement(expdesign, run_file, design, tmp_path):
    out = tmp_path / "out"
    status, answer, messages = expdesign("simulate", run_file(), "--design", design, "--out", out)
    assert status == 0
    assert "3 periods of 1.6667 s measured at 200 Hz: 1000 samples" in answer
    assert "disturbances: none" in answer
    assert "Traceback" not in messages
    assert set(files(out)) == {
        "measurement.csv",
        "truth.json",
        "columns.json",
        "run.yaml",
        "manifest.json",
    }
    table = pd.read_csv(out / "measurement.csv")
    assert list(table.columns) == COLUMNS
    assert len(table) == 1000
    assert table.notna().all().all()
    np.testing.assert_allclose(np.diff(table["t"]), 0.005, rtol=1e-9)
    assert table["period"].is_monotonic_increasing
    assert set(table["period"]) == {1, 2, 3}

    motion = trajectory().sample(table["t"].to_numpy())
    robot = load_robot("palida")
    lengths = table[COLUMNS[1:7]].to_numpy() - robot.inverse_kinematics(motion.pose)
    forces = table[COLUMNS[7:13]].to_numpy() - robot.actuator_forces(
        motion.pose, motion.rate, motion.acceleration
    )
    noise = robot.description.noise
    for error, covariance in ((lengths, noise.length_covariance), (forces, noise.force_covariance)):
        ratio = np.std(error, axis=0) / np.sqrt(np.diag(covariance))
        np.testing.assert_allclose(ratio, 1, atol=0.12)


def test_what_stands_beside_it(expdesign, run_file, design, tmp_path):
    out = tmp_path / "out"
    path = run_file(seed=5, **DISTURBED)
    assert expdesign("simulate", path, "--design", design, "--out", out)[0] == 0
    truth = json.loads((out / "truth.json").read_text(encoding="utf-8"))
    robot = load_robot("palida")
    assert truth["parameters"] == dict(
        zip(robot.parameter_names, robot.parameters.tolist(), strict=True)
    )
    np.testing.assert_array_equal(
        truth["force_covariance"], robot.description.noise.force_covariance
    )
    np.testing.assert_array_equal(
        truth["length_covariance"], robot.description.noise.length_covariance
    )
    assert truth["design"]["harmonics"] == 2
    assert truth["executed"]["harmonics"] == 15
    np.testing.assert_array_equal(truth["design"]["mu"], trajectory().mu)
    np.testing.assert_array_equal(np.array(truth["executed"]["mu"])[:, :2], trajectory().mu)
    assert truth["executed"]["omega"] == trajectory().omega
    assert truth["experiment"] == {
        "periods": 3,
        "sampling": 200,
        "samples": 1000,
        "samples_per_period": pytest.approx(1000 / 3),
        "follows": "lengths",
    }
    assert truth["seeds"] == {"experiment": 5, "repetitions": 5}
    switched_on = {key for key, value in truth["disturbances"].items() if value}
    assert switched_on == set(DISTURBED)
    np.testing.assert_allclose(np.abs(truth["disturbances"]["drift"]["final"]), 5e-5)
    assert truth["disturbances"]["cogging"]["amplitude"] == [0, 0, 12, 12, 0, 0]

    columns = json.loads((out / "columns.json").read_text(encoding="utf-8"))
    assert [column["name"] for column in columns["measurement.csv"]] == COLUMNS
    assert all(column["meaning"] for column in columns["measurement.csv"])
    again = load_run(out / "run.yaml").run
    assert again.experiment == load_run(path).run.experiment
    entry = stage(out)
    assert entry["status"] == "done"
    assert set(entry["files"]) == set(files(out)) - {"manifest.json", "run.yaml"}


def test_the_same_run_gives_the_same_bytes(expdesign, run_file, design, tmp_path):
    path = run_file(**DISTURBED)
    for name in ("first", "second"):
        assert expdesign("simulate", path, "--design", design, "--out", tmp_path / name)[0] == 0
    first, second = files(tmp_path / "first"), files(tmp_path / "second")
    for name in ("measurement.csv", "truth.json", "columns.json", "run.yaml"):
        assert first[name] == second[name]
    other = run_file("other.yaml", seed=2, **DISTURBED)
    assert expdesign("simulate", other, "--design", design, "--out", tmp_path / "third")[0] == 0
    assert files(tmp_path / "third")["measurement.csv"] != first["measurement.csv"]


def test_every_digit_is_kept(expdesign, run_file, design, tmp_path):
    path, out = run_file(), tmp_path / "out"
    assert expdesign("simulate", path, "--design", design, "--out", out)[0] == 0
    table = np.loadtxt(out / "measurement.csv", delimiter=",", skiprows=1)
    measured = Twin.of(load_run(path), trajectory()).measurement()
    np.testing.assert_array_equal(table[:, 0], measured.time)
    np.testing.assert_array_equal(table[:, 1:7], measured.lengths)
    np.testing.assert_array_equal(table[:, 7:13], measured.forces)
    np.testing.assert_array_equal(table[:, 13], measured.period)


def test_as_json(expdesign, run_file, design, tmp_path):
    out = tmp_path / "out"
    arguments = ("--design", design, "--out", out, "--repetitions", 2, "--json")
    status, answer, _ = expdesign("simulate", run_file(), *arguments)
    data = json.loads(answer)
    assert (status, data["status"]) == (0, 0)
    assert data["folder"] == str(out)
    assert (data["repetitions"], data["samples"], data["periods"]) == (2, 1000, 3)


# --- repetitions ----------------------------------------------------------------------------------


def test_repetitions(expdesign, run_file, design, tmp_path):
    several, one = tmp_path / "several", tmp_path / "one"
    path = run_file()
    status, answer, _ = expdesign(
        "simulate", path, "--design", design, "--out", several, "--repetitions", 3
    )
    assert status == 0
    assert "3 times" in answer
    written = files(several)
    names = [f"repetitions/{k:04d}/measurement.csv" for k in (1, 2, 3)]
    assert {name for name in written if name.endswith(".csv")} == set(names)
    assert "truth.json" in written
    assert len({written[name] for name in names}) == 3
    columns = json.loads((several / "columns.json").read_text(encoding="utf-8"))
    assert "repetitions/*/measurement.csv" in columns
    # The first of several is the only one of one; nothing but the noise differs.
    assert expdesign("simulate", path, "--design", design, "--out", one)[0] == 0
    assert files(one)["measurement.csv"] == written[names[0]]
    assert files(one)["truth.json"] == written["truth.json"]


def test_more_from_the_same_run_are_added(expdesign, run_file, design, tmp_path):
    path, out = run_file(), tmp_path / "out"
    for count in (3, 1, 2):
        arguments = ("--design", design, "--out", out, "--repetitions", count)
        assert expdesign("simulate", path, *arguments)[0] == 0
    names = {"measurement.csv", *(f"repetitions/{k:04d}/measurement.csv" for k in (1, 2, 3))}
    assert {name for name in files(out) if name.endswith(".csv")} == names
    assert names < set(stage(out)["files"])


def test_those_of_another_run_are_replaced(expdesign, run_file, design, tmp_path):
    """A truth.json never stands beside measurements of another truth."""
    out = tmp_path / "out"
    arguments = ("--design", design, "--out", out)
    assert expdesign("simulate", run_file(), *arguments, "--repetitions", 3)[0] == 0
    mine = out / "repetitions" / "0002" / "measurement.csv"
    mine.write_text("changed by hand", encoding="utf-8")
    other = run_file("other.yaml", drift="1 mm")
    assert expdesign("simulate", other, *arguments)[0] == 0
    assert {name for name in files(out) if name.endswith(".csv")} == {
        "measurement.csv",
        "repetitions/0002/measurement.csv",
    }
    assert "repetitions/0002/measurement.csv" not in stage(out)["files"]


# --- where the design is --------------------------------------------------------------------------


def test_the_design_of_the_run_folder_itself(expdesign, run_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = write_design(tmp_path / "runs" / "test")
    assert expdesign("simulate", run_file())[0] == 0
    assert (folder / "measurement.csv").stat().st_size > 1000


def test_columns_of_other_tables_stay(expdesign, run_file, tmp_path):
    folder = write_design(tmp_path / "run")
    known = {"trajectory.csv": [{"name": "t", "unit": "s", "meaning": "time"}]}
    (folder / "columns.json").write_text(json.dumps(known), encoding="utf-8")
    assert expdesign("simulate", run_file(), "--out", folder)[0] == 0
    columns = json.loads((folder / "columns.json").read_text(encoding="utf-8"))
    assert columns["trajectory.csv"] == known["trajectory.csv"]
    assert "measurement.csv" in columns


def test_doubts_about_the_design_are_told(expdesign, run_file, tmp_path):
    folder = write_design(tmp_path / "run", robot="rubin", status="limits broken")
    status, _, messages = expdesign("simulate", run_file(), "--out", folder)
    assert status == 0
    assert "made for the robot rubin" in messages
    assert "breaks a limit" in messages


def test_a_robot_that_was_identified_is_the_machine_of_its_design(expdesign, tmp_path):
    robot = load_robot_description("palida").description.model_dump(mode="json", exclude_none=True)
    path, folder = tmp_path / "run.yaml", write_design(tmp_path / "run", robot="palida")
    for name, warned in (("palida-identified", False), ("palida-2", True)):
        run = {"name": "n", "robot": robot | {"name": name}}
        run["experiment"] = {"periods": 1, "sampling": 50}
        path.write_text(json.dumps(run), encoding="utf-8")
        status, _, messages = expdesign("simulate", path, "--out", folder)
        assert status == 0, messages
        assert ("made for the robot palida" in messages) == warned


# --- bad input: exit status 2, and nothing is written ---------------------------------------------


def refused(expdesign, *arguments, out, named):
    status, answer, messages = expdesign("simulate", *arguments, "--out", out)
    assert (status, answer) == (2, "")
    assert "Traceback" not in messages
    for text in named:
        assert text in messages
    assert not out.exists()
    status, answer, _ = expdesign("simulate", *arguments, "--out", out, "--json")
    assert (status, json.loads(answer)["status"]) == (2, 2)


def test_no_design(expdesign, run_file, tmp_path):
    refused(expdesign, run_file(), out=tmp_path / "out", named=["no design.json", "--design"])


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("{", ["not JSON", "design.json:1"]),
        ("[1]", ["harmonics"]),
        ('{"omega": 3}', ["harmonics", "lambda0", "mu", "nu"]),
        ('{"harmonics": 1, "omega": NaN, "lambda0": [0], "mu": [], "nu": 3}', ["omega", "lambda0"]),
    ],
)
def test_a_design_that_is_none(expdesign, run_file, tmp_path, text, named):
    design = tmp_path / "design"
    design.mkdir()
    (design / "design.json").write_text(text, encoding="utf-8")
    refused(expdesign, run_file(), "--design", design, out=tmp_path / "out", named=named)


def test_a_design_that_is_nowhere(expdesign, run_file, tmp_path):
    refused(
        *(expdesign, run_file(), "--design", tmp_path / "nowhere"),
        out=tmp_path / "out",
        named=["nowhere", "no such file"],
    )


def test_noise_is_needed(expdesign, design, tmp_path):
    robot = load_run("palida").run.robot.model_dump(exclude_none=True, exclude={"noise"})
    path = tmp_path / "bare.yaml"
    path.write_text(json.dumps({"name": "bare", "robot": robot}), encoding="utf-8")
    refused(
        *(expdesign, path, "--design", design),
        out=tmp_path / "out",
        named=["bare.yaml: noise", "force_std", "length_std"],
    )


def test_too_many_samples(expdesign, run_file, design, tmp_path):
    refused(
        *(expdesign, run_file(periods=100_000, sampling="50 kHz"), "--design", design),
        out=tmp_path / "out",
        named=["experiment.periods"],
    )


@pytest.mark.parametrize("count", ["0", "-1", "many", "1.5"])
def test_repetitions_that_are_none(expdesign, run_file, design, tmp_path, count):
    status, _, messages = expdesign(
        "simulate", run_file(), "--design", design, "--out", tmp_path / "o", "--repetitions", count
    )
    assert status == 2
    assert "--repetitions" in messages
    assert not (tmp_path / "o").exists()


def test_a_folder_that_is_a_file(expdesign, run_file, design, tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("mine", encoding="utf-8")
    status, _, messages = expdesign("simulate", run_file(), "--design", design, "--out", taken)
    assert status == 2
    assert "taken" in messages
    assert taken.read_text(encoding="utf-8") == "mine"


def test_a_failure_removes_nothing(expdesign, run_file, design, tmp_path):
    out = tmp_path / "out"
    assert expdesign("simulate", run_file(), "--design", design, "--out", out)[0] == 0
    before = files(out)
    bad = run_file("bad.yaml", periods=100_000, sampling="1 MHz")
    assert expdesign("simulate", bad, "--design", design, "--out", out)[0] == 2
    assert files(out) == before


# --- Ctrl-C ---------------------------------------------------------------------------------------


def test_ctrl_c_keeps_what_is_complete(expdesign, run_file, design, tmp_path, monkeypatch):
    out, written = tmp_path / "out", []
    write = truths.write_measurement

    def interrupted(measurement, path, configuration):
        if len(written) == 4:
            os.kill(os.getpid(), signal.SIGINT)
        write(measurement, path, configuration)
        written.append(str(path.relative_to(out)))

    monkeypatch.setattr("expdesign.stages.experiment.write_measurement", interrupted)
    arguments = ("--design", design, "--out", out, "--repetitions", 50)
    # A shell lets what it starts in the background ignore the signal.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        status, _, messages = expdesign("simulate", run_file(), *arguments)
    finally:
        signal.signal(signal.SIGINT, before)
    assert status == 1
    assert "interrupted after 4 of 50 measurements" in messages
    entry = stage(out)
    assert entry["status"] == "interrupted"
    assert {name for name in files(out) if name.endswith(".csv")} == set(written)
    assert {name for name in entry["files"] if name.endswith(".csv")} == set(written)
    for name in written:
        assert len(pd.read_csv(out / name)) == 1000
        assert file_hash(out / name) == entry["files"][name]
    assert (out / "truth.json").is_file()
    assert not [path for path in out.rglob(".*") if path.is_file()]
