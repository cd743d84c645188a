"""The cardan angles of the struts against their limits."""

from __future__ import annotations

from matplotlib.figure import Figure

from results.figures.definition import FigureDefinition
from results.figures.legends import strut_legend
from results.figures.limited_panel import StrutQuantity, limited_panel
from results.record import DesignRecord
from results.style import new_figure

ALPHA = StrutQuantity("First cardan angle", r"Cardan angle $\alpha$", "rad", "alpha")
BETA = StrutQuantity("Second cardan angle", r"Cardan angle $\beta$", "rad", "beta")


def draw(record: DesignRecord) -> Figure:
    """Draw α and β of all struts over one period."""
    motion = record.motion
    figure = new_figure(2.9)
    panels = figure.subplots(1, 2, sharex=True)
    for axes, quantity, values in zip(
        panels, (ALPHA, BETA), (motion.alpha, motion.beta), strict=True
    ):
        limited_panel(axes, quantity, motion.time, values, record.limit(quantity.limit))
        axes.set_xlim(0, motion.period)
        axes.set_xlabel("Time (s)")
    strut_legend(figure)
    return figure


FIGURE = FigureDefinition(
    key="cardan_angles",
    caption="Cardan angles of the six struts over one period. What the limits forbid is hatched.",
    draw=draw,
)
