"""A run folder with one byte or one number changed: said, or harmless; never a traceback."""

import json
import shutil
from dataclasses import replace

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from expdesign.configuration import ComputationError, InputError
from expdesign.runfolder.manifest import Manifest
from expdesign.stages.registry import reported_stages
from results.views.folder import RunFolder
from results.views.view import Level

UNREAD = (".tex", ".html", ".jsonl")
"""Files that no command reads: they are written again, or their lines carry a hash."""
VALUES = [
    *(1e300, -1e300, 1e149, -1e149, 5e-324, -5e-324, 1e-160, 0, -1, 2**70, 10**400),
    *("text", "", None, [], {}, True, [[]], "1e400", float("nan"), float("inf")),
]


def change_byte(path):
    """Change the last digit of a file, or its middle byte."""
    content = bytearray(path.read_bytes())
    digits = [place for place, byte in enumerate(content) if chr(byte).isdigit()]
    place = digits[-1] if digits else len(content) // 2
    content[place] = ord("7") if content[place] != ord("7") else ord("3")
    path.write_bytes(content)


def changes(folder):
    opened = RunFolder.open(folder, reported_stages())
    return set(opened.changes.all)


def test_every_file_that_is_read_is_watched(folder):
    before = changes(folder)
    assert before == {"design.json was made by hand"}  # the fixture has written it
    known = Manifest.read(folder)
    written = {file for entry in known.stages.values() for file in entry.files}
    for file in sorted(written | {"run.yaml", "manifest.json"}):
        if file.endswith(UNREAD):
            continue
        path = folder / file
        content = path.read_bytes()
        change_byte(path)
        try:
            found = changes(folder)
        except InputError:
            found = {file}  # refused
        assert any(file in text for text in found - before), file
        path.write_bytes(content)
    assert changes(folder) == before


def test_a_changed_stage_keeps_no_good_verdict(folder):
    stages = reported_stages()
    kept = RunFolder.open(folder, stages).view("experiment")
    change_byte(folder / "measurement.csv")
    opened = RunFolder.open(folder, stages)
    verdict = opened.view("experiment").verdict
    assert kept.verdict.level is not Level.CAUTION
    assert (verdict.level, verdict.word) == (Level.CAUTION, "changed")
    assert "measurement.csv was changed by hand" in verdict.sentence
    assert opened.view("experiment").facts == ()
    assert "measurement.csv has changed since estimate.json was made" in changes(folder)


@pytest.mark.parametrize("content", [None, '{"format": 1}'])
def test_without_a_manifest_no_stage_makes_a_claim(content, folder):
    manifest = folder / "manifest.json"
    manifest.unlink()
    if content is not None:
        manifest.write_text(content, encoding="utf-8")
    opened = RunFolder.open(folder, reported_stages())
    for stage in ("design", "experiment"):
        view = opened.view(stage)
        assert view.verdict.level in (Level.CAUTION, Level.BAD)
        assert "there is no usable manifest.json" in view.verdict.sentence
        assert view.facts == ()


def test_another_force_in_the_run_file_is_said(folder, expdesign_says):
    file = folder / "run.yaml"
    text = file.read_text(encoding="utf-8")
    assert "actuator_force: 230" in text
    file.write_text(text.replace("actuator_force: 230", "actuator_force: 2300"), encoding="utf-8")
    status, said, _ = expdesign_says("certify", folder)
    assert status == 0
    assert "warning: run.yaml was changed by hand" in said
    status, said, _ = expdesign_says("report", folder)
    assert status == 0
    assert "run.yaml has changed since estimate.json was made" in said


def test_a_table_whose_inputs_changed_keeps_no_claim(folder, expdesign_says):
    status, said, _ = expdesign_says("export", folder, "--format", "csv")
    assert status == 0, said
    proofs = "limits proved"

    def exported():
        view = RunFolder.open(folder, reported_stages()).view("export")
        table = next(block for block in view.blocks if getattr(block, "key", "") == "read_back")
        place = [column.title for column in table.columns].index(proofs)
        return view, [row[place] for row in table.rows]

    view, proved = exported()
    at_rows = "yes; at the rows only: actuator force, strut acceleration"
    assert (view.verdict.word, proved) == ("checked", [at_rows])
    file, text = folder / "run.yaml", (folder / "run.yaml").read_text(encoding="utf-8")
    file.write_text(text.replace("actuator_force: 230", "actuator_force: 2300"), encoding="utf-8")
    view, proved = exported()
    assert (view.verdict.word, view.verdict.level, proved) == ("changed", Level.CAUTION, [None])
    assert "run.yaml has changed since exports/csv.csv was made" in view.verdict.sentence
    assert not [block for block in view.blocks if block.kind == "listing"]
    file.write_text(text, encoding="utf-8")

    change_byte(folder / "exports" / "csv.csv")
    assert "exports/csv.csv was changed by hand" in exported()[0].verdict.sentence
    shutil.copy(folder / "exports" / "csv.csv", folder / "exports" / "further.csv")
    texts = [block.text for block in exported()[0].blocks if block.kind == "text"]
    assert any("not checked: further.csv" in text for text in texts)


def keys_of(data, key=()):
    """Yield the keys of JSON data, of lists those of the first entries."""
    parts = data.items() if isinstance(data, dict) else enumerate(data[:3])
    for name, part in parts:
        yield (*key, name)
        if isinstance(part, dict | list):
            yield from keys_of(part, (*key, name))


def with_value(text, draw):
    """Return a JSON file with another value of one of its keys."""
    data = json.loads(text)
    *path, last = draw(st.sampled_from(list(keys_of(data))))
    place = data
    for key in path:
        place = place[key]
    place[last] = draw(st.sampled_from(VALUES))
    return json.dumps(data)


def with_cell(text, draw):
    """Return a table with another cell in one of its first rows."""
    lines = text.splitlines()
    number = draw(st.integers(min(1, len(lines) - 1), min(len(lines) - 1, 30)))
    cells = lines[number].split(",")
    value = draw(st.sampled_from(VALUES))
    cells[draw(st.integers(0, len(cells) - 1))] = "" if value is None else str(value)
    return "\n".join([*lines[:number], ",".join(cells), *lines[number + 1 :]]) + "\n"


def with_doubled_key(text, draw):
    """Return a JSON file with a key twice."""
    name = draw(st.sampled_from(list(json.loads(text))))
    return text.replace("{", "{" + json.dumps(name) + ": 1, ", 1)


def refuses_or_shows(folder):
    """Return whether the folder is refused; otherwise all its stages are shown."""
    try:
        opened = replace(RunFolder.open(folder, reported_stages()), brief=True)
        for name in opened.held:
            opened.view(name)
    except (InputError, ComputationError):
        return True
    return False


@pytest.mark.parametrize("examples", [10, pytest.param(60, marks=pytest.mark.slow)])
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_any_value_is_shown_or_refused(examples, folder):
    files = [path for path in folder.rglob("*") if path.suffix in {".json", ".csv"}]

    @settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.data())
    def change(data):
        path = data.draw(st.sampled_from(sorted(files)))
        text = path.read_text(encoding="utf-8")
        json_changes = st.sampled_from([with_value, with_value, with_doubled_key])
        edit = data.draw(json_changes) if path.suffix == ".json" else with_cell
        path.write_text(edit(text, data.draw), encoding="utf-8")
        try:
            refused = refuses_or_shows(folder)
            known_to_no_stage = path.name in {"columns.json", "manifest.json"}
            assert refused or known_to_no_stage or edit is not with_doubled_key
        finally:
            path.write_text(text, encoding="utf-8")

    change()
    assert not refuses_or_shows(folder)
