"""Execution of a stage and its entry in the manifest: inputs, files, and whether it is done."""

import dataclasses
import json
from pathlib import Path

import pytest

from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.runfolder.manifest import Manifest, entry, file_hash, sections_text
from expdesign.stages import execution
from expdesign.stages.execution import add_to_files, execute, input_hash, origins
from expdesign.stages.export import _made_from as lead_inputs
from expdesign.stages.registry import DesignStage, stages
from expdesign.stages.stage import Outcome, StageFailed, StageFunctions, Workspace
from results.views.folder import StageViews
from results.views.view import Level, StageVerdict, StageView
from tests.estimation.cases import trajectory


class Unwritten:
    """A result without files."""

    def write(self, _folder):
        return []


VIEWS = StageViews(bool, lambda _: StageView(StageVerdict("", Level.GOOD, "", "")))


def configuration(**design):
    return load_run({"name": "test", "robot": "palida", "design": design})


@dataclasses.dataclass(frozen=True, eq=False)
class Work(Workspace):
    """A workspace whose stages are made from this text beside the run file."""

    text: str = ""

    def made_from(self, need):
        return self.text


def did(name, run, folder, text="", status="done", message="", **written):
    """Do a stage that writes these files, by path with double underscores in place of slashes."""

    def perform(work):
        files = []
        for key, content in written.items():
            path = folder / key.replace("__", "/").replace("_csv", ".csv").replace("_json", ".json")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)
            files.append(path)
        failure = "" if status == "done" else "it broke"
        return Outcome(
            name, folder, Unwritten(), None, tuple(files), {}, status, message, failure=failure
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(stages()[name]), "functions", lambda _: StageFunctions(perform, VIEWS))
        execute(stages()[name], Work(run, folder, text=text))


def is_done(name, run, folder, text=""):
    work = Work(run, folder, text=text)
    work.inputs[name] = input_hash(stages()[name], work)
    return execution.is_done(stages()[name], work)


def clear_outdated(name, run, folder, text=""):
    work = Work(run, folder, text=text)
    work.inputs[name] = input_hash(stages()[name], work)
    return execution.clear_outdated(name, work)


@pytest.fixture
def done(tmp_path):
    """Return a run folder in which a stage was done."""
    written = {"design_json": "this is it", "tables__limits_csv": "these are they"}
    did("design", configuration(), tmp_path, message="all is well", **written)
    return tmp_path


def test_a_stage_that_was_done_is_known(done):
    assert is_done("design", configuration(), done)


def test_what_the_manifest_says(done):
    data = json.loads((done / Manifest.FILE).read_text())
    assert data["seeds"] == {"design": 0, "experiment": 1, "montecarlo": 0}
    for package in ("python", "expdesign", "casadi", "numpy"):
        assert data["versions"][package]
    stage = data["stages"]["design"]
    assert (stage["status"], stage["message"]) == ("done", "all is well")
    assert stage["seconds"] >= 0
    assert stage["finished"].endswith("+00:00")
    assert stage["inputs"] == input_hash(stages()["design"], Work(configuration(), done))
    assert stage["files"] == {
        "design.json": file_hash(done / "design.json"),
        "tables/limits.csv": file_hash(done / "tables" / "limits.csv"),
    }


def test_a_file_to_which_a_command_added(done):
    file, other = done / "design.json", done / "tables" / "limits.csv"
    with add_to_files(done, (file, done / "new")):
        file.write_text("more")
        (done / "new").write_text("of no stage")
    assert is_done("design", configuration(), done)
    assert set(Manifest.known(done).stages["design"].files) == {"design.json", "tables/limits.csv"}
    # What was changed before is not taken for the stage's.
    other.write_text("changed")
    with add_to_files(done, (file, other)):
        other.write_text("changed and more")
    assert not is_done("design", configuration(), done)
    (done / Manifest.FILE).unlink()
    with add_to_files(done, (file,)):
        file.write_text("even more")
    assert not (done / Manifest.FILE).exists()


@pytest.mark.parametrize("file", ["design.json", "tables/limits.csv"])
def test_a_file_that_was_changed_or_deleted_is_noticed(done, file):
    original = (done / file).read_text()
    (done / file).write_text(original + " ")
    assert not is_done("design", configuration(), done)
    (done / file).unlink()
    assert not is_done("design", configuration(), done)
    (done / file).mkdir()
    assert not is_done("design", configuration(), done)
    (done / file).rmdir()
    (done / file).write_text(original)
    assert is_done("design", configuration(), done)


def test_another_file_is_no_business_of_the_stage(done):
    (done / "notes.txt").write_text("mine")
    assert is_done("design", configuration(), done)


@pytest.mark.parametrize(
    "changed", [{"seed": 1}, {"starts": 3}, {"criterion": "a"}, {"parameters": ["p1"]}]
)
def test_a_changed_configuration_is_noticed(done, changed):
    assert not is_done("design", configuration(**changed), done)


def test_writing_a_default_out_is_no_change(done):
    assert is_done("design", configuration(seed=0, criterion="d"), done)


def test_another_version_is_noticed(done, monkeypatch):
    monkeypatch.setattr("expdesign.runfolder.manifest.version", lambda _package: "99")
    assert not is_done("design", configuration(), done)


@pytest.mark.parametrize("status", ["failed", "interrupted", "limits broken"])
def test_a_stage_that_was_not_done_is_done_again(tmp_path, status):
    with pytest.raises(StageFailed, match="it broke"):
        did("design", configuration(), tmp_path, status=status, design_json="half")
    assert not is_done("design", configuration(), tmp_path)
    assert Manifest.known(tmp_path).stages["design"].status == status


def test_a_stage_that_raises_leaves_no_entry(tmp_path, monkeypatch):
    def fail(_work):
        raise ValueError("no design")

    monkeypatch.setattr(DesignStage, "functions", lambda _: StageFunctions(fail, VIEWS))
    with pytest.raises(ValueError, match="no design"):
        execute(stages()["design"], Work(configuration(), tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_an_interruption_before_there_is_a_result_is_in_the_manifest(tmp_path, monkeypatch):
    def interrupt(_work):
        raise KeyboardInterrupt

    monkeypatch.setattr(DesignStage, "functions", lambda _: StageFunctions(interrupt, VIEWS))
    with pytest.raises(KeyboardInterrupt):
        execute(stages()["design"], Work(configuration(), tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]
    found = Manifest.known(tmp_path).stages["design"]
    assert (found.status, found.files) == ("interrupted", {})


def test_a_stage_that_fails_leaves_the_configuration_as_it_was(done, monkeypatch):
    def fail(_work):
        raise StageFailed("no motion keeps the limits")

    before = (done / "run.yaml").read_bytes()
    monkeypatch.setattr(DesignStage, "functions", lambda _: StageFunctions(fail, VIEWS))
    with pytest.raises(StageFailed):
        execute(stages()["design"], Work(configuration(seed=9), done))
    assert (done / "run.yaml").read_bytes() == before
    found = Manifest.known(done).stages["design"]
    assert (found.status, found.message, found.files) == (
        "failed",
        "no motion keeps the limits",
        {},
    )


def test_no_stage_is_done_in_an_empty_folder(tmp_path):
    assert Manifest.known(tmp_path) is None
    assert not is_done("design", configuration(), tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"format": 1}',
        '{"format": 1, "versions": {}, "seeds": {}, "evaluation": "", "stages": {"x": {"a": 1}}}',
        '{"format": 1, "versions": {}, "seeds": {}, "evaluation": "", "stages": {"design": 3}}',
    ],
)
def test_a_manifest_that_cannot_be_used_is_as_none(tmp_path, text):
    (tmp_path / Manifest.FILE).write_text(text)
    assert Manifest.known(tmp_path) is None
    assert not is_done("design", configuration(), tmp_path)


def test_stages_are_kept_side_by_side(done):
    manifest = Manifest.known(done)
    other = entry("done", "inputs", 1.23456, "", done, [])
    manifest.with_stage("estimate", other).write(done)
    again = Manifest.known(done)
    assert set(again.stages) == {"design", "estimate"}
    assert again.stages["estimate"] == dataclasses.replace(other, seconds=1.235)
    assert is_done("design", configuration(), done)


def test_what_else_a_stage_is_made_from_is_noticed(tmp_path):
    run = load_run({"name": "test", "robot": "palida", "experiment": {}})
    did("experiment", run, tmp_path, "a design", measurement_csv="measured")
    assert is_done("experiment", run, tmp_path, "a design")
    assert not is_done("experiment", run, tmp_path, "another design")
    assert not is_done("experiment", run, tmp_path)


@pytest.mark.parametrize(
    ("changed", "design", "experiment"),
    [
        ({}, True, True),
        ({"design": {"seed": 3}}, False, True),
        ({"experiment": {"seed": 3}}, True, False),
        ({"experiment": {"drift": 1e-4}}, True, False),
        ({"experiment": {"cogging": {"amplitude": 1, "pitch": 0.03}}}, True, False),
        ({"experiment": {"periods": 3}}, False, False),
        ({"noise": {"force_std": [1, 1, 1, 1, 1, 1]}}, False, False),
        ({"montecarlo": {"repetitions": 3}}, True, True),
        # The simulated file has the form that the run reads.
        ({"data": {"sign": {"Q": [-1, 1, 1, 1, 1, 1]}}}, True, False),
        ({"data": {"units": {"q": "mm"}}}, True, False),
    ],
)
def test_each_stage_depends_on_its_own_sections(changed, design, experiment):
    first, second = (load_run({"name": "n", "robot": "palida", **c}) for c in ({}, changed))
    for stage, same in (("design", design), ("experiment", experiment)):
        one, other = (input_hash(stages()[stage], Work(run, Path())) for run in (first, second))
        assert (one == other) == same


@pytest.mark.parametrize(
    ("changed", "same"),
    [
        ({"estimators": ["ml"]}, True),
        ({"estimators": ["gm"]}, False),
        ({"systematic": "budget"}, False),
        ({"systematic": "none"}, False),
        ({"harmonics": 8}, False),
    ],
)
def test_a_design_depends_on_the_treatment_of_tolerances(changed, same):
    for tolerances, alike in ((None, True), ({"gravity": "0.1 deg"}, same)):
        about = {"name": "n", "robot": "palida", "tolerances": tolerances}
        runs = (load_run(about | {"estimate": keys}) for keys in ({}, changed))
        one, other = (input_hash(stages()["design"], Workspace(run, Path())) for run in runs)
        assert (one == other) == alike


def test_a_validation_depends_on_the_recorded_motions(tmp_path):
    recorded = tmp_path / "other.csv"
    motions = [{"motion": "circle"}, {"motion": "file", "file": str(recorded)}]
    run = load_run({"name": "n", "robot": "palida", "validate": motions})
    hashes = set()
    for content in ("measured", "measured again"):
        recorded.write_text(content)
        work = Workspace(run, tmp_path)
        assert str(recorded) in {str(tmp_path / one) for one in origins(stages()["validate"], work)}
        hashes.add(input_hash(stages()["validate"], work))
    assert len(hashes) == 2
    assert origins(stages()["validate"], work)[recorded.name] == file_hash(recorded)


def test_a_design_for_a_task_depends_on_its_motion(tmp_path):
    file = tmp_path / "design.json"
    file.write_text("a motion")
    section = {"interest": {"task": str(tmp_path)}, "criterion": "a"}
    run = load_run({"name": "n", "robot": "palida", "design": section})
    before = input_hash(stages()["design"], Workspace(run, tmp_path / "run"))
    file.write_text("another motion")
    assert input_hash(stages()["design"], Workspace(run, tmp_path / "run")) != before


@pytest.mark.parametrize(
    "changes",
    [
        {"sweep": {"trajectory.harmonics": [2, 3]}, "design": {"others": ["other.json"]}},
        {"sweep": {"design.others": [[], ["other.json"]]}},
    ],
)
def test_a_sweep_depends_on_the_other_motions_of_its_designs(tmp_path, monkeypatch, changes):
    monkeypatch.chdir(tmp_path)
    run = load_run({"name": "n", "robot": "palida"} | changes)
    hashes = set()
    for content in ("a motion", "another motion"):
        (tmp_path / "other.json").write_text(content)
        hashes.add(input_hash(stages()["sweep"], Workspace(run, tmp_path / "run")))
    assert len(hashes) == 2


@pytest.mark.parametrize("stage", ["estimate", "noise"])
def test_a_recording_in_a_folder_is_all_its_files(tmp_path, stage):
    bag = tmp_path / "bag"
    bag.mkdir()
    run = load_run({"name": "n", "robot": "palida", "data": {"file": str(bag)}})
    hashes = set()
    for content in ("measured", "measured again"):
        (bag / "metadata.yaml").write_text("the same")
        (bag / "bag_0.mcap").write_text(content)
        hashes.add(input_hash(stages()[stage], Workspace(run, tmp_path / "run")))
    assert len(hashes) == 2


@pytest.mark.parametrize(
    ("stage", "changed"),
    [
        ("estimate", {"goals": {"mass": "1 %"}}),
        ("estimate", {"design": {"interest": ["mass"]}}),
        ("noise", {"estimate": {"frequency": "estimated"}}),
    ],
)
def test_an_analysis_depends_on_what_it_names_and_on_its_frequency(stage, changed):
    """The diagnosis states what undetected causes change in the quantities of the goals."""
    about = {"name": "n", "robot": "palida", "data": {"file": "recording.csv"}}
    one, other = (
        input_hash(stages()[stage], Workspace(load_run(about | keys), Path()))
        for keys in ({}, changed)
    )
    assert one != other


def test_predictions_and_lead_in_depend_on_the_payload():
    """It changes the nominal parameters: forces, tolerances' effects and relative goals."""
    palida = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    about = {"name": "n", "robot": palida | {"platform": "general"}, "goals": {"mass": "1 %"}}
    bodies = [{"mass": "3 kg", "centre": [0, 0, 0.1]}]
    runs = [load_run(about | {"experiment": keys}) for keys in ({}, {"payload": bodies})]
    for stage in ("design", "next", "goals", "sweep", "export"):
        one, other = (sections_text(run, stages()[stage].sections) for run in runs)
        assert one != other, stage
    assert len({lead_inputs(run, trajectory()) for run in runs}) == 2


def test_predictions_depend_on_what_is_recorded_as_forces():
    palida = load_robot_description("palida").description.model_dump(mode="json", by_alias=True)
    motor = {"force_constant": "90 N/A", "resistance": "2 ohm"}
    about = {
        "name": "n",
        "robot": palida | {"drive": {"motor": motor}},
        "tolerances": {"motor": {"constant": {"each": "1 %"}}},
    }
    runs = [load_run(about | {"data": data}) for data in ({}, {"units": {"Q": "V"}})]
    for stage in ("design", "next", "goals", "sweep"):
        own = stages()[stage]
        recipes = [
            (
                sections_text(run, own.sections),
                "tolerances" in own.needs and Workspace(run, Path()).made_from("tolerances"),
            )
            for run in runs
        ]
        assert recipes[0] != recipes[1], stage


def test_a_stage_with_another_seed_keeps_the_entries_of_the_others(done):
    run = load_run({"name": "test", "robot": "palida", "experiment": {"seed": 7}})
    did("experiment", run, done)
    assert is_done("design", run, done)
    assert Manifest.known(done).seeds["experiment"] == 7


def test_a_file_to_which_two_stages_add_counts_for_both(done):
    shared, run = done / "design.json", configuration()
    did("experiment", run, done, design_json="both", measurement_csv="its own")
    assert is_done("design", run, done)
    assert is_done("experiment", run, done)
    assert "measurement.csv" not in Manifest.known(done).stages["design"].files
    shared.write_text("changed by hand")
    assert not is_done("design", run, done)
    assert not is_done("experiment", run, done)


@pytest.fixture
def measured(done):
    """Return the folder in which a second stage wrote a file of its own and a shared one."""
    written = {"design_json": "both", "repetitions__0001__measurement_csv": "measured"}
    did("experiment", configuration(), done, **written)
    return done


def test_what_was_made_from_the_same_is_kept(measured):
    kept = clear_outdated("experiment", configuration(), measured)
    own = measured / "repetitions" / "0001" / "measurement.csv"
    assert kept == {measured / "design.json", own}
    own.write_text("changed by hand")
    assert clear_outdated("experiment", configuration(), measured) == {measured / "design.json"}
    assert own.read_text() == "changed by hand"


def test_what_is_outdated_is_removed_unless_others_need_it(measured):
    assert clear_outdated("experiment", configuration(), measured, "another design") == set()
    assert not (measured / "repetitions" / "0001").exists()
    assert (measured / "design.json").exists()
    assert is_done("design", configuration(), measured)


def test_nothing_outside_of_the_folder_is_removed(measured, tmp_path_factory):
    outside = tmp_path_factory.mktemp("outside") / "mine.txt"
    outside.write_text("mine")
    manifest = Manifest.known(measured)
    files = {str(outside): file_hash(outside)}
    stage = dataclasses.replace(manifest.stages["experiment"], files=files)
    manifest.with_stage("experiment", stage).write(measured)
    assert clear_outdated("experiment", configuration(), measured, "another design") == set()
    assert outside.exists()
