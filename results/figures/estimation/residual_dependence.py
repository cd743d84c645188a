"""Mean residual forces against position and speed of their strut."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from estimation.diagnostics.record import ExperimentRecord
from results.figures.definition import FigureDefinition
from results.style import MUTED, STRUT_COLOURS, new_figure
from results.units import handy_unit


def draw(record: ExperimentRecord) -> Figure:
    """Draw one row per strut: means in bins with their 95 % intervals."""
    figure = new_figure(7.8)
    panels = figure.subplots(6, 2, sharex="col", sharey=True)
    columns = (("length", "m"), ("speed", "m/s"))
    for column, (over, si) in enumerate(columns):
        rows = [row for row in record.dependence if row.over == over]
        unit = handy_unit(si, [row.centre for row in rows])
        for j in range(6):
            axes = panels[j, column]
            axes.axhline(0, color=MUTED, linewidth=0.7, zorder=1)
            bins = np.array(
                [(r.centre, r.mean, r.half_width) for r in rows if r.strut == j + 1]
            ).reshape(-1, 3)
            axes.errorbar(
                unit.shown(bins[:, 0]),
                bins[:, 1],
                yerr=bins[:, 2],
                fmt="o",
                markersize=2.2,
                color=STRUT_COLOURS[j],
                elinewidth=0.8,
                zorder=2,
            )
            if column == 0:
                axes.set_ylabel(f"{j + 1}", rotation=0, labelpad=10, va="center", weight="bold")
        panels[-1, column].set_xlabel(unit.label(f"Strut {over}"))
        panels[0, column].set_title(f"Over the {over}")
    figure.supylabel("Strut: mean residual force (N)", fontsize="medium")
    return figure


FIGURE = FigureDefinition(
    key="residual_dependence",
    caption="Residual force of each actuator, averaged in bins of its strut's length (left) and "
    "speed (right), with 95 % intervals from the noise.",
    draw=draw,
)
