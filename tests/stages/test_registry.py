"""The registered stages agree with their results, the run file and the report."""

import json
from fnmatch import fnmatch

import pytest

from expdesign.configuration import RunDescription, load_run
from expdesign.configuration.run import stage_keys
from expdesign.runfolder import StageResult
from expdesign.runfolder.manifest import Manifest
from expdesign.runfolder.store import members
from expdesign.stages.execution import input_hash
from expdesign.stages.registry import missing_design, reported_stages, stages
from expdesign.stages.stage import Workspace

NEEDS = {"design", "others", "recording", "estimate", "validation", "tolerances", "folder"}

CHANGED = {
    "name": "other",
    "trajectory": {"harmonics": 4},
    "design": {"parameters": ["p1", "p2"]},
    "goals": {"mass": "1 %"},
    "motion": {"jerk": 900.0},
    "experiment": {"periods": 3},
    "data": {"delimiter": ";"},
    "montecarlo": {"repetitions": 7},
    "estimate": {"estimators": ["ls"]},
    "validate": [{"motion": "circle"}],
    "feedforward": {"bandwidth": 8.0},
    "sweep": {"design.seed": [0, 1]},
    "export": ["csv"],
    "report": {"title": "other"},
    "workers": 1,
}
"""For every key of a run file that a stage may depend on, something that it is not by default."""


def test_a_run_file_names_the_stages_of_the_table():
    unnamed = {"motions", "next", "noise"}
    assert tuple(stage for stage in stages() if stage not in unnamed) == stage_keys()


@pytest.mark.parametrize("name", stages())
def test_what_a_stage_names_is_there(name):
    stage = stages()[name]
    assert stage.name == name
    assert set(stage.needs) <= NEEDS
    assert set(stage.sections or ()) <= set(RunDescription.model_fields)
    assert {stage.after, stage.shown_after} <= {"", *stages()}


STORED = (
    "design",
    "next",
    "goals",
    "noise",
    "montecarlo",
    "estimate",
    "validate",
    "feedforward",
    "sweep",
)


@pytest.mark.parametrize("name", STORED)
def test_a_stage_writes_what_its_result_holds(name):
    stage = stages()[name]
    kind = stage.views().result_type
    if issubclass(kind, StageResult):
        file, places = kind.FILE, ((each.place, each.kind) for each in members(kind) if each.place)
        tables = [table for place, found in places for table in place.tables(found, "")]
    else:
        (file,) = (found.FILE for found in kind.files().values())
        tables = kind.TABLES.values()
    assert file == stage.file
    for table in tables:
        assert any(fnmatch(table.file, pattern) for pattern in stage.writes)


def test_the_report_has_a_section_for_every_stage_but_its_own():
    found = reported_stages()
    assert set(found) == set(stages()) - {"report"}
    assert list(found)[:3] == ["design", "export", "next"]


@pytest.mark.parametrize("key", CHANGED)
def test_a_stage_is_made_from_the_sections_that_it_declares(key, monkeypatch, tmp_path):
    monkeypatch.setattr(Workspace, "made_from", lambda *_: "")
    base = {"name": "name", "robot": "palida"}
    one, other = (load_run(base | change) for change in ({}, {key: CHANGED[key]}))
    field = {"validate": "validation"}.get(key, key)
    for name, stage in stages().items():
        hashes = {input_hash(stage, Workspace(config, tmp_path)) for config in (one, other)}
        same = len(hashes) == 1
        part = None if stage.sections is None else stage.sections.get(field, False)
        if isinstance(part, set):
            assert same == (not part & set(CHANGED[key])), name
        else:
            assert same == (part is False), name


@pytest.mark.parametrize("motion", ["circle", "design"])
def test_the_feed_forward_of_a_design_is_made_from_it(motion, monkeypatch, tmp_path):
    designs = iter(["one", "another"])
    made = {"design": lambda: next(designs), "estimate": lambda: "the same"}
    monkeypatch.setattr(Workspace, "made_from", lambda _, need: made[need]())
    config = load_run({"name": "name", "robot": "palida", "feedforward": {"motion": motion}})
    one, other = (
        input_hash(stages()["feedforward"], Workspace(config, tmp_path)) for _ in range(2)
    )
    assert (one == other) == (motion == "circle")


def test_every_key_of_a_run_file_is_tried():
    keys = {field.alias or name for name, field in RunDescription.model_fields.items()}
    # The robot takes limits, noise and tolerances in; the others are not for results.
    taken_in = {"limits", "noise", "tolerances"}
    others = {"format", "robot", *taken_in, "description", "scheduler"}
    assert keys == set(CHANGED) | others


def test_who_needs_a_design(tmp_path):
    run = {"name": "name", "robot": "palida", "experiment": {}, "montecarlo": {}, "estimate": {}}
    problem = missing_design(load_run(run), tmp_path)
    assert problem.message.startswith("experiment and montecarlo need a design")
    assert missing_design(load_run(run | {"design": {}}), tmp_path) is None
    measured = {"name": "name", "robot": "palida", "data": {"file": "measured.csv"}, "estimate": {}}
    circle, design = (
        load_run(measured | {"feedforward": {"motion": motion}}) for motion in ("circle", "design")
    )
    assert missing_design(circle, tmp_path) is None
    assert "feedforward" in missing_design(design, tmp_path).message
    (tmp_path / "design.json").write_text("{}")
    assert missing_design(design, tmp_path) is None
    assert missing_design(load_run(run), tmp_path) is None


def assert_declared_files(folder):
    """Assert that every stage of a folder has written the files it declares, and no others."""
    for name, entry in Manifest.known(folder).stages.items():
        stage = stages()[name]
        declared = (stage.file, *stage.writes)
        stray = [f for f in entry.files if not any(fnmatch(f, d) for d in declared)]
        assert not stray, (name, stray)
        missing = [d for d in declared if "*" not in d and d not in entry.files]
        assert not missing, (name, missing)
    return set(json.loads((folder / "manifest.json").read_text())["stages"])
