"""Mean residual forces over one period, actuator by actuator."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from estimation.diagnostics import ExperimentDiagnosis
from results.figures.definition import FigureDefinition
from results.figures.estimation.panels import corner_text, strut_panels
from results.style import MUTED, STRUT_COLOURS, new_figure

_BAND = 1.96


def draw(diagnosis: ExperimentDiagnosis) -> Figure:
    """Draw the residuals with the band in which noise alone leaves 95 % of them."""
    rest, test = diagnosis.residuals, diagnosis.lack_of_fit
    figure = new_figure(5.4)
    order = np.argsort(rest.times)
    time = rest.times[order]
    # One outlier shall not flatten six panels.
    height = 1.1 * float(np.max(np.quantile(np.abs(rest.forces), 0.9995, axis=0)))
    height = max(height, 1.3 * _BAND * float(np.max(rest.force_std)))
    for j, axes in enumerate(strut_panels(figure, "Actuator", (3, 2), share=True)):
        band = _BAND * rest.force_std[order, j]
        axes.plot(time, rest.forces[order, j], color=STRUT_COLOURS[j], linewidth=0.5, zorder=2)
        axes.plot(time, band, color=MUTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=3)
        axes.plot(time, -band, color=MUTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=3)
        axes.set_ylim(-height, 1.25 * height)
        axes.set_xlim(time[0], time[-1])
        if not test.refused:
            words = "bias" if test.failed[j] else "no bias"
            corner_text(axes, f"{words}: F = {test.statistic[j]:.2f}")
    figure.supxlabel("Time (s)", fontsize="medium")
    figure.supylabel("Measured − predicted force, mean over the periods (N)", fontsize="medium")
    return figure


FIGURE = FigureDefinition(
    key="residuals",
    caption="Residual force of each actuator over one period, mean over the periods. Dashed: where "
    "the noise alone leaves 95 % of it. F: bias against the scatter between the periods.",
    draw=draw,
)
