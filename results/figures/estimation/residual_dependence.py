"""Mean residual forces against position and speed of their strut."""

from __future__ import annotations

from matplotlib.figure import Figure

from estimation.diagnostics import ExperimentDiagnosis
from results.figures.definition import FigureDefinition
from results.style import MUTED, STRUT_COLOURS, new_figure
from results.units import handy_unit


def draw(diagnosis: ExperimentDiagnosis) -> Figure:
    """Draw one row per strut: means in bins with their 95 % intervals."""
    figure = new_figure(7.8)
    panels = figure.subplots(6, 2, sharex="col", sharey=True)
    columns = (
        ("Strut length", "m", diagnosis.dependence.position),
        ("Strut speed", "m/s", diagnosis.dependence.speed),
    )
    for column, (label, si, struts) in enumerate(columns):
        unit = handy_unit(si, [value for strut in struts for value in strut.centres])
        for j, strut in enumerate(struts):
            axes = panels[j, column]
            axes.axhline(0, color=MUTED, linewidth=0.7, zorder=1)
            axes.errorbar(
                unit.shown(strut.centres),
                strut.means,
                yerr=strut.half_widths,
                fmt="o",
                markersize=2.2,
                color=STRUT_COLOURS[j],
                elinewidth=0.8,
                zorder=2,
            )
            if column == 0:
                axes.set_ylabel(f"{j + 1}", rotation=0, labelpad=10, va="center", weight="bold")
        panels[-1, column].set_xlabel(unit.label(label))
        panels[0, column].set_title(f"Over the {label.split()[1]}")
    figure.supylabel("Strut: mean residual force (N)", fontsize="medium")
    return figure


FIGURE = FigureDefinition(
    key="residual_dependence",
    caption="Residual force of each actuator, averaged in bins of its strut's length (left) and "
    "speed (right), with 95 % intervals from the noise.",
    draw=draw,
)
