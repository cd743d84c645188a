"""Measured minus predicted force over time, motion by motion: the paper's Fig. 7."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from estimation.validation import MotionValidation
from results.figures.definition import FigureDefinition
from results.figures.estimation.panels import corner_text, strut_panels
from results.style import ALERT, MUTED, STRUT_COLOURS, new_figure

_BAND = 1.96


def draw(motion: MotionValidation) -> Figure:
    """Draw the error of the prediction with the band in which noise alone leaves 95 % of it."""
    diagnosis = motion.diagnosis.experiments[0]
    rest, test = diagnosis.residuals, diagnosis.lack_of_fit
    figure = new_figure(5.4)
    order = np.argsort(rest.times)
    time = rest.times[order] - rest.times[order][0]
    height = 1.1 * float(np.max(np.quantile(np.abs(rest.forces), 0.9995, axis=0)))
    height = max(height, 1.3 * _BAND * float(np.max(rest.force_std)))
    for j, axes in enumerate(strut_panels(figure, "Actuator", (3, 2), share=True)):
        band = _BAND * rest.force_std[order, j]
        axes.plot(time, rest.forces[order, j], color=STRUT_COLOURS[j], linewidth=0.5, zorder=2)
        for sign in (1, -1):
            axes.plot(
                time, sign * band, color=MUTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=3
            )
        axes.set_ylim(-height, 1.3 * height)
        axes.set_xlim(time[0], time[-1])
        if test.refused:
            corner_text(axes, "not tested")
        else:
            words = "fails" if test.failed[j] else "passes"
            corner_text(axes, f"{words}: F = {test.statistic[j]:.2f}")
            if test.failed[j]:
                axes.texts[-1].set_color(ALERT)
    figure.suptitle(motion.name, fontsize="medium")
    figure.supxlabel("Time (s)", fontsize="medium")
    figure.supylabel("Measured − predicted force, mean over the periods (N)", fontsize="medium")
    return figure


FIGURE = FigureDefinition(
    key="prediction",
    caption="Error of the predicted force of each actuator on a motion that was not used for the "
    "estimate. Dashed: where the noise alone leaves 95 % of it.",
    draw=draw,
)
