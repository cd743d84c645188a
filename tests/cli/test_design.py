"""`expdesign design`, end to end in processes of its own, and how it fails."""

import json
import os
import signal
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.robot import load_robot
from expdesign.trajectory import FourierTrajectory

POSE = ["x", "y", "z", "phi", "theta", "psi"]
COLUMNS = ["t", *(prefix + name for prefix in ("", "d", "dd") for name in POSE)]
COLUMNS += [f"{name}{j}" for name in ("q", "dq", "ddq", "alpha", "beta", "Q") for j in range(1, 7)]
TABLES = ("limits", "parameters", "starts", "convergence", "eigenvalues", "information")
COMMAND = [sys.executable, "-c", "from expdesign.cli import main; main()"]


def environment():
    paths = [path for path in sys.path if path]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OPENBLAS_NUM_THREADS": "1"}


def write_run(folder, mapping):
    """Write a run file; JSON is YAML."""
    path = folder / "input.yaml"
    path.write_text(json.dumps(mapping), encoding="utf-8")
    return path


def half_written(folder):
    return [path for path in folder.rglob(".*") if path.is_file()]


@pytest.fixture(scope="module")
def designed(tiny, tmp_path_factory):
    """Design the tiny run in a process of its own; return folder, answer and messages."""
    folder = tmp_path_factory.mktemp("design")
    path = write_run(folder, tiny(report={"figures": ["svg"]}))
    out = folder / "out"
    done = subprocess.run(
        [*COMMAND, "design", str(path), "--out", str(out), "--json"],
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment(),
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert [p.name for p in folder.iterdir() if p != path] == ["out"]
    return out, json.loads(done.stdout), done.stderr


@pytest.fixture(scope="module")
def record(designed):
    return json.loads((designed[0] / "design.json").read_text(encoding="utf-8"))


# --- the run folder -------------------------------------------------------------------------------


def test_every_file_is_there_and_complete(designed):
    folder = designed[0]
    for name in ("run.yaml", "manifest.json", "design.json", "trajectory.csv", "columns.json"):
        assert (folder / name).stat().st_size > 100
    for name in TABLES:
        assert len(pd.read_csv(folder / "tables" / f"{name}.csv")) > 0
    pictures = list((folder / "figures").iterdir())
    assert len(pictures) >= 6
    assert {path.suffix for path in pictures} == {".svg"}
    assert all(path.stat().st_size > 1000 for path in pictures)
    assert half_written(folder) == []


def test_answer_as_json(designed, record):
    folder, answer, messages = designed
    assert answer["status"] == 0
    assert answer["folder"] == str(folder)
    assert answer["design_status"] == record["status"]
    assert answer["log_det_information"] == record["log_det_information"]
    assert answer["worst_violation"] <= 1e-6
    assert "Traceback" not in messages
    # Progress: one line for the first motion that keeps the limits.
    assert messages.count("1 of 1 starts done") == messages.count("s of measuring") == 1


def test_manifest(designed):
    manifest = json.loads((designed[0] / "manifest.json").read_text(encoding="utf-8"))
    stage = manifest["stages"]["design"]
    assert stage["status"] == "done"
    assert manifest["seeds"]["design"] == 0
    written = {str(p.relative_to(designed[0])) for p in designed[0].rglob("*") if p.is_file()}
    report = manifest["stages"]["report"]  # which the run file names
    assert report["status"] == "done"
    assert "report.html" in report["files"]
    files = {*stage["files"], *report["files"]}
    assert files == written - {"manifest.json", "run.yaml"}


def test_design_json_has_what_the_contract_says(record):
    n = 2
    assert (record["criterion"], record["harmonics"], record["samples"]) == ("d", n, 24)
    assert record["omega"] == pytest.approx(2 * np.pi / record["period"])
    shapes = [np.shape(record[key]) for key in ("lambda0", "mu", "nu")]
    assert shapes == [(6,), (6, n), (6, n)]
    assert record["criterion_value"] == record["log_det_information"]
    assert isinstance(record["samples_per_period"], int)
    assert record["samples_per_period"] * 0.01 == pytest.approx(record["period"])
    assert record["status"] in {"converged", "not converged"}
    names = set(record["parameters"])
    assert len(names) == 24
    for over, samples in (("per_period", 24), ("experiment", 3 * record["samples_per_period"])):
        spread = record["predicted_std"][over]
        assert spread["samples"] == samples
        assert names <= set(spread)
        assert all(spread[name] > 0 for name in names)
    solver = record["solver"]
    assert solver["iterations"] > 0
    assert solver["seconds"] > 0
    assert all(count > 0 for count in solver["evaluations"].values())
    assert len(solver["starts"]) == 1
    assert all(start["status"] for start in solver["starts"])


def test_design_json_has_every_limit(record):
    assert set(record["limits"]) == set(load_robot_description("palida").limits)
    for key, limit in record["limits"].items():
        assert {"value", "bound", "unit", "time", "strut", "certified", "method"} <= set(limit), key
        assert 0 <= limit["time"] <= record["period"]
        assert limit["violation"] <= 1e-6
        assert (limit["strut"] is None) == (
            key in {"position", "tilt", "jacobian_condition", "strut_clearance"}
        )
        assert limit["certified"] is True
        assert limit["violation"] <= limit["proved"] <= 1e-6
        assert limit["cells"] > 0
        assert limit["open_time"] == 0


def test_another_process_comes_to_the_same(record, tiny_result):
    trajectory = tiny_result.trajectory
    assert record["omega"] == trajectory.omega
    for key in ("lambda0", "mu", "nu"):
        np.testing.assert_array_equal(record[key], getattr(trajectory, key))
    assert record["log_det_information"] == tiny_result.log_det_information


def test_columns_are_in_their_order_and_explained(designed):
    folder = designed[0]
    assert list(pd.read_csv(folder / "trajectory.csv", nrows=0).columns) == COLUMNS
    columns = json.loads((folder / "columns.json").read_text(encoding="utf-8"))
    assert [column["name"] for column in columns["trajectory.csv"]] == COLUMNS
    assert all(column["meaning"] for column in columns["trajectory.csv"])
    units = {column["name"]: column["unit"] for column in columns["trajectory.csv"]}
    assert [units[name] for name in ("t", "x", "dphi", "ddq1", "beta6", "Q3")] == [
        "s",
        "m",
        "rad/s",
        "m/s^2",
        "rad",
        "N",
    ]
    for name in TABLES:
        header = list(pd.read_csv(folder / "tables" / f"{name}.csv", nrows=0).columns)
        told = [column["name"] for column in columns[f"tables/{name}.csv"]]
        named = [column for column in told if not column.startswith("<")]
        assert header[: len(named)] == named
        if name != "information":
            assert header == named


def test_the_trajectory_is_that_of_the_coefficients(designed, record):
    table = pd.read_csv(designed[0] / "trajectory.csv")
    trajectory = FourierTrajectory(record["omega"], *(record[k] for k in ("lambda0", "mu", "nu")))
    times = table["t"].to_numpy()
    assert len(table) == record["samples_per_period"]
    assert times[0] == 0
    np.testing.assert_allclose(np.diff(times), 0.01, rtol=1e-9)
    motion = trajectory.sample(times)
    for prefix, values in (("", motion.pose), ("d", motion.rate), ("dd", motion.acceleration)):
        np.testing.assert_allclose(
            table[[prefix + name for name in POSE]].to_numpy(), values, rtol=0, atol=1e-12
        )
    # At t = 0 the sines are zero and the cosines one.
    omega, orders = record["omega"], np.arange(1, 3)
    first = table.iloc[0]
    nu, mu = np.array(record["nu"]), np.array(record["mu"])
    np.testing.assert_allclose(
        first[POSE], record["lambda0"] - nu @ (1 / (orders * omega)), rtol=1e-12, atol=1e-13
    )
    np.testing.assert_allclose(first[["d" + n for n in POSE]], mu.sum(axis=1), atol=1e-12)
    np.testing.assert_allclose(first[["dd" + n for n in POSE]], nu @ orders * omega, atol=1e-11)


def test_run_yaml_states_the_same_run(designed, tiny):
    again = load_run(designed[0] / "run.yaml").run.model_dump(mode="json", by_alias=True)
    first = load_run(tiny()).run.model_dump(mode="json", by_alias=True)
    for section in ("trajectory", "design", "experiment", "workers", "name"):
        assert again[section] == first[section]


# --- failures: exit status 1 ----------------------------------------------------------------------


def rubin(tiny):
    return tiny(
        robot="rubin",
        trajectory={"frequency": ["0.5 mHz", "50 mHz"], "controller_period": 0.1},
        experiment={"sampling": 10},
    )


def test_later_stages_do_not_change_what_the_design_was_made_from(
    expdesign, tiny, few_limits, cheap_finish, tmp_path
):
    """Its seed came from an option."""
    file, folder = write_run(tmp_path, tiny(robot=few_limits)), tmp_path / "run"
    assert expdesign("design", file, "--out", folder, "--seed", 4)[0] == 0
    before = load_run(folder / "run.yaml").run.design
    assert (before.seed, load_run(file).run.design.seed) == (4, 0)
    assert expdesign("plan", file, "--out", folder, "--want", "mass=90%")[0] == 0
    after = load_run(folder / "run.yaml").run
    assert (after.design, after.goals) == (before, {"mass": "90%"})
    _, _, messages = expdesign("certify", folder)
    assert "changed" not in messages


def test_parameters_that_the_limits_cannot_excite(expdesign, tiny, tmp_path):
    path = write_run(tmp_path, rubin(tiny))
    out = tmp_path / "out"
    status, answer, messages = expdesign("design", path, "--out", out)
    assert (status, answer) == (1, "")
    assert "failed: " in messages
    assert "Traceback" not in messages
    assert "design.parameters" in messages
    assert not out.exists()
    status, answer, _ = expdesign("design", path, "--out", out, "--json")
    data = json.loads(answer)
    assert (status, data["status"]) == (1, 1)
    assert data["unexcited"]
    assert set(data["unexcited"]) < set(load_robot("rubin").parameter_names)
    for name in data["unexcited"]:
        assert name in messages
        for other in data["not_told_from"][name]:
            assert other in messages
    assert "confounded with" in messages


def test_limits_that_no_motion_keeps_are_named(expdesign, tiny, tmp_path):
    length = 0.6762
    path = write_run(tmp_path, tiny(limits={"strut_speed": 1e-9, "strut_length": [0.6, 0.9]}))
    out = tmp_path / "out"
    status, answer, messages = expdesign("design", path, "--out", out)
    assert length > 0.6
    assert (status, answer) == (1, "")
    assert "Traceback" not in messages
    assert "strut_speed" in messages
    assert "strut_length" not in messages
    assert not out.exists()


# --- bad input: exit status 2 ---------------------------------------------------------------------

COVARIANCE = "noise: {force_covariance: [" + ", ".join(["[1, 1, 1, 1, 1, 1]"] * 6) + "]}"
PALIDA = "name: a\nrobot: palida\n"
BAD = {
    "negative harmonics": PALIDA + "trajectory: {harmonics: -1}",
    "zero harmonics": PALIDA + "trajectory: {harmonics: 0}",
    "min above max": PALIDA + "limits: {strut_length: [0.9, 0.5]}",
    "wrong unit": PALIDA + "limits: {strut_length: [5 kg, 9 kg]}",
    "not a number": PALIDA + "limits: {tilt: .nan}",
    "five joints": "name: a\nrobot: {name: b, home: [0, 0, 1, 0, 0, 0], platform_joints: []}",
    "covariance": PALIDA + COVARIANCE,
    "unreachable home": PALIDA + "limits: {strut_length: [0.1, 0.2]}",
    "missing robot": "name: a\nrobot: nowhere.yaml",
    "duplicate key": PALIDA + "design: {seed: 1, seed: 2}",
    "empty file": "",
    "binary file": "\x7fELF\0\0",
    "code": PALIDA + "data: !!python/object/apply:os.system [true]",
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(case, expdesign, tmp_path):
    path = tmp_path / "run.yaml"
    path.write_text(BAD[case], encoding="utf-8")
    out = tmp_path / "out"
    status, answer, messages = expdesign("design", path, "--out", out)
    assert (status, answer) == (2, "")
    assert messages.count("error: ") >= 1
    assert str(path) in messages or "nowhere.yaml" in messages
    assert "Traceback" not in messages
    assert not out.exists()
    status, answer, _ = expdesign("design", path, "--out", out, "--json")
    data = json.loads(answer)
    assert (status, data["status"]) == (2, 2)
    assert data["problems"]


def test_a_missing_file(expdesign, tmp_path):
    status, _, messages = expdesign("design", tmp_path / "missing.yaml")
    assert status == 2
    assert "missing.yaml" in messages


# --- Ctrl-C ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_ctrl_c_keeps_the_best_so_far(tiny, few_limits, tmp_path):
    """As a terminal sends it: to every process, while the search runs."""
    search = {"starts": 2, "search": "hopping", "hops": 40, "max_iterations": 4}
    search["smoothing"] = [0.4]
    run = tiny(robot=few_limits, design=search, workers=2, report={"figures": ["svg"]})
    path = write_run(tmp_path, run)
    out = tmp_path / "out"
    process = subprocess.Popen(
        [*COMMAND, "design", str(path), "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=tmp_path,
        env=environment(),
        start_new_session=True,
    )
    try:
        lines = []
        for line in process.stderr:
            lines.append(line)
            if "s of measuring" in line:  # the first motion that keeps the limits
                os.killpg(process.pid, signal.SIGINT)
                break
        rest = process.stderr.read()
        printed = process.stdout.read()
        status = process.wait()
    finally:
        if process.poll() is None:
            process.kill()
        process.stdout.close()
        process.stderr.close()
    messages = "".join(lines) + rest
    assert "Traceback" not in messages, messages
    assert status == 1
    assert "interrupted" in messages
    assert "strut speed" in printed
    record = json.loads((out / "design.json").read_text(encoding="utf-8"))
    assert record["status"] == "interrupted"
    assert 2 <= len(record["solver"]["starts"]) < 42
    assert all(limit["violation"] <= 1e-6 for limit in record["limits"].values())
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["stages"]["design"]["status"] == "interrupted"
    for name in ("run.yaml", "trajectory.csv", "columns.json", "tables/limits.csv"):
        assert (out / name).stat().st_size > 100
    assert list((out / "figures").glob("*.svg"))
    assert half_written(out) == []
