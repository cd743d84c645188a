"""The tutorial: its commands run one after the other, and its numbers are what comes out."""

import shlex

import pytest

from expdesign.cli.app import app
from expdesign.cli.errors import run
from tests.blank_figures import blank_figures
from tests.docs.pages import ROOT
from tests.docs.tutorial import agree, missing_line, stated_numbers, steps, value_of

PAGE = ROOT / "docs" / "tutorial.md"
FOLDER = "runs/tutorial"


@pytest.mark.slow
def test_the_tutorial_is_what_happens(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    said = ""
    for step in steps(PAGE):
        if step.kind == "file":
            (tmp_path / step.name).write_text(step.text, encoding="utf-8")
        elif step.kind == "command":
            program, *arguments = shlex.split(step.text)
            assert program == "expdesign"
            with blank_figures(filled=True):
                status = run(app, arguments)
            said = "".join(capsys.readouterr())
            assert status == 0, (step.text, said)
        else:
            assert missing_line(step.text, said) is None, said
    for stated in stated_numbers(PAGE):
        value = value_of(stated, tmp_path / FOLDER)
        assert agree(stated.shown, value), (stated, value)
    figures = {path.stem for path in (tmp_path / FOLDER / "figures").glob("*.svg")}
    assert {"path", "limits_used", "precision"} <= figures
    assert (tmp_path / FOLDER / "report.html").is_file()
    assert (tmp_path / "runs/comparison/report.html").is_file()
    assert (tmp_path / FOLDER / "exports/README.txt").is_file()


def test_the_tutorial_has_every_step():
    commands = [step.text.split()[1] for step in steps(PAGE) if step.kind == "command"]
    way = [
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
    assert commands == way
    assert len(stated_numbers(PAGE)) > 30


def test_a_wrong_number_is_seen():
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
