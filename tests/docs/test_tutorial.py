"""Pages whose commands are executed in turn, with the outputs and numbers that they show."""

import shlex

import pytest

from expdesign.cli.app import app, run
from expdesign.configuration import load_run
from expdesign.configuration.robot import load_robot_description
from expdesign.library import robot_files, run_files
from tests.blank_figures import blank_figures
from tests.docs.pages import ROOT, fences, parse
from tests.docs.tutorial import agree, missing_line, stated_numbers, steps, value_of

PAGE = ROOT / "docs" / "tutorial.md"
OWN_MACHINE = ROOT / "docs" / "own-machine.md"
PAYLOAD = ROOT / "docs" / "payload.md"
FOLDER = "runs/tutorial"


@pytest.fixture
def execute_page(tmp_path, monkeypatch, capsys):
    """Execute a page in an empty folder and compare its outputs and numbers."""

    def execute(page, folder):
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("COLUMNS", "200")
        output = ""
        for step in steps(page):
            if step.kind == "file":
                (tmp_path / step.name).write_text(step.text, encoding="utf-8")
            elif step.kind == "script":
                exec(compile(step.text, page.name, "exec"), {})
            elif step.kind == "command":
                program, *arguments = shlex.split(step.text)
                assert program == "expdesign"
                with blank_figures(filled=True):
                    status = run(app, arguments)
                output = "".join(capsys.readouterr())
                assert status == 0, (step.text, output)
            else:
                assert missing_line(step.text, output) is None, output
        for stated in stated_numbers(page):
            value = value_of(stated, tmp_path / folder)
            assert agree(stated.shown, value), (stated, value)
        return tmp_path

    return execute


@pytest.mark.slow
def test_the_tutorial(execute_page):
    folder = execute_page(PAGE, FOLDER)
    figures = {path.stem for path in (folder / FOLDER / "figures").glob("*.svg")}
    assert {"path", "limits_used", "precision"} <= figures
    assert (folder / FOLDER / "report.html").is_file()
    assert (folder / "runs/comparison/report.html").is_file()
    assert (folder / FOLDER / "exports/README.txt").is_file()


def test_the_tutorial_has_every_step():
    commands = [step.text.split()[1] for step in steps(PAGE) if step.kind == "command"]
    expected = [
        "check",
        "design",
        "export",
        "simulate",
        "noise",
        "estimate",
        "validate",
        "report",
        "design",
        "compare",
    ]
    assert commands == expected
    assert len(stated_numbers(PAGE)) > 30


@pytest.mark.slow
def test_from_a_drawing_to_an_identified_robot(execute_page):
    folder = execute_page(OWN_MACHINE, "runs/press-measured")
    commands = [step for step in steps(OWN_MACHINE) if step.kind == "command"]
    assert len(commands) < 20
    assert (folder / "runs/press/exports/first-scale-0.3.csv").is_file()
    found = load_robot_description(folder / "runs/press-measured/identified-robot.yaml")
    assert found.description.identification.verdict == "accepted"


@pytest.mark.slow
def test_a_payload_in_seconds(execute_page):
    folder = execute_page(PAYLOAD, "runs/palida_payload")
    rows = (folder / "runs/palida_payload/tables/payload.csv").read_text().splitlines()
    assert len(rows) == 1 + 10 + 9
    assert len(stated_numbers(PAYLOAD)) == 10


def test_the_runs_of_a_payload_are_runs(tmp_path):
    shown, own = (parse(block.text) for block in fences(PAYLOAD) if block.language == "yaml")
    shipped = parse(run_files()["palida_payload"].read_text(encoding="utf-8"))
    for key, value in shown.items():
        if isinstance(value, dict):
            assert value.items() <= shipped[key].items(), key
        else:
            assert value == shipped[key], key
    machine = robot_files()["palida"].parents[1] / "identified" / "palida.yaml"
    own["robot"] = own["design"]["prior"] = str(machine)
    assert load_run(own).run.stages[0] == "design"


def test_a_wrong_number_is_detected():
    assert agree("37.7", 37.79)
    assert not agree("37.7", 37.81)
    assert agree("0.10", 0.0905)
    assert not agree("16.3", 16.41)
    output = "strut_speed   strut 5   1.9912 m/s   2 m/s   99.6 %\n8335 rows, p2 + 2.368·p1\n"
    for excerpt in (
        "strut_speed strut 5 1.99 m/s 2 m/s 100 %",
        "…\n8335 rows, p2 + 2.4·p1\n",
        "strut_speed strut 5 … m/s 2 m/s 99.6 %\n8335 rows, p2 + 2.4·p1",
    ):
        assert missing_line(excerpt, output) is None
    for excerpt in (
        "strut_speed strut 4 1.99 m/s 2 m/s 100 %",
        "strut_speed strut 5 1.97 m/s 2 m/s 100 %",
        "8334 rows, p2 + 2.4·p1",
        "8335 rows, p3 + 2.4·p1",
        "8335 rows, p2 + 2.4·p1\nstrut_speed strut 5 1.99 m/s 2 m/s 100 %",
    ):
        assert missing_line(excerpt, output) is not None
