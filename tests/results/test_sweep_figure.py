"""The figure of a sweep: every design where its numbers say, named without hiding another."""

from dataclasses import replace
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from expdesign.configuration import load_run
from expdesign.experiment.sweep import SweepResult, SweptDesign, sweep_result
from expdesign.library import robot_files
from results.figures.drawing import PALETTE, house_style
from results.figures.studies import _unbeaten, sweep_figure
from results.views.folder import RunFolder
from results.views.sweep import sweep_view

_RUN = load_run({"name": "n", "robot": "palida"})

NUMBERS = ("median_rel_std_percent", "worst_rel_std_percent", "measuring_time", "cpu_seconds")


@pytest.fixture
def record_of(monkeypatch):
    """Return a maker of records of a grid whose designs have drawn numbers."""

    def make(sweep, missing=(), seed=0):
        rng = np.random.default_rng(seed)
        configuration = load_run({"name": "n", "robot": "palida", "sweep": sweep})
        designs = []
        for number, point in enumerate(configuration.grid, start=1):
            one = SweptDesign.missing(number, point, "failed", "drawn so")
            if number not in missing:
                drawn = dict(zip(NUMBERS, np.exp(rng.normal(size=4)), strict=True))
                certified = bool(number % 2)
                fields = vars(one) | drawn | {"folder": "x", "certified": certified}
                one = type(one)(**fields | {"status": "converged"})
            designs.append(one)
        return sweep_result(configuration, designs)

    return make


def drawn(record):
    with house_style():
        figure = sweep_figure.draw(record)
        figure.set_dpi(200)
        figure.draw_without_rendering()
    return figure


def is_marker(line):
    return line.get_marker() == "o"


def markers(axes):
    return [line for line in axes.lines if is_marker(line)]


def test_every_design_stands_where_its_numbers_say(record_of):
    record = record_of({"trajectory.harmonics": [2, 3, 4], "design.criterion": ["d", "a"]}, {2})
    figure = drawn(record)
    made = [one for one in record.designs if one.made]
    panels = [("measuring_time", 0), ("cpu_seconds", 0), ("measuring_time", 1), ("cpu_seconds", 1)]
    for axes, (cost, row) in zip(figure.axes, panels, strict=True):
        found = markers(axes)
        assert len(found) == len(made) == 5
        for line, one in zip(found, made, strict=True):
            place = (line.get_xdata()[0], line.get_ydata()[0])
            assert place == (getattr(one, cost), getattr(one, NUMBERS[row]))
            colour = PALETTE[one.criterion == "a"]
            assert line.get_color() == colour
            assert line.get_markerfacecolor() == (colour if one.certified else "white")
        assert {text.get_text() for text in axes.texts} == {f"harmonics {n}" for n in (2, 3, 4)}
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["criterion d", "criterion a"]


@pytest.mark.parametrize("seed", [0, *(pytest.param(n, marks=pytest.mark.slow) for n in (1, 2))])
def test_names_hide_no_other(record_of, seed):
    record = record_of({"design.seed": list(range(10)), "design.starts": [1, 2]}, seed=seed)
    figure = drawn(record)
    for axes in figure.axes:
        frame = axes.get_window_extent()
        boxes = [text.get_window_extent() for text in axes.texts if text.get_text()]
        assert len(boxes) == 20
        assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))
        assert all(frame.overlaps(box) for box in boxes)


def _lines(record):
    """Return the numbers of points of the lines in the four panels."""
    axes = sweep_figure.draw(record).axes
    return [len(line.get_xdata()) for each in axes for line in each.lines if not is_marker(line)]


def test_a_line_joins_complete_designs_that_judge_the_same(record_of):
    seeds = record_of({"design.seed": [0, 1]})
    better, worse = sorted(seeds.designs, key=lambda one: one.precision)
    cheaper = {"measuring_time": 1e-6, "cpu_seconds": 1e-6, "worst_rel_std_percent": 1e-6}
    better = type(better)(**vars(better) | cheaper | {"status": "limits broken"})
    broken = replace(seeds, designs=(better, worse))
    assert _lines(broken) == [1] * 4
    assert broken.most_precise is worse
    assert "design" in _sentence(broken)
    known = record_of({"design.known": [["p1"], ["p1", "p2"]], "design.seed": [0]})
    assert known.most_precise is None
    assert "none is the most precise" in _sentence(known)
    assert _lines(known) == [0] * 4
    assert record_of({"design.known": [["p1"]], "design.seed": [0, 1]}).most_precise is not None


def _sentence(record):
    view = sweep_view(RunFolder(Path(), {}, _RUN, results={SweepResult: record}))
    assert ("most precise design" in [one.name for one in view.facts]) == record.comparable
    return view.verdict.sentence


def test_a_sweep_without_any_design(record_of):
    figure = drawn(record_of({"design.seed": [0, 1]}, {1, 2}))
    assert [text.get_text() for axes in figure.axes for text in axes.texts] == ["no design"] * 4


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=12))
def test_the_line_joins_those_that_no_other_beats(places):
    points = np.array(places, dtype=float)
    best = _unbeaten(points, range(len(points)))
    for one, following in pairwise(best):
        assert points[one, 0] < points[following, 0]
        assert points[one, 1] > points[following, 1]
    for place in points:
        assert any(np.all(points[k] <= place) for k in best)


@pytest.mark.parametrize(
    ("tolerances", "grid", "heading"),
    [
        ({}, {"trajectory.harmonics": [2, 3]}, "log det F"),
        ({"gravity": "0.5 deg"}, {"trajectory.harmonics": [2, 3]}, "log det S"),
        ({"gravity": "0.5 deg"}, {"design.counts": ["noise", "total"]}, "criterion value"),
    ],
)
def test_the_table_names_the_criterion_that_was_used(tolerances, grid, heading):
    palida = yaml.safe_load(robot_files()["palida"].read_text("utf-8"))
    robot = palida | {"tolerances": tolerances}
    configuration = load_run({"name": "n", "robot": robot, "sweep": grid})
    designs = [
        replace(SweptDesign.missing(number, point, "failed", ""), criterion_value=1.0 + number)
        for number, point in enumerate(configuration.grid, start=1)
    ]
    record = sweep_result(configuration, designs)
    view = sweep_view(RunFolder(Path(), {}, configuration, None, {SweepResult: record}))
    (table,) = (block for block in view.blocks if getattr(block, "key", "") == "sweep")
    places = [column.title for column in table.columns]
    assert [row[places.index(heading)] for row in table.rows] == [2.0, 3.0]
    others = {"log det F", "log det S", "criterion value"} - {heading}
    assert not others & set(places)
