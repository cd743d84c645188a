"""A run folder of the version before files had formats: read, reported and compared as today's.

``format_0`` is what it wrote; figures, the controller table and most rows of the sampled motions
are left out.
"""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from expdesign.cli.app import app
from expdesign.cli.errors import run
from expdesign.configuration import InputError, load_run
from expdesign.experiment import DesignRecord
from expdesign.experiment.design_file import DesignFile
from expdesign.export.record import ExportsRecord
from expdesign.motion.record import RecordedMotion
from expdesign.runfolder.manifest import Manifest
from expdesign.stages.export import export_task
from expdesign.stages.record import stage_inputs
from expdesign.stages.workspace import Workspace
from tests.blank_figures import blank_figures
from tests.report.html import Page

OLD = Path(__file__).parent / "format_0"
STAGES = ["design", "export", "experiment", "noise", "montecarlo", "estimate", "validation"]


@pytest.fixture(autouse=True)
def _blank_figures():
    with blank_figures(filled=True):
        yield


@pytest.fixture
def old(tmp_path):
    shutil.copytree(OLD, tmp_path / "old")
    return tmp_path / "old"


def test_the_design_is_read():
    record = DesignRecord.read(OLD)
    document = json.loads((OLD / "design.json").read_text(encoding="utf-8"))
    assert "format" not in document
    assert record.summary.trajectory.omega == document["omega"]
    assert [start.best for start in record.summary.solver.starts] == [True, False]
    for check in record.checks:
        assert check.value == document["limits"][check.key]["value"]
    sign, log_det = np.linalg.slogdet(record.information)
    assert sign == 1
    assert log_det == pytest.approx(record.summary.log_det_information, rel=1e-6)


@pytest.mark.parametrize(("key", "value"), [("strut", "one"), ("time", "soon"), ("method", None)])
def test_what_is_said_of_a_limit_is_checked(key, value, tmp_path):
    document = json.loads((OLD / "design.json").read_text(encoding="utf-8"))
    document["limits"]["tilt"][key] = value
    (tmp_path / "design.json").write_text(json.dumps(document), encoding="utf-8")
    with pytest.raises(InputError) as caught:
        DesignFile.read(tmp_path)
    assert [problem.key for problem in caught.value.problems] == [f"limits.tilt.{key}"]


def test_its_stages_are_done_as_they_would_be_now(monkeypatch):
    manifest, run = Manifest.known(OLD), load_run(OLD / "run.yaml")
    monkeypatch.setattr("expdesign.stages.record.package_versions", lambda: manifest.versions)
    monkeypatch.setattr("expdesign.stages.export.package_versions", lambda: manifest.versions)
    work = Workspace(run, OLD)
    # The others read files of which rows are left out here.
    for name in ("design", "export", "experiment", "montecarlo"):
        assert stage_inputs(name, work) == manifest.stages[name].inputs, name
    monkeypatch.delattr("expdesign.stages.export.executable_motion")  # No ramp is searched.
    assert RecordedMotion.of(export_task(work).motion) == ExportsRecord.read(OLD).motion.ways


def test_it_is_reported(old, expdesign_says):
    status, output, _ = expdesign_says("report", old)
    assert status == 0, output
    page = Page((old / "report.html").read_text(encoding="utf-8"))
    assert set(STAGES) <= set(page.ids)
    assert (old / "figures/struts.svg").is_file()


def test_it_is_compared(old, tmp_path, expdesign_says):
    shutil.copytree(OLD, tmp_path / "other")
    out = tmp_path / "compared"
    status, output, _ = expdesign_says("compare", old, tmp_path / "other", "--out", out, "--quick")
    assert status == 0, output
    assert (out / "report.html").is_file()
    assert len((out / "tables/criteria.csv").read_text().splitlines()) == 3


@pytest.mark.parametrize("command", ["report", "compare"])
def test_a_newer_format_is_refused_with_both_numbers(old, tmp_path, command, capsys):
    path = old / "design.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps({**document, "format": 99}), encoding="utf-8")
    further = [OLD, "--out", tmp_path / "out"] if command == "compare" else []
    assert run(app, [str(argument) for argument in (command, old, *further)]) == 2
    message = capsys.readouterr().err
    assert "format 99" in message
    assert "up to 1" in message
    assert not (old / "report.html").exists()
