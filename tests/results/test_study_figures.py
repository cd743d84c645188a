"""Figures of a Monte-Carlo study, from rows that are made up."""

from dataclasses import fields, replace

import numpy as np
import pytest

from estimation.montecarlo.result import StatisticsRow
from expdesign.runfolder import RowTable
from results.figures.drawing import save_figures
from results.figures.studies import STUDY_FIGURES, bias_figure, efficiency_figure

NAMES = ["p1", "p2", "r_alpha", "r1", "v6"]


def statistics(shift=0.0, estimators=("ls", "ml"), count=100, **others):
    rng = np.random.default_rng(5)
    ones = dict.fromkeys((field.name for field in fields(StatisticsRow)), 1.0)
    return tuple(
        StatisticsRow(
            **ones
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
            | others
        )
        for estimator in estimators
        for name in NAMES
    )


def points(figure, axes=0):
    """Return the points of every estimator of one panel."""
    return [container.lines[0].get_xydata() for container in figure.axes[axes].containers]


def test_the_files(tmp_path):
    """The table of a folder gives the same bytes as what it was written from."""
    rows = statistics()
    table = RowTable("tables/montecarlo.csv", "", StatisticsRow)
    table.write(tmp_path, rows)
    paths = save_figures(STUDY_FIGURES, rows, tmp_path / "memory")
    names = {f"{d.key}.{ending}" for d in STUDY_FIGURES for ending in ("png", "svg")}
    assert {path.name for path in paths} == names
    found = table.read(tmp_path)
    for one, other in zip(paths, save_figures(STUDY_FIGURES, found, tmp_path), strict=True):
        assert one.read_bytes() == other.read_bytes()


def test_the_bias_is_drawn_in_units_of_the_bound():
    rows = [
        replace(row, bias=3 * row.bias, bias_std_error=3 * row.bias_std_error, bound=3.0)
        for row in statistics()
    ]
    figure = bias_figure.draw(rows)
    ls, ml = points(figure)
    np.testing.assert_allclose(ls[:, 1], [row.bias / 3 for row in rows[:5]])
    np.testing.assert_allclose(ml[:, 1], [row.bias / 3 for row in rows[5:]])
    assert np.all(ls[:, 0] < ml[:, 0])
    band = next(p for p in figure.axes[0].patches if p.get_height() > 0)
    assert band.get_height() == pytest.approx(2 * 3.5 / 10)
    assert figure.axes[0].get_yscale() == "linear"


def test_a_large_bias_needs_another_scale():
    rows = statistics(shift=30.0)
    axes = bias_figure.draw(rows).axes[0]
    assert axes.get_yscale() == "symlog"
    assert axes.get_ylim()[1] > 30
    assert efficiency_figure.draw(rows).axes[0].get_yscale() == "log"


def test_efficiency_and_coverage():
    figure = efficiency_figure.draw(statistics())
    np.testing.assert_allclose(points(figure)[0][:, 1], 1.05)
    np.testing.assert_allclose(points(figure, 1)[1][:, 1], 95.0)
    assert figure.axes[1].get_ylim()[1] > 100
    assert [text.get_text() for text in figure.axes[0].get_legend().texts] == [
        "LS (100)",
        "ML (100)",
    ]


def test_one_repetition_has_no_standard_error(tmp_path):
    rows = statistics(estimators=("gm",), count=1, bias_std_error=np.nan)
    assert len(save_figures(STUDY_FIGURES, rows, tmp_path)) == 4
