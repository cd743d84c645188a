"""The stage from the command line to the report, and its figure."""

import json
from dataclasses import replace

import numpy as np
import pytest

from estimation.feedforward.result import MEANINGS, FeedforwardResult
from expdesign.cli.app import app, run
from expdesign.configuration import load_run
from results.figures.drawing import house_style
from results.figures.residuals import feedforward_figure
from results.views.folder import RunFolder
from results.views.validate import feedforward_view
from results.views.view import Level
from tests.blank_figures import blank_figures
from tests.stages.test_registry import assert_declared_files

SECTION = {"radius": 0.05, "speed": 0.5, "bandwidth": 5, "integral": 0.5}


@pytest.fixture(scope="module")
def folder(tiny, tiny_result, tmp_path_factory):
    """A run folder with a design, its experiment, an estimate, the comparison and the report."""
    place = tmp_path_factory.mktemp("run")
    sections = {"estimate": {"estimators": ["gm"]}, "feedforward": SECTION, "report": {}}
    (place / "run.yaml").write_text(json.dumps(tiny(**sections)), encoding="utf-8")
    with pytest.MonkeyPatch.context() as patched, blank_figures():
        patched.setattr("expdesign.stages.design.design", lambda *_: tiny_result)
        assert run(app, ["run", str(place / "run.yaml"), "--out", str(place / "out")]) == 0
    return place / "out"


def test_a_run_compares_and_reports(folder):
    stages = assert_declared_files(folder)
    assert {"design", "experiment", "estimate", "feedforward", "report"} == stages
    record = FeedforwardResult.read(folder)
    assert record.machine == "twin"
    assert record.case("identified").reduction > 1
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert 'id="feedforward"' in page
    for name in ("feedforward_cases", "feedforward_controller"):
        assert f'id="table-{name}"' in page
    for each in record.cases:
        assert MEANINGS[each.case] in page


def test_a_motion_that_the_robot_cannot_make_is_no_good_news(folder):
    """What a model buys there no machine will see."""
    record, configuration = FeedforwardResult.read(folder), load_run(folder / "run.yaml")
    levels = []
    for kept in (True, False):
        made = replace(record, within_limits=kept)
        with blank_figures():
            place = RunFolder(folder, {}, configuration, None, {FeedforwardResult: made})
            levels.append(feedforward_view(place).verdict.level)
    assert levels == [Level.GOOD, Level.CAUTION]


def test_what_is_done_is_kept_until_its_section_changes(folder, capsys):
    document = json.loads((folder.parent / "run.yaml").read_text(encoding="utf-8"))
    out = ["--out", str(folder), "--json"]
    before = (folder / "tables" / "tracking_1.csv").read_bytes()
    resumed = []
    for damping in (0.7, 0.9):
        document["feedforward"]["damping"] = damping
        path = folder.parent / "other.yaml"
        path.write_text(json.dumps(document), encoding="utf-8")
        capsys.readouterr()
        with blank_figures():
            assert run(app, ["run", str(path), *out]) == 0
        stages = json.loads(capsys.readouterr().out)["stages"]
        assert stages["estimate"]["resumed"]
        resumed.append(stages["feedforward"]["resumed"])
    assert resumed == [True, False]
    assert (folder / "tables" / "tracking_1.csv").read_bytes() != before


def test_the_figure_shows_every_case(folder):
    record = FeedforwardResult.read(folder)
    with house_style():
        figure = feedforward_figure.draw(record)
    above, below = figure.axes
    assert len(above.lines) == len(below.lines) == len(record.cases)
    shown = above.lines[0].get_ydata()
    factor = shown / record.tracking[0].position
    np.testing.assert_allclose(factor, factor[0])
    assert np.isclose(factor[0], (1, 1e3, 1e6), rtol=1e-9).any()
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == [MEANINGS[each.case] for each in record.cases]
