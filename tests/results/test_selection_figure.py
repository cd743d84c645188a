"""The path of a selection as it is drawn and told, from a made-up one."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.patches import Rectangle

from estimation.identification.term_selection import Selection
from estimation.selection import SelectionRow
from expdesign.configuration.estimate import SelectSection
from results.figures.drawing import house_style
from results.figures.parameters import selection_figure
from results.views.blocks import selection_blocks
from results.views.view import ReportTable, TextBlock

NAMES = ("force_offset", "drive_inertia", "load_friction")


def made_up(steps, chosen, by="bic"):
    """Return a record of steps: direction, model before, worth by term, the term of the step."""
    rows = [
        SelectionRow(
            step=number,
            direction=direction,
            term=term,
            others=" ".join(other for other in model if other != term),
            parameters=6,
            statistic=abs(worth),
            log_p=-worth,
            samples=1000.0,
            bic=-worth,
            held_out=np.nan,
            possible=True,
            worth=worth,
            chosen=term == done,
        )
        for number, (direction, model, worths, done) in enumerate(steps, start=1)
        for term, worth in worths.items()
    ]
    selection = Selection(
        by=by,
        level=None,
        candidates=SelectSection(candidates=NAMES).candidates,
        chosen=chosen,
        dispersion=1.25,
        held_out="periods" if by == "holdout" else "",
        steps=tuple(rows),
    )
    return SimpleNamespace(selection=selection)


PATH = (
    ("add", (), {NAMES[0]: 20.0, NAMES[1]: 250.5, NAMES[2]: -3.0}, NAMES[1]),
    ("drop", (NAMES[1],), {NAMES[1]: 250.5}, None),
    ("add", (NAMES[1],), {NAMES[0]: -41.0, NAMES[2]: -45.0}, None),
)


@pytest.mark.parametrize("path", [PATH, PATH[:1] * 30])
def test_every_trial_has_its_cell(path):
    with house_style():
        figure = selection_figure.draw(made_up(path, (NAMES[1],)))
        figure.set_dpi(200)
        figure.draw_without_rendering()
    (axes,) = figure.axes
    shown = path[-14:]
    texts = [text for text in axes.texts if text.get_text()]
    assert len(texts) == sum(len(worths) for _, _, worths, _ in shown)
    frames = [p for p in axes.patches if isinstance(p, Rectangle) and not p.get_fill()]
    assert len(frames) == sum(done is not None for *_, done in shown)
    # Dots: those that were in the model and not tried; and the result.
    inside = sum(len(model) for direction, model, _, _ in shown if direction == "add")
    assert len(axes.lines) == inside + 1
    boxes = [text.get_window_extent() for text in texts]
    assert not any(one.overlaps(other) for one, other in combinations(boxes, 2))


@pytest.mark.parametrize("by", ["bic", "f", "holdout"])
def test_the_report_tells_the_choice_its_path_and_the_caveat(by):
    record = made_up(PATH, (NAMES[1],), by)
    blocks = list(selection_blocks(record))
    (table,) = (block for block in blocks if isinstance(block, ReportTable))
    assert [row[2] for row in table.rows] == [name for _, _, worths, _ in PATH for name in worths]
    texts = [block.text for block in blocks if isinstance(block, TextBlock)]
    assert NAMES[1] in texts[0]
    assert "1.25" in texts[0]
    assert texts[-1] == record.selection.caveat
    assert len(texts) == (3 if by == "holdout" else 2)


def test_nothing_is_told_where_nothing_was_tried():
    record = SimpleNamespace(selection=None)
    assert not list(selection_blocks(record))
