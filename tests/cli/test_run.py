"""`expdesign run`: every stage that the file names, resuming what is done."""

import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from expdesign.configuration import load_run, resolved_yaml
from expdesign.stages.stage import Outcome

QUICK = {"starts": 1, "search": "restarts", "max_iterations": 4}


@pytest.fixture
def quick(tiny, few_limits):
    """Return a maker of runs that take a second or two."""
    return partial(tiny, robot=few_limits, design=QUICK)


@pytest.fixture
def run_file(quick, tmp_path):
    path = tmp_path / "input.yaml"
    path.write_text(json.dumps(quick()), encoding="utf-8")
    return path


def states(folder):
    return {
        path: (path.stat().st_mtime_ns, path.read_bytes())
        for path in folder.rglob("*")
        if path.is_file()
    }


def coefficients(folder):
    record = json.loads((folder / "design.json").read_text(encoding="utf-8"))
    parts = [np.ravel(record[key]) for key in ("omega", "lambda0", "mu", "nu")]
    return np.concatenate([*parts, [record["log_det_information"]]])


def test_a_run_is_resumed_and_repeated_from_its_folder(
    expdesign, run_file, quick, tmp_path, cheap_finish
):
    folder = tmp_path / "first"
    status, out, messages = expdesign("run", run_file, "--out", folder)
    assert status == 0
    assert "log det F" in out
    assert "strut length" in out
    assert "3 periods of" in out
    assert "Traceback" not in messages
    before = states(folder)
    assert {"design.json", "measurement.csv", "truth.json"} <= {path.name for path in before}

    # Again: nothing to do, in a process of its own.
    again = subprocess.run(
        [
            *(sys.executable, "-c", "from expdesign.cli import main; main()"),
            *("run", str(run_file), "--out", str(folder), "--json"),
        ],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        check=False,
    )
    assert again.returncode == 0
    assert "design: done already" in again.stderr
    assert "experiment: done already" in again.stderr
    assert json.loads(again.stdout) == {
        "status": 0,
        "folder": str(folder),
        "resumed": True,
        "stages": {"design": {"resumed": True}, "experiment": {"resumed": True}},
    }
    assert states(folder) == before

    # A file that is missing makes the stage run again, to the same end.
    (folder / "tables" / "limits.csv").unlink()
    status, out, messages = expdesign("run", run_file, "--out", folder, "--json")
    assert status == 0
    answer = json.loads(out)
    assert not answer["resumed"]
    assert answer["stages"]["design"]["design_status"] in {"converged", "not converged"}
    assert answer["stages"]["experiment"] == {"resumed": True}
    assert "design: done already" not in messages
    assert "experiment: done already" in messages
    after = states(folder)
    assert set(after) == set(before)
    for path, (_, content) in after.items():
        if path.suffix == ".csv":
            assert content == before[path][1], path.name

    # Another disturbance is another experiment with the same design.
    other = run_file.with_name("other.yaml")
    disturbed = {"drift": "1 mm", "seed": 5}
    other.write_text(json.dumps(quick(experiment=disturbed)), encoding="utf-8")
    _, out, _ = expdesign("run", other, "--out", folder, "--json")
    stages = json.loads(out)["stages"]
    assert stages["design"] == {"resumed": True}
    assert not stages["experiment"]["resumed"]
    assert (folder / "measurement.csv").read_bytes() != before[folder / "measurement.csv"][1]
    assert json.loads(expdesign("run", other, "--out", folder, "--json")[1])["resumed"]
    assert expdesign("run", run_file, "--out", folder)[0] == 0
    assert (folder / "measurement.csv").read_bytes() == before[folder / "measurement.csv"][1]

    # The resolved configuration in the folder gives the same design.
    second = tmp_path / "second"
    assert expdesign("run", folder / "run.yaml", "--out", second)[0] == 0
    np.testing.assert_array_equal(coefficients(second), coefficients(folder))
    assert (second / "run.yaml").read_bytes() == (folder / "run.yaml").read_bytes()


def test_the_configuration_follows_though_all_is_kept(
    expdesign, run_file, quick, tmp_path, cheap_finish
):
    folder = tmp_path / "out"
    assert expdesign("run", run_file, "--out", folder)[0] == 0
    manifest = (folder / "manifest.json").read_bytes()
    # What no stage of the run is made from is no reason to do one again.
    described = run_file.with_name("described.yaml")
    described.write_text(json.dumps(quick(description="Again")), encoding="utf-8")
    status, out, _ = expdesign("run", described, "--out", folder, "--json")
    assert (status, json.loads(out)["resumed"]) == (0, True)
    assert load_run(folder / "run.yaml").run.description == "Again"
    # Nor is it one that the file is gone, or was changed by hand.
    for spoil in (Path.unlink, lambda file: file.write_text("name: none\n", encoding="utf-8")):
        spoil(folder / "run.yaml")
        assert json.loads(expdesign("run", run_file, "--out", folder, "--json")[1])["resumed"]
        text = (folder / "run.yaml").read_text(encoding="utf-8")
        assert text == resolved_yaml(load_run(run_file))
    assert (folder / "manifest.json").read_bytes() == manifest


@pytest.fixture
def seen(monkeypatch):
    """Let every stage note that it was asked for, and do nothing."""
    asked = []

    def perform(stage, work):
        asked.append((stage.name, work.configuration.run.name, work.folder))
        work.made[stage.name] = Outcome(stage.name, work.folder, True)

    monkeypatch.setattr("expdesign.stages.run.execute", perform)
    monkeypatch.setattr("expdesign.stages.run.input_hash", lambda *_: "")
    return asked


def test_the_run_folder_is_named_after_the_run(expdesign, run_file, tmp_path, seen, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert expdesign("run", run_file, "--json")[0] == 0
    folder = tmp_path / "runs" / "tiny"
    assert seen == [("design", "tiny", folder), ("experiment", "tiny", folder)]


def test_only_what_is_named_is_done(expdesign, tiny, tmp_path, seen):
    path = tmp_path / "input.yaml"
    data = tiny(design=QUICK)
    del data["experiment"]
    path.write_text(json.dumps(data), encoding="utf-8")
    assert expdesign("run", path, "--out", tmp_path)[0] == 0
    assert [stage for stage, *_ in seen] == ["design"]


def test_nothing_is_simulated_when_data_is_given(expdesign, tiny, tmp_path, seen):
    path = tmp_path / "input.yaml"
    path.write_text(json.dumps(tiny(data={"file": "measured.csv"})), encoding="utf-8")
    status, _, messages = expdesign("run", path, "--out", tmp_path)
    assert status == 0
    assert [stage for stage, *_ in seen] == ["design"]
    assert "experiment: left out" in messages
    assert "measured.csv" in messages


def test_an_experiment_without_a_design(expdesign, tmp_path):
    path = tmp_path / "input.yaml"
    path.write_text("name: a\nrobot: palida\nexperiment: {periods: 2}\n", encoding="utf-8")
    status, out, messages = expdesign("run", path, "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert "no design.json" in messages
    assert not (tmp_path / "out").exists()


MONTECARLO = "name: a\nrobot: palida\nexperiment: {periods: 2}\nmontecarlo: {repetitions: 3}\n"


def test_check_refuses_the_motions_that_run_refuses(expdesign, tmp_path, seen):
    path = tmp_path / "input.yaml"
    still = "{motion: line, poses: [[0, 0, -0.6, 0, 0, 0], [0, 0, -0.6, 0, 0, 0]]}"
    path.write_text(f"{MONTECARLO}design: {{}}\nvalidate: [{still}]\n", encoding="utf-8")
    for command in (("check", path), ("run", path, "--out", tmp_path / "out")):
        status, out, messages = expdesign(*command)
        assert (status, out) == (2, "")
        assert "validate[1]" in messages
    assert seen == []


def test_a_run_without_a_design_says_what_to_name(expdesign, tmp_path, monkeypatch, seen):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "input.yaml"
    path.write_text(MONTECARLO, encoding="utf-8")
    status, _, messages = expdesign("run", path)
    assert status == 2
    assert "experiment and montecarlo need a design" in messages
    assert "`design:` in the run file" in messages
    assert "--design" not in messages
    status, _, messages = expdesign("check", path)
    assert status == 0
    assert "expdesign run refuses this file" in messages
    assert "experiment and montecarlo need a design" in messages
    warnings = json.loads(expdesign("check", path, "--json")[1])["warnings"]
    assert any("need a design" in warning for warning in warnings)
    assert seen == []
    path.write_text(path.read_text(encoding="utf-8") + "design: {}\n", encoding="utf-8")
    assert "need a design" not in expdesign("check", path)[2]


def test_check_says_what_run_does(expdesign, tmp_path, seen):
    path = tmp_path / "input.yaml"
    sweep = "sweep: {design.seed: [0, 1]}\ndesign: {}\nreport: {}\n"
    path.write_text(MONTECARLO + sweep, encoding="utf-8")
    status, _, messages = expdesign("check", path)
    assert status == 0
    assert "expdesign run does: sweep, report" in messages
    left_out = [line for line in messages.splitlines() if "left out, the sweep" in line]
    assert [line.split(": ")[1] for line in left_out] == ["design", "experiment", "montecarlo"]
    assert json.loads(expdesign("check", path, "--json")[1])["run_does"] == ["sweep", "report"]


@pytest.mark.parametrize("text", ["", "name: a\nrobot: nowhere\n", "name: a\nrobott: palida\n"])
def test_bad_input(expdesign, tmp_path, text):
    path = tmp_path / "run.yaml"
    path.write_text(text, encoding="utf-8")
    status, out, messages = expdesign("run", path, "--out", tmp_path / "out")
    assert (status, out) == (2, "")
    assert "error: " in messages
    assert "Traceback" not in messages
    assert not (tmp_path / "out").exists()


def test_a_run_that_ships_is_found_by_its_name(expdesign, tmp_path, seen):
    """It is loaded; what it would compute is left out here."""
    assert expdesign("run", "palida-quick", "--out", tmp_path / "out")[0] == 0
    assert seen == [("design", "palida-quick", tmp_path / "out")]


def test_a_report_of_a_run_file_names_its_folder(expdesign, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "machine.yaml"
    file.write_text("name: lab\nrobot: palida\n", encoding="utf-8")
    folder = str(Path("runs") / "lab")
    assert folder in _refused(expdesign("report", file))
    (tmp_path / folder).mkdir(parents=True)
    assert folder in _refused(expdesign("report", "machine.yaml"))
    assert str(Path("runs") / "palida") in _refused(expdesign("report", "palida"))
    # What is no run is just no folder.
    file.write_text("name: lab\n", encoding="utf-8")
    assert folder not in _refused(expdesign("report", file))
    assert "runs" not in _refused(expdesign("report", "nowhere"))


def _refused(answer):
    status, _, messages = answer
    assert status == 2
    return messages
