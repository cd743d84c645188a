"""`expdesign montecarlo`, with a design written by hand and few repetitions."""

import json
import os
import signal
import subprocess
import sys
import time

import pandas as pd
import pytest

from estimation.montecarlo import study as one
from estimation.montecarlo.result import StatisticsRow
from estimation.montecarlo.study import NAME
from estimation.processing import PeriodError
from expdesign.runfolder import RowTable
from expdesign.runfolder.manifest import file_hash
from tests.twin.examples import motion

COMMAND = [sys.executable, "-c", "from expdesign.cli import main; main()"]
TABLES = {
    "tables/montecarlo.csv",
    "tables/montecarlo_repetitions.csv",
}
WRITTEN = TABLES | {
    "montecarlo.json",
    "columns.json",
    "run.yaml",
    "figures/montecarlo_bias.png",
    "figures/montecarlo_bias.svg",
    "figures/montecarlo_efficiency.png",
    "figures/montecarlo_efficiency.svg",
}


@pytest.fixture
def design(tmp_path):
    folder, made = tmp_path / "design", motion(0.5, harmonics=2)
    folder.mkdir()
    coefficients = {key: getattr(made, key).tolist() for key in ("lambda0", "mu", "nu")}
    data = {"harmonics": 2, "omega": made.omega, **coefficients}
    (folder / "design.json").write_text(json.dumps(data), encoding="utf-8")
    return folder


@pytest.fixture
def run_file(tmp_path):
    """Write a run file; keywords are its sections."""

    def write(name="input.yaml", **sections):
        data = {
            "name": "test",
            "robot": "palida",
            "experiment": {"periods": 3, "sampling": 60},
            "estimate": {"harmonics": 2},
            "montecarlo": {"repetitions": 3, "estimators": ["ls", "gm"]},
            "workers": 1,
        }
        path = tmp_path / name
        path.write_text(json.dumps(data | sections), encoding="utf-8")
        return path

    return write


def files(folder):
    return {str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()}


def stage(folder):
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    return manifest["stages"]["montecarlo"]


def test_what_is_written(expdesign, run_file, design, tmp_path):
    out = tmp_path / "out"
    status, answer, messages = expdesign("montecarlo", run_file(), "--design", design, "--out", out)
    assert status == 0, messages
    assert "3 simulated experiments of 3 periods at 60 Hz" in answer
    assert "8 of 24 parameters are identified" in answer
    assert files(out) == WRITTEN | {"manifest.json", NAME}
    entry = stage(out)
    assert (entry["status"], entry["message"]) == ("done", "3 of 3 repetitions")
    assert set(entry["files"]) == WRITTEN - {"run.yaml"}
    table = pd.read_csv(out / "tables" / "montecarlo.csv")
    assert list(table.columns) == list(RowTable("", "", StatisticsRow).names)
    assert len(table) == 48
    assert table.notna().all().all()
    repetitions = pd.read_csv(out / "tables" / "montecarlo_repetitions.csv")
    assert list(zip(repetitions["repetition"], repetitions["estimator"], strict=True)) == [
        (k, name) for k in (1, 2, 3) for name in ("ls", "gm")
    ]
    columns = json.loads((out / "columns.json").read_text(encoding="utf-8"))
    for name in TABLES:
        header = (out / name).read_text(encoding="utf-8").splitlines()[0].split(",")
        assert [column["name"] for column in columns[name]] == header
    record = json.loads((out / "montecarlo.json").read_text(encoding="utf-8"))
    assert record["repetitions"] == {"wanted": 3, "done": 3}
    assert record["harmonics"] == {"2": 3}
    assert len(record["identified"]) == 8
    assert record["estimators"]["gm"]["failures"] == []
    assert record["estimators"]["gm"]["pooled"]["rmse_over_bound"] > 0
    assert "second" not in json.dumps(record)


def test_more_repetitions_go_on_from_those_that_are_done(
    expdesign, run_file, design, tmp_path, monkeypatch
):
    done = []
    original = one.Workbench.repeat
    monkeypatch.setattr(
        one.Workbench, "repeat", lambda bench, k: done.append(k) or original(bench, k)
    )
    out, path = tmp_path / "out", run_file()
    arguments = ("montecarlo", path, "--design", design, "--out", out, "--json")
    assert expdesign(*arguments)[0] == 0
    status, answer, _ = expdesign(*arguments, "--repetitions", 5)
    assert done == [1, 2, 3, 4, 5]
    data = json.loads(answer)
    assert (status, data["status"], data["repetitions"]) == (0, 0, 5)
    assert data["folder"] == str(out)
    assert data["estimators"]["ls"]["estimates"] == 5
    assert expdesign(*arguments, "--repetitions", 2)[0] == 0
    assert done == [1, 2, 3, 4, 5]
    assert len(pd.read_csv(out / "tables" / "montecarlo_repetitions.csv")) == 4


@pytest.mark.slow
def test_as_a_stage_of_a_run(expdesign, run_file, design):
    path = run_file()
    # Nothing else is named: the design stands in the run folder already.
    section = {"repetitions": 1, "estimators": ["gm"]}
    path.write_text(
        json.dumps({"name": "t", "robot": "palida", "montecarlo": section, "workers": 1}),
        encoding="utf-8",
    )
    status, _, messages = expdesign("run", path, "--out", design)
    assert status == 0, messages
    assert stage(design)["status"] == "done"
    status, _, messages = expdesign("run", path, "--out", design)
    assert status == 0
    assert "montecarlo: done already" in messages
    # Another design is another study.
    data = json.loads((design / "design.json").read_text(encoding="utf-8"))
    data["lambda0"][0] += 0.001
    (design / "design.json").write_text(json.dumps(data), encoding="utf-8")
    status, _, messages = expdesign("run", path, "--out", design)
    assert status == 0, messages
    assert "done already" not in messages


# --- what goes wrong ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("sections", "named"),
    [
        ({"estimate": {"differentiation": "central"}, "montecarlo": {}}, "montecarlo.estimators"),
        ({"experiment": {"periods": 1, "sampling": 60}, "estimate": {"noise": "estimated"}}, "est"),
        ({"montecarlo": {"repetitions": 0}}, "montecarlo.repetitions"),
        ({"experiment": {"periods": 100_000, "sampling": "50 kHz"}}, "experiment.periods"),
    ],
    ids=["ml", "noise", "repetitions", "samples"],
)
def test_bad_input_writes_nothing(expdesign, run_file, design, tmp_path, sections, named):
    out = tmp_path / "out"
    arguments = ("montecarlo", run_file(**sections), "--design", design, "--out", out)
    status, answer, messages = expdesign(*arguments)
    assert (status, answer) == (2, "")
    assert named in messages
    assert "Traceback" not in messages
    assert not out.exists()
    status, answer, _ = expdesign(*arguments, "--json")
    assert (status, json.loads(answer)["status"]) == (2, 2)


def test_no_design(expdesign, run_file, tmp_path):
    out = tmp_path / "out"
    status, _, messages = expdesign("montecarlo", run_file(), "--out", out)
    assert status == 2
    assert "no design.json" in messages
    assert not out.exists()


def test_an_experiment_that_determines_too_little(expdesign, run_file, design, tmp_path):
    still = motion(0.5, harmonics=2)
    data = {"harmonics": 2, "omega": still.omega, "lambda0": still.lambda0.tolist()}
    data |= {"mu": [[0.0, 0.0]] * 6, "nu": [[0.0, 0.0]] * 6}
    (design / "design.json").write_text(json.dumps(data), encoding="utf-8")
    out = tmp_path / "out"
    status, _, messages = expdesign("montecarlo", run_file(), "--design", design, "--out", out)
    assert status == 1
    assert "do not determine" in messages
    assert "Traceback" not in messages
    assert not out.exists()


def test_failures_are_told(expdesign, run_file, design, tmp_path, monkeypatch):
    original = one.prepare_experiment

    def sometimes(configuration, robot, data, trajectory):
        if data.source.endswith(" 2"):
            raise ArithmeticError("no pose has the measured lengths")
        return original(configuration, robot, data, trajectory)

    monkeypatch.setattr(one, "prepare_experiment", sometimes)
    out = tmp_path / "out"
    status, _, messages = expdesign("montecarlo", run_file(), "--design", design, "--out", out)
    assert status == 0
    assert "gm failed in 1 of 3 repetitions" in messages
    assert "no pose has the measured lengths" in messages
    record = json.loads((out / "montecarlo.json").read_text(encoding="utf-8"))
    reason = [{"repetition": 2, "reason": "no pose has the measured lengths"}]
    assert record["estimators"]["ls"]["failures"] == reason


def test_nothing_that_could_be_estimated(expdesign, run_file, design, tmp_path, monkeypatch):
    def never(*_):
        raise ArithmeticError("no pose has the measured lengths")

    monkeypatch.setattr(one, "prepare_experiment", never)
    out = tmp_path / "out"
    status, answer, _ = expdesign(
        "montecarlo", run_file(), "--design", design, "--out", out, "--json"
    )
    assert status == 1
    assert "no pose has the measured lengths" in json.loads(answer)["message"]
    assert stage(out)["status"] == "failed"


def test_a_bug_is_not_a_failure(expdesign, run_file, design, tmp_path, monkeypatch):
    def broken(*_):
        raise ValueError("a bug")

    assert not issubclass(PeriodError, one.NUMERICAL_FAILURES)
    monkeypatch.setattr(one, "prepare_experiment", broken)
    with pytest.raises(ValueError, match="a bug"):
        expdesign("montecarlo", run_file(), "--design", design, "--out", tmp_path / "out")


# --- Ctrl-C ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_done(expdesign, run_file, design, tmp_path):
    """As a terminal sends it, to every process; tests/stages/test_run.py has it with one."""
    out, path = tmp_path / "out", run_file(workers=2)
    arguments = ["montecarlo", str(path), "--design", str(design), "--out", str(out)]
    process = subprocess.Popen(
        [*COMMAND, *arguments, "--repetitions", "50000"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={
            **os.environ,
            "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
            "OPENBLAS_NUM_THREADS": "1",
        },
        start_new_session=True,
    )
    try:
        journal = out / NAME
        while process.poll() is None and not (
            journal.exists() and journal.read_bytes().count(b"\n") > 4
        ):
            time.sleep(0.05)
        os.killpg(process.pid, signal.SIGINT)
        printed, messages = process.communicate()
    finally:
        process.kill()
    assert process.returncode == 1, messages
    assert "Traceback" not in messages
    assert "interrupted after" in messages
    entry = stage(out)
    assert entry["status"] == "interrupted"
    record = json.loads((out / "montecarlo.json").read_text(encoding="utf-8"))
    done = record["repetitions"]["done"]
    assert str(done) in printed
    assert record["interrupted"] is True
    assert 4 <= done < 50_000
    table = pd.read_csv(out / "tables" / "montecarlo_repetitions.csv")
    assert len(table) == 2 * done
    for name, digest in entry["files"].items():
        assert file_hash(out / name) == digest
    run_file(workers=1)
    assert expdesign(*arguments, "--repetitions", done)[0] == 0
    assert stage(out)["status"] == "done"
