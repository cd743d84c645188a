"""Results in Python: short texts, tables as data frames, figures by name."""

from pathlib import Path

import numpy as np
import pandas as pd

import expdesign
from expdesign.recheck.limit_check import REACHED
from expdesign.runfolder import StageResult
from expdesign.stages.registry import stages
from results.figures.drawing import NotebookFigure


def test_a_design_shows_its_verdict_and_ten_numbers_at_most(tiny_result):
    text = repr(tiny_result)
    verdict, *lines = text.splitlines()
    assert verdict.startswith("Design: ")
    assert 5 <= len([line for line in lines if line.startswith("  ")]) <= 11
    assert "array(" not in text
    assert any(line.startswith("  mass: ") and line.endswith(" kg") for line in lines)
    assert f"  warnings: {len(tiny_result.warnings)}, see .view.warnings" in lines
    page = tiny_result._repr_html_()
    assert page.startswith("<p><b>Design: ")
    assert all(fact.name in page for fact in tiny_result.view.facts)


def test_tables_are_those_of_the_run_folder(tiny_result, tmp_path):
    tiny_result.write(tmp_path)
    tables = tiny_result.view.tables
    for name in ("parameters", "limits", "information"):
        pd.testing.assert_frame_equal(tables[name], pd.read_csv(tmp_path / f"tables/{name}.csv"))
    assert len(tables["trajectory"]) == len(pd.read_csv(tmp_path / "trajectory.csv"))


def test_figures_have_names_and_are_drawn_on_access(tiny_result):
    figures = tiny_result.view.figures
    assert {"excitation", "path", "precision", "convergence"} <= set(figures)
    assert "excitation: One period of the excitation trajectory" in repr(figures)
    text = repr(figures)
    active = [check.title for check in tiny_result.checks if check.used >= REACHED]
    assert all(title in text.partition("The design reaches")[2] for title in active)
    ordered = sorted(tiny_result.parameters, key=lambda one: one.rel_std_percent)
    assert f"best {ordered[0].name}, {ordered[0].rel_std_percent:.2g} %" in text
    assert f"worst {ordered[-1].name}, {ordered[-1].rel_std_percent:.2g} %" in text
    figure = figures["precision"]
    assert isinstance(figure, NotebookFigure)
    assert figure._repr_png_().startswith(b"\x89PNG")


def test_only_results_of_stages_are_changed():
    every = [stage.views().result_type for stage in stages().values()]
    assert Path in every or type(Path()) in every  # the report
    assert repr(Path("a")) == "PosixPath('a')"
    assert all(hasattr(kind, "view") == issubclass(kind, StageResult) for kind in every)


def test_inputs_have_short_texts():
    measured = expdesign.Measurement(np.arange(4) / 1000, np.ones((4, 6)), np.ones((4, 6)), 1e-3)
    assert repr(measured) == "Measurement(4 samples 1 ms apart)"
    motion = expdesign.FourierTrajectory(np.pi, np.zeros(6), np.ones((6, 2)), np.zeros((6, 2)))
    assert repr(motion) == "FourierTrajectory(2 harmonics of 0.5 Hz, 2 s)"
    run = expdesign.load_run({"name": "n", "robot": "palida"})
    assert repr(run) == "RunConfiguration('n', robot 'palida', 1 warning)"
