"""Figures of a Monte-Carlo study, from a table that is made up."""

import numpy as np
import pandas as pd
import pytest

from estimation.montecarlo.tables import STATISTICS
from expdesign.configuration import InputError
from expdesign.runfolder import MissingFileError
from results import StudyRecord, study_figures
from results.figures.montecarlo import bias, efficiency
from results.figures.montecarlo.catalogue import STUDY_FIGURES

NAMES = ["p1", "p2", "r_alpha", "r1", "v6"]


def statistics_table(folder, shift=0.0, estimators=("ls", "ml"), count=100):
    rng = np.random.default_rng(5)
    rows = [
        {column.name: 1.0 for column in STATISTICS}
        | {
            "estimator": estimator,
            "parameter": name,
            "unit": "kg",
            "identified": True,
            "estimates": count,
            "bias": 0.1 * rng.normal() + shift,
            "bias_std_error": 0.1,
            "rmse_over_bound": 1.05 + abs(shift),
            "rmse_over_bound_low": 0.9 + abs(shift),
            "rmse_over_bound_high": 1.2 + abs(shift),
            "coverage": 0.95,
            "coverage_low": 0.9,
            "coverage_high": 0.98,
        }
        for estimator in estimators
        for name in NAMES
    ]
    path = folder / "tables" / "montecarlo.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    pd.DataFrame(rows).to_csv(path, index=False)
    return path


def points(figure, axes=0):
    """Return the points of every estimator of one panel."""
    return [container.lines[0].get_xydata() for container in figure.axes[axes].containers]


def test_the_files(tmp_path):
    statistics_table(tmp_path)
    paths = study_figures(tmp_path)
    names = {f"{d.key}.{ending}" for d in STUDY_FIGURES for ending in ("png", "svg")}
    assert {path.name for path in paths} == names
    before = [path.read_bytes() for path in paths]
    assert [path.read_bytes() for path in study_figures(tmp_path)] == before


def test_the_bias_is_drawn_in_units_of_the_bound(tmp_path):
    path = statistics_table(tmp_path)
    table = pd.read_csv(path)
    table["bias"] *= 3
    table["bias_std_error"] *= 3
    table["bound"] = 3.0
    table.to_csv(path, index=False)
    record = StudyRecord.load(tmp_path)
    figure = bias.draw(record)
    ls, ml = points(figure)
    np.testing.assert_allclose(ls[:, 1], table["bias"][:5] / 3)
    np.testing.assert_allclose(ml[:, 1], table["bias"][5:] / 3)
    assert np.all(ls[:, 0] < ml[:, 0])
    band = next(p for p in figure.axes[0].patches if p.get_height() > 0)
    assert band.get_height() == pytest.approx(2 * 3.5 / 10)
    assert figure.axes[0].get_yscale() == "linear"


def test_a_large_bias_needs_another_scale(tmp_path):
    statistics_table(tmp_path, shift=30.0)
    record = StudyRecord.load(tmp_path)
    axes = bias.draw(record).axes[0]
    assert axes.get_yscale() == "symlog"
    assert axes.get_ylim()[1] > 30
    assert efficiency.draw(record).axes[0].get_yscale() == "log"


def test_efficiency_and_coverage(tmp_path):
    statistics_table(tmp_path)
    figure = efficiency.draw(StudyRecord.load(tmp_path))
    np.testing.assert_allclose(points(figure)[0][:, 1], 1.05)
    np.testing.assert_allclose(points(figure, 1)[1][:, 1], 95.0)
    assert figure.axes[1].get_ylim()[1] > 100
    assert [text.get_text() for text in figure.axes[0].get_legend().texts] == [
        "LS (100)",
        "ML (100)",
    ]


def test_one_repetition_has_no_standard_error(tmp_path):
    path = statistics_table(tmp_path, estimators=("gm",), count=1)
    table = pd.read_csv(path)
    table["bias_std_error"] = np.nan
    table.to_csv(path, index=False)
    assert len(study_figures(tmp_path)) == 4


def test_a_missing_table_names_the_command(tmp_path):
    with pytest.raises(MissingFileError, match="expdesign montecarlo"):
        study_figures(tmp_path)


def test_a_table_without_rows(tmp_path):
    path = statistics_table(tmp_path)
    path.write_text(path.read_text(encoding="utf-8").splitlines()[0] + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="no rows"):
        study_figures(tmp_path)
