"""`expdesign.run` does what the command does; a stage hands its result to the next in memory."""

import json
import shutil
import signal
import sys
import traceback
from contextlib import contextmanager

import pytest
from typer.testing import CliRunner

import expdesign
from expdesign.cli.app import app
from expdesign.experiment import DesignResult
from expdesign.runfolder.lock import one_writer
from expdesign.runfolder.manifest import Manifest
from expdesign.stages.execution import record_added
from expdesign.stages.registry import DesignStage, stages
from expdesign.stages.stage import StageFunctions
from tests.stages.test_registry import assert_declared_files

TIMES = {"manifest.json", "report.html", "estimate.json"}
"""Files that hold how long something took, or the folder's own place."""


class Heard(expdesign.Progress):
    def __init__(self):
        self.stages, self.notes, self.warnings = [], [], []

    def warn(self, text):
        self.warnings.append(text)

    def note(self, text):
        self.notes.append(text)

    def finished(self, outcome):
        self.stages.append(outcome.stage)


@pytest.fixture
def run_of(tiny, tiny_result, tmp_path, monkeypatch):
    """Return a maker of a run file; its design is one that was made before."""
    monkeypatch.setattr("expdesign.stages.design.design", lambda *_: tiny_result)
    monkeypatch.setattr("results.render.figures.draw_figures", lambda *_, **__: ())

    def file(**sections):
        path = tmp_path / "input.yaml"
        path.write_text(json.dumps(tiny(**sections)), encoding="utf-8")
        return path

    return file


def timeless(data):
    if isinstance(data, dict):
        return {key: timeless(value) for key, value in data.items() if not key.endswith("seconds")}
    return data


def contents(folder):
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_python_does_what_the_command_does(run_of, tmp_path):
    file = run_of(estimate={"estimators": ["ls", "gm"]})
    heard = Heard()
    made = expdesign.run(file, out=tmp_path / "python", progress=heard)
    assert list(made.stages) == heard.stages == ["design", "experiment", "estimate"]
    assert made.folder == tmp_path / "python"
    assert made.stages["estimate"].result.estimators.keys() == {"ls", "gm"}
    assert assert_declared_files(made.folder) == set(made.stages)

    # The command, in two goes: the estimate takes the recording from its file.
    command = tmp_path / "command"
    runner = CliRunner()
    assert runner.invoke(app, ["design", str(file), "--out", str(command)]).exit_code == 0
    assert runner.invoke(app, ["simulate", str(file), "--out", str(command)]).exit_code == 0
    assert runner.invoke(app, ["run", str(file), "--out", str(command)]).exit_code == 0
    first, second = contents(made.folder), contents(command)
    assert first.keys() == second.keys()
    for name, content in first.items():
        if name not in TIMES:
            assert content == second[name], name
    one, other = (timeless(json.loads(found["estimate.json"])) for found in (first, second))
    assert one["estimators"] == other["estimators"]

    # Again: all is kept, and nothing is read into memory.
    heard = Heard()
    again = expdesign.run(file, out=made.folder, progress=heard)
    assert all(outcome.kept for outcome in again.stages.values())
    assert len(heard.notes) == 3
    assert contents(made.folder) == first


def test_no_stage_reads_what_the_run_has_just_written(run_of, tmp_path, monkeypatch):
    """Only the manifest does, to hash the files, and `columns.json`, to which all stages add."""
    folder, read = tmp_path / "out", []
    watching = [True]

    def watch(event, arguments):
        if watching and event == "open" and str(arguments[0]).startswith(str(folder)):
            path, mode, _ = arguments
            if isinstance(mode, str) and "r" in mode and "+" not in mode:
                callers = [f.filename for f in traceback.extract_stack()]
                if not any(name.endswith("manifest.py") for name in callers):
                    read.append(str(path).removeprefix(f"{folder}/"))

    sys.addaudithook(watch)
    try:
        motions = [{"motion": "circle", "periods": 3}]
        expdesign.run(run_of(estimate={"estimators": ["ls"]}, validate=motions), out=folder)
    finally:
        watching.clear()
    assert set(read) <= {"columns.json", "run.yaml", "manifest.json"}


def test_a_design_of_this_run_is_reported_from_memory(run_of, tmp_path, monkeypatch):
    given = []

    def write_report(folder, _stages, _configuration, results):
        given.extend(results)
        (folder / "report.html").touch()
        return [folder / "report.html"]

    monkeypatch.setattr("expdesign.stages.report.write_report", write_report)
    expdesign.run(run_of(report={}), out=tmp_path / "out")
    assert any(isinstance(result, DesignResult) for result in given)


def test_a_file_changed_after_the_report_is_said_and_reported_again(run_of, tmp_path):
    folder, file = tmp_path / "out", run_of(report={})
    added = folder / "added.txt"

    def again():
        heard = Heard()
        made = expdesign.run(file, out=folder, progress=heard)
        return made.stages["report"].kept, [w for w in heard.warnings if "by hand" in w]

    expdesign.run(file, out=folder)
    added.write_text("1")
    record_added(folder, [added], {})
    assert CliRunner().invoke(app, ["report", str(folder)]).exit_code == 0
    assert again() == (True, [])  # the page is that of a command
    added.write_text("2")
    said = ["added.txt was changed by hand"]
    assert [again(), again()] == [(False, said), (True, said)]
    added.write_text("1")
    assert again() == (False, [])


def test_a_warning_of_the_robot_is_told_once_in_a_folder(run_of, tmp_path):
    def warned(folder, **sections):
        heard = Heard()
        expdesign.run(run_of(**sections), out=folder, progress=heard)
        return [text for text in heard.warnings if "inconsistent" in text]

    folder = tmp_path / "out"
    (first,) = warned(folder)
    assert first in Manifest.read(folder).warnings
    assert warned(folder, experiment={"periods": 3}) == []
    assert warned(tmp_path / "other") == [first]


def test_a_run_that_fails(run_of, tmp_path, monkeypatch):
    def fail(_work):
        raise expdesign.StageFailed("no motion keeps the limits")

    failing = StageFunctions(fail, stages()["design"].views())
    monkeypatch.setattr(DesignStage, "functions", lambda _: failing)
    with pytest.raises(expdesign.StageFailed, match="no motion"):
        expdesign.run(run_of(), out=tmp_path / "out")


def test_a_run_ends_at_a_goal_that_is_not_reachable_as_often_as_it_is_repeated(run_of, tmp_path):
    file, folder = run_of(goals={"mass": "1e-9 %"}), tmp_path / "out"
    for _ in range(2):
        with pytest.raises(expdesign.StageFailed, match="do not reach mass"):
            expdesign.run(file, out=folder)
        assert statuses(folder) == {"design": "done", "goals": "not reachable"}
    made = expdesign.run(run_of(goals={"mass": "90 %"}), out=folder).stages
    assert [name for name, outcome in made.items() if outcome.kept] == ["design"]


class Impatient(expdesign.Progress):
    """Presses Ctrl-C, or sends another signal, when the first start of a search, or the second
    repetition, is done."""

    def __init__(self, number=signal.SIGINT):
        self.pressed, self.number = False, number

    def press(self):
        if not self.pressed:
            self.pressed = True
            signal.raise_signal(self.number)

    @contextmanager
    def search(self, configuration):
        yield lambda event: self.press() if event.phase == "done" else None

    @contextmanager
    def count(self, what):
        yield lambda done, total: self.press() if done == 2 else None


def statuses(folder):
    return {name: entry.status for name, entry in Manifest.known(folder).stages.items()}


def test_ctrl_c_in_the_search_of_a_run_leaves_the_best_so_far(
    tiny, cheap_finish, tmp_path, monkeypatch
):
    monkeypatch.setattr("results.render.figures.draw_figures", lambda *_, **__: ())
    folder = tmp_path / "out"
    with pytest.raises(expdesign.StageFailed, match="the best so far is saved and marked"):
        expdesign.run(
            tiny(design={"starts": 2, "search": "hopping", "hops": 8}),
            out=folder,
            progress=Impatient(),
        )
    assert statuses(folder) == {"design": "interrupted"}
    design = json.loads((folder / "design.json").read_text())
    assert design["status"] == "interrupted"
    assert len(design["solver"]["starts"]) == 2


def test_ctrl_c_in_the_study_of_a_run_leaves_what_is_done_and_the_run_goes_on(run_of, tmp_path):
    folder, study = tmp_path / "out", {"repetitions": 4, "estimators": ["ls"]}
    file = run_of(montecarlo=study)
    with pytest.raises(expdesign.StageFailed, match="after 2 of 4 repetitions"):
        expdesign.run(file, out=folder, progress=Impatient())
    found = statuses(folder)
    assert found["montecarlo"] == "interrupted"
    assert {found[name] for name in found if name != "montecarlo"} == {"done"}
    again = expdesign.run(file, out=folder)
    assert [name for name, outcome in again.stages.items() if not outcome.kept] == ["montecarlo"]
    assert len(again.stages["montecarlo"].result.repetitions) == 4
    assert set(statuses(folder).values()) == {"done"}


def test_bad_input():
    with pytest.raises(expdesign.InputError, match="needs a design"):
        expdesign.run({"name": "a", "robot": "palida", "experiment": {"periods": 2}})


def test_a_run_file_is_judged_under_the_lock(tmp_path, monkeypatch):
    folder = tmp_path / "out"
    folder.mkdir()
    run = {"name": "a", "robot": "palida", "experiment": {"periods": 2}}
    (folder / "run.yaml").write_text(json.dumps(run | {"design": {}}), encoding="utf-8")

    def one_writer_after_another(*arguments):
        (folder / "run.yaml").write_text(json.dumps(run), encoding="utf-8")
        return one_writer(*arguments)

    monkeypatch.setattr("expdesign.stages.run.one_writer", one_writer_after_another)
    with pytest.raises(expdesign.InputError, match="needs a design"):
        expdesign.run(folder / "run.yaml", out=folder)


def test_a_folder_that_is_removed_while_the_run_goes_on(run_of, tmp_path, monkeypatch):
    folder = tmp_path / "out"

    class Removing(expdesign.Progress):
        def finished(self, outcome):
            if outcome.stage == "design":
                shutil.rmtree(folder)

    file = run_of()
    with pytest.raises(expdesign.StageFailed, match="design"):
        expdesign.run(file, out=folder, progress=Removing())
    assert statuses(folder) == {"experiment": "done"}
    assert list(expdesign.run(file, out=folder).stages) == ["design", "experiment"]
