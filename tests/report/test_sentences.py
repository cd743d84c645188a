"""Sentences of views end with a full stop; warnings, which have a heading, do not."""

import re
import shutil

from expdesign.stages.registry import reported_stages
from results.comparison.comparison import write_comparison
from results.views.folder import RunFolder
from results.views.view import TextBlock


def _unfinished(view):
    texts = [block.text for block in view.blocks if isinstance(block, TextBlock)]
    unfinished = [text for text in (view.verdict.sentence, *texts) if text[-1] != "."]
    return unfinished + [text for text in view.warnings if text[-1] == "."]


def test_sentences_of_every_stage_end_with_a_full_stop(folder):
    opened = RunFolder.open(folder, reported_stages())
    views = {name: opened.view(name) for name in opened.held}
    assert {"changed", "done"} <= {view.verdict.word for view in views.values()}
    assert {name: _unfinished(view) for name, view in views.items() if _unfinished(view)} == {}


def test_sentences_of_a_comparison_end_with_a_full_stop(folder, tmp_path):
    other = folder.rename(tmp_path / "other")
    again = tmp_path / "again"
    shutil.copytree(other, again)
    run = again / "run.yaml"
    lighter = re.sub(r"gravity: .*", "gravity: [0, 0, -9.8]", run.read_text(encoding="utf-8"))
    run.write_text(lighter, encoding="utf-8")
    views = write_comparison(
        [other, again], tmp_path / "out", reported_stages(), precision=0.05, quick=True
    )[1]
    assert [text for view in views for text in view.warnings]
    assert [text for view in views for text in _unfinished(view)] == []
