"""The path of a selection of terms: what every candidate was worth in every step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from estimation.identification.record import EstimateRecord
from estimation.selection.selection import SelectionRow
from results.figures.drawing import figure_definition
from results.notation import readable
from results.style import EMPHASIS, FAINT, INK, MUTED, SECOND

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WORTH = {
    "bic": "fall of Schwarz's criterion with the term",
    "f": "ln(level) − ln(p) of the term",
    "holdout": "fall of −2 log L of held-out data with the term",
}
"""What a term is judged by, in words: it belongs into the model where that is above zero."""
_MOST_STEPS = 14
"""That fit into a figure: the last ones are shown."""


@figure_definition(
    "selection",
    "Selection of terms, step by step: what each candidate is worth in the model. Forward, the one "
    "that is worth most is added (framed) if it is worth more than zero; backward, the one that is "
    "worth least leaves (framed) if it is worth nothing beside the others. A dot: in the model, "
    "and not tried in this step.",
    height=3.2,
)
def selection_figure(figure: Figure, record: EstimateRecord) -> None:
    """Draw a cell for every candidate in every step, with its worth."""
    found = record.summary.selection
    if found is None:
        raise ValueError("no terms were tried")
    axes = figure.subplots()
    names = [candidate.name for candidate in found.candidates]
    numbers = sorted({row.step for row in found.steps})[-_MOST_STEPS:]
    for place, number in enumerate(numbers):
        rows = [row for row in found.steps if row.step == number]
        _draw_step(axes, place, rows, names)
    last = len(numbers)
    for height, name in enumerate(names):
        if name in found.chosen:
            axes.plot(last, height, "o", color=EMPHASIS, markersize=6)
    heads = [f"{n}\n{_direction(found.steps, n)}" for n in numbers]
    axes.set_xticks(range(last + 1), [*heads, "result"])
    axes.set_yticks(range(len(names)), names)
    axes.set(xlim=(-0.55, last + 0.55), ylim=(len(names) - 0.45, -0.55), xlabel="Step")
    axes.tick_params(length=0)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.set_title(f"Selection of terms: {WORTH[found.by]}")


def _direction(rows: Sequence[SelectionRow], number: int) -> str:
    return next(row.direction for row in rows if row.step == number)


def _draw_step(axes: Axes, place: int, rows: list[SelectionRow], names: list[str]) -> None:
    from matplotlib.patches import Rectangle

    worth = {row.term: row for row in rows}
    inside = set(rows[0].beside.split()) if rows[0].direction == "add" else set()
    largest = max(1.0, *(abs(row.worth) for row in rows))
    for height, name in enumerate(names):
        if name in inside:
            axes.plot(place, height, "o", color=MUTED, markersize=3)
        if name not in worth:
            continue
        row = worth[name]
        share = np.sqrt(abs(row.worth) / largest)
        colour = SECOND if row.worth > 0 else FAINT
        corner = (place - 0.45, height - 0.4)
        axes.add_patch(Rectangle(corner, 0.9, 0.8, color=colour, alpha=0.15 + 0.55 * share, lw=0))
        if row.chosen:
            axes.add_patch(Rectangle(corner, 0.9, 0.8, fill=False, edgecolor=EMPHASIS, lw=1.4))
        weight = "bold" if row.chosen else "normal"
        text = readable(float(f"{row.worth:.3g}"), 3)
        axes.text(
            place, height, text, ha="center", va="center", color=INK, fontsize=7, weight=weight
        )
