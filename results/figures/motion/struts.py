"""What the struts do from rest to rest, against their limits, with the segments marked."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from results.executed import MotionRecord
from results.figures.definition import FigureDefinition
from results.figures.design.struts import FORCE, LENGTH, SPEED
from results.figures.legends import strut_legend
from results.figures.limited_panel import limited_panel
from results.style import FAINT, INK, MUTED, new_figure

_BEYOND = 0.35
"""How far the close-up of a ramp reaches into the periods, as a share of the ramp."""
_WIDTHS = (1.0, 1.6, 1.0)


def draw(record: MotionRecord) -> Figure:
    """Draw lengths, speeds and forces: the whole motion, and its two ramps close up."""
    figure = new_figure(6.2)
    panels = figure.subplots(3, 3, sharex="col", sharey="row", width_ratios=_WIDTHS)
    end = float(record.starts[-1])
    begin, leave = float(record.starts[1]), float(record.starts[-2])
    views = (
        (0.0, begin * (1 + _BEYOND)),
        (0.0, end),
        (leave - (end - leave) * _BEYOND, end),
    )
    contents = ((LENGTH, record.length), (SPEED, record.speed), (FORCE, record.force))
    for row, (quantity, values) in zip(panels, contents, strict=True):
        for axes, view in zip(row, views, strict=True):
            limited_panel(axes, quantity, record.time, values, record.limit(quantity.limit))
            for text in axes.texts[:] if axes is not row[1] else ():
                text.remove()
            axes.set_title("")
            axes.set_xlim(*view)
            for start in record.starts[1:-1]:
                axes.axvline(start, color=INK, linewidth=0.8, dashes=(3, 2))
        for axes in row[1:]:
            axes.set_ylabel("")
    for axes in panels[-1]:
        axes.set_xlabel("Time (s)")
    _name_segments(panels[0, 0], record, record.names[:2])
    _name_segments(panels[0, 2], record, record.names[-2:])
    panels[0, 1].set_title("whole motion")
    figure.align_ylabels()
    strut_legend(figure)
    return figure


def _name_segments(axes: Axes, record: MotionRecord, names: tuple[str, ...]) -> None:
    """Write each segment's name above the middle of what is in view of it."""
    low, high = axes.get_xlim()
    for name in names:
        k = record.names.index(name)
        middle = np.clip(record.starts[k : k + 2], low, high).mean()
        axes.text(
            (middle - low) / (high - low),
            1.03,
            name,
            transform=axes.transAxes,
            ha="center",
            fontsize="small",
            color=MUTED if name == "periods" else INK,
            bbox={"facecolor": "white", "edgecolor": FAINT, "pad": 1.5, "linewidth": 0.0},
        )


FIGURE = FigureDefinition(
    key="motion",
    caption="Lengths, speeds and actuator forces (nominal parameters) of the six struts from rest "
    "to rest. Left and right the ramps, close up; what the limits forbid is hatched.",
    draw=draw,
)
