"""Extensions from outside, one file each: limit, criterion, term, two formats, a stage."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import textwrap
import threading

import pytest
from ruamel.yaml import YAML

from constraints.plugins import GROUP
from expdesign.library import robot_files
from tests.docs.pages import ROOT
from tests.tiny_run import tiny_run

MODULES = {
    "sway_limit": '''
        """Upper limit of the sum of the TCP's x and y."""

        from constraints import LimitDefinition

        LIMIT = LimitDefinition(
            key="sway",
            title="sway of the TCP",
            unit="m",
            kind="upper",
            requires=("position",),
            natural=lambda q: q["position"][0] + q["position"][1],
        )
    ''',
    "square_criterion": '''
        """Criterion: root of the trace of F⁻²."""

        import numpy as np

        from expdesign.information.criteria import Criterion, log_sum_exp

        CRITERION = Criterion(
            key="square",
            title="root of the trace of F⁻²",
            larger_is_better=False,
            flat=True,
            levels=(2.0,),
            value=lambda eigenvalues: float(np.sqrt(np.sum(eigenvalues**-2.0))),
            cost=lambda logs, level: log_sum_exp(logs, -level),
            from_cost=lambda cost, _, samples, __: float(np.exp(cost) / samples),
        )
    ''',
    "fifth_term": '''
        """Friction of the actuators with the fifth power of their speed."""

        import casadi as ca

        from expdesign.mechanism.term import (
            STRUT_SPEED,
            WEIGHT_SCALE,
            Columns,
            Parameter,
            Term,
            per_actuator,
        )

        TERM = Term(
            name="fifth_friction",
            place=85,
            meaning="friction of the actuators with the fifth power of their speed",
            parameters=per_actuator(
                Parameter("w", "N s^5/m^5", "friction per fifth power", WEIGHT_SCALE, default=0.0)
            ),
            columns=lambda instant: Columns(
                along=ca.diag(instant.kinematic["strut_speed"] ** 5)
            ),
            rates=(STRUT_SPEED,),
        )
    ''',
    "copied_format": '''
        """Controller table: CSV under a name of another package."""

        from dataclasses import replace

        from expdesign.export.formats.csv import FORMAT as CSV

        FORMAT = replace(CSV, name="lab", title="table of the laboratory", suffix=".lab")
    ''',
    "lab_reader": '''
        """Reader of recordings with the extension .rec."""

        from dataclasses import replace

        from estimation.data.readers import delimited

        FORMATS = (replace(delimited.FORMATS[0], title="recording", extensions=(".rec",)),)
    ''',
    "count_stage": '''
        """Stage that counts the parameters of the robot."""

        from dataclasses import dataclass
        from typing import Annotated, ClassVar

        from expdesign.configuration import StageSection
        from expdesign.runfolder import StageResult, described
        from expdesign.stages.stage import Outcome, Stage, StageFunctions, run_sections
        from results.views.folder import StageViews
        from results.views.view import (
            Fact,
            Level,
            ReportTable,
            StageVerdict,
            StageView,
            TableColumn,
        )


        class CountSection(StageSection):
            key = "count"
            factor: int = 1


        @dataclass(frozen=True, eq=False, kw_only=True)
        class CountResult(StageResult):
            FILE: ClassVar[str] = "count.json"
            WRITTEN_BY: ClassVar[str] = "`expdesign run`"
            count: Annotated[int, described("", "counted parameters, times the factor")]


        class CountStage(Stage):
            name = "count"
            does = "counts the parameters of the robot"
            file = "count.json"
            compared = "count.json"
            sections = run_sections("count")

            def functions(self):
                return StageFunctions(count_parameters, StageViews(CountResult, count_view))


        def count_parameters(work):
            run = work.configuration
            number = len(run.robot.parameters) * run.run.section("count").factor
            return Outcome(result=CountResult(count=number), summary={"count": number})


        def count_view(folder):
            result = folder.result(CountResult)
            verdict = StageVerdict("Count", Level.GOOD, "counted", "Parameters.", "count")
            column = TableColumn("parameters", of="count")
            table = ReportTable.of("counts", "Counts", (column,), [result], screen=True)
            return StageView(verdict, (table,), (Fact("count", str(result.count)),))
    ''',
}


SHELL = """
import contextlib, io, json, sys

from expdesign.cli.app import app, run
from tests.blank_figures import blank_figures

with blank_figures():
    for line in sys.stdin:
        said = io.StringIO()
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            status = run(app, json.loads(line))
        print(json.dumps([status, said.getvalue()]), flush=True)
"""
"""Executes command lines, and draws no figures: they are not of extensions."""


@pytest.fixture
def environment(tmp_path):
    """Install the plug-in, and return the environment of processes that have it."""
    about = tmp_path / "lab-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: lab\nVersion: 1.0\n")
    lines = [f"[{GROUP}]", *(f"{name} = {name}" for name in MODULES)]
    (about / "entry_points.txt").write_text("\n".join(lines) + "\n")
    for name, text in MODULES.items():
        (tmp_path / f"{name}.py").write_text(textwrap.dedent(text), encoding="utf-8")
    return os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{tmp_path}", "COLUMNS": "200"}


@pytest.fixture
def process(environment, tmp_path):
    """Return a way to start a process with the plug-in, a function that executes commands."""
    with contextlib.ExitStack() as started:

        def start():
            shell = subprocess.Popen(
                [sys.executable, "-c", SHELL],
                cwd=tmp_path,
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
            )
            started.enter_context(shell)
            started.callback(shell.kill)
            patience = threading.Timer(280, shell.kill)
            patience.start()
            started.callback(patience.cancel)

            def execute(*arguments):
                print(json.dumps(arguments), file=shell.stdin, flush=True)
                answer = shell.stdout.readline()
                assert answer, f"{arguments}: the process ended"
                status, said = json.loads(answer)
                assert status == 0, said
                return said

            return execute

        yield start


@pytest.mark.slow
def test_extensions_are_found_without_another_edit(process, environment, tmp_path):
    yaml = YAML(typ="safe")
    robot = yaml.load(robot_files()["palida"])
    robot["terms"] = ["rigid_platform", "struts", "passive_friction", "actuator_friction"]
    robot["terms"].append("fifth_friction")
    robot["limits"]["sway"] = 0.25
    yaml.dump(robot, tmp_path / "lab.yaml")
    run = tiny_run(
        robot="lab.yaml",
        design={"criterion": "square"},
        experiment={"seed": 3},
        estimate={"estimators": ["ls"]},
        count={"factor": 2},
        export=[{"format": "lab", "segment": "1 ms"}],
        report={"figures": ["svg"]},
    )
    yaml.dump(run, tmp_path / "run.yaml")
    expdesign = process()
    checked = expdesign("check", "run.yaml")
    assert all(word in checked for word in ("sway", "square", "fifth_friction", "lab", "count"))
    listed = expdesign("export", "--format", "list")
    assert "table of the laboratory" in " ".join(listed.split())

    said = expdesign("run", "run.yaml", "--out", "made")
    assert "Count: counted. Parameters." in said
    assert "Counts:" in said
    folder = tmp_path / "made"
    design = json.loads((folder / "design.json").read_text(encoding="utf-8"))
    assert design["limits"]["sway"]["certified"]
    assert design["criterion"] == "square"
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "root of the trace of F" in page
    assert 'id="count"' in page
    assert 'id="table-counts"' in page
    expdesign = process()
    assert "count: done already" in expdesign("run", "run.yaml", "--out", "made")
    robot_parameters = len(design["parameters"])
    assert json.loads((folder / "count.json").read_text())["count"] == 2 * robot_parameters
    assert list((folder / "exports").glob("*.lab"))
    assert '"w1"' in (folder / "estimate.json").read_text(encoding="utf-8")

    shutil.copy(folder / "measurement.csv", tmp_path / "day.rec")
    again = ("--data", "day.rec", "--design", "made", "--out", "again")
    expdesign("estimate", "run.yaml", *again)
    first, second = (
        (tmp_path / place / "estimates.csv").read_text() for place in ("made", "again")
    )
    assert first == second

    for name, factor in (("two", 2), ("three", 3)):
        alone = {"name": name, "robot": "palida", "count": {"factor": factor}, "report": {}}
        (tmp_path / f"{name}.yaml").write_text(json.dumps(alone), encoding="utf-8")
        expdesign("run", f"{name}.yaml", "--out", name)
    stages = json.loads((tmp_path / "two" / "manifest.json").read_text())["stages"]
    assert set(stages) == {"count", "report"}
    expdesign("compare", "two", "three", "--out", "both")
    table = (tmp_path / "both/tables/compared_count.csv").read_text(encoding="utf-8")
    shipped = len(yaml.load(robot_files()["palida"])["parameters"])
    assert table.splitlines()[2] == f"count,{2 * shipped},{3 * shipped}"

    manual = tmp_path / "manual.md"
    manual.write_text("<!-- count.json -->\n<!-- end -->\n", encoding="utf-8")
    line = [sys.executable, "-m", "expdesign.runfolder.documentation", manual]
    subprocess.run(line, cwd=tmp_path, env=environment, check=True)
    assert "counted parameters, times the factor" in manual.read_text(encoding="utf-8")
