"""A stage from another package: in a run, on the screen, in the report and in a comparison."""

import json
import os
import subprocess
import sys
import textwrap

import pytest

from constraints.plugins import GROUP
from tests.docs.pages import ROOT

MODULE = '''
    """A stage that weighs the platform."""

    from dataclasses import dataclass
    from typing import Annotated, ClassVar

    from expdesign.configuration import StageSection
    from expdesign.runfolder import StageResult, described
    from expdesign.stages.stage import Outcome, Stage, StageFunctions, run_sections
    from results.views.folder import StageViews
    from results.views.view import Fact, Level, ReportTable, StageVerdict, StageView, TableColumn


    class WeightSection(StageSection):
        key = "weight"
        gravity: float = 9.81


    @dataclass(frozen=True, eq=False, kw_only=True)
    class WeightResult(StageResult):
        FILE: ClassVar[str] = "weight.json"
        WRITTEN_BY: ClassVar[str] = "`expdesign run`"
        weight: Annotated[float, described("N", "weight of the platform")]


    class WeightStage(Stage):
        name = "weight"
        does = "weighs the platform"
        file = "weight.json"
        compared = "weight.json"
        sections = run_sections("weight")

        def functions(self):
            return StageFunctions(weigh, StageViews(WeightResult, weight_view))


    def weigh(work):
        mass = work.configuration.robot.parameters["p10"]
        result = WeightResult(weight=mass * work.configuration.run.section("weight").gravity)
        return Outcome(result=result, summary={"weight": result.weight})


    def weight_view(folder):
        result = folder.result(WeightResult)
        sentence = "The platform is heavy."
        verdict = StageVerdict("Weight", Level.GOOD, "weighed", sentence, "weight")
        column = TableColumn("weight", "N", of="weight")
        table = ReportTable.of("weights", "Weights", (column,), [result], screen=True)
        return StageView(verdict, (table,), (Fact("weight", f"{result.weight:.1f} N"),))
'''


@pytest.fixture
def expdesign(tmp_path):
    """Install the plug-in, and return a maker of commands in a process with it."""
    (tmp_path / "weighing.py").write_text(textwrap.dedent(MODULE), encoding="utf-8")
    about = tmp_path / "weighing-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: weighing\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{GROUP}]\nweighing = weighing\n")
    environment = os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}"}

    def command(*arguments):
        line = [sys.executable, "-m", "expdesign", *map(str, arguments)]
        made = subprocess.run(
            line, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert made.returncode == 0, made.stderr
        return made.stdout + made.stderr

    return command


@pytest.mark.slow
def test_a_stage_of_a_plugin(expdesign, tmp_path):
    for name, gravity in (("earth", 9.81), ("moon", 1.62)):
        run = {"name": name, "robot": "palida", "weight": {"gravity": gravity}, "report": {}}
        (tmp_path / f"{name}.yaml").write_text(json.dumps(run), encoding="utf-8")
    assert "expdesign run does: weight, report" in expdesign("check", "earth.yaml")

    said = expdesign("run", "earth.yaml")
    assert "Weight: weighed. The platform is heavy." in said
    assert "weight: 160.0 N" in said
    assert "Weights:" in said
    folder = tmp_path / "runs/earth"
    assert json.loads((folder / "weight.json").read_text())["weight"] == pytest.approx(159.97, 1e-3)
    assert set(json.loads((folder / "manifest.json").read_text())["stages"]) == {"weight", "report"}
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert 'id="weight"' in page
    assert 'id="table-weights"' in page
    assert "weight: done already" in expdesign("run", "earth.yaml")

    expdesign("run", "moon.yaml")
    expdesign("compare", folder, tmp_path / "runs/moon", "--out", "both")
    table = (tmp_path / "both/tables/compared_weight.csv").read_text(encoding="utf-8")
    assert table.splitlines()[2] == "weight,160.0 N,26.4 N"
