"""Measured minus predicted forces over time: of an estimate, or of its prediction (Fig. 7)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from constraints.arrays import Array
from estimation.diagnostics.record import ExperimentRecord, ForceResiduals
from estimation.validation.record import MotionRecord
from results.figures.definition import FigureDefinition
from results.figures.estimation.panels import corner_text, strut_panels
from results.style import ALERT, MUTED, STRUT_COLOURS, new_figure

_BAND = 1.96
_REACH = 0.9995
"""Share of the residuals that the panels show: one outlier shall not flatten all six."""


def draw(record: ExperimentRecord) -> Figure:
    """Draw the residuals of an estimate over one period."""
    figure, panels = _residual_panels(record.residuals, record.residuals.time, room=1.25)
    test = record.tests.lack_of_fit
    for j, axes in enumerate(panels):
        if not test.refused:
            words = "bias" if test.failed[j] else "no bias"
            corner_text(axes, f"{words}: F = {test.statistic[j]:.2f}")
    return figure


def draw_prediction(motion: MotionRecord) -> Figure:
    """Draw the error of the prediction of a motion."""
    rest, test = motion.residuals, motion.tests.lack_of_fit
    figure, panels = _residual_panels(rest, rest.time - rest.time[0], room=1.3)
    for j, axes in enumerate(panels):
        if test.refused:
            corner_text(axes, "not tested")
            continue
        words = "fails" if test.failed[j] else "passes"
        corner_text(axes, f"{words}: F = {test.statistic[j]:.2f}")
        if test.failed[j]:
            axes.texts[-1].set_color(ALERT)
    figure.suptitle(motion.name, fontsize="medium")
    return figure


def _residual_panels(
    rest: ForceResiduals, time: Array, *, room: float
) -> tuple[Figure, tuple[Axes, ...]]:
    """Draw the residuals with the band in which noise alone leaves 95 % of them."""
    figure = new_figure(5.4)
    height = 1.1 * float(np.max(np.quantile(np.abs(rest.forces), _REACH, axis=0)))
    height = max(height, 1.3 * _BAND * float(np.max(rest.std)))
    panels = strut_panels(figure, "Actuator", (3, 2), share=True)
    for j, axes in enumerate(panels):
        band = _BAND * rest.std[:, j]
        axes.plot(time, rest.forces[:, j], color=STRUT_COLOURS[j], linewidth=0.5, zorder=2)
        for sign in (1, -1):
            axes.plot(
                time, sign * band, color=MUTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=3
            )
        axes.set_ylim(-height, room * height)
        axes.set_xlim(time[0], time[-1])
    figure.supxlabel("Time (s)", fontsize="medium")
    figure.supylabel("Measured − predicted force, mean over the periods (N)", fontsize="medium")
    return figure, panels


FIGURE = FigureDefinition(
    key="residuals",
    caption="Residual force of each actuator over one period, mean over the periods. Dashed: where "
    "the noise alone leaves 95 % of it. F: bias against the scatter between the periods.",
    draw=draw,
)

PREDICTION = FigureDefinition(
    key="prediction",
    caption="Error of the predicted force of each actuator on a motion that was not used for the "
    "estimate. Dashed: where the noise alone leaves 95 % of it.",
    draw=draw_prediction,
)
