"""Scan of the pitch of forces that are periodic in the struts' lengths."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from estimation.diagnostics.record import ExperimentRecord
from results.figures.definition import FigureDefinition
from results.figures.estimation.panels import corner_text, strut_panels
from results.style import ALERT, FAINT, MUTED, STRUT_COLOURS, new_figure


def draw(record: ExperimentRecord) -> Figure:
    """Draw the statistic over the pitch: of the residuals, and with what was found taken out."""
    tests = record.tests
    forces = {e.strut: e.force for e in tests.effects if e.force is not None}
    figure = new_figure(5.4)
    panels = strut_panels(figure, "Strut", (3, 2), share=True)
    for strut, (axes, scan) in enumerate(zip(panels, tests.position_periodic, strict=True)):
        rows = [row for row in record.pitches if row.strut == strut + 1]
        if not rows:
            axes.text(0.5, 0.5, "not scanned", transform=axes.transAxes, ha="center", color=MUTED)
            continue
        pitch = [1e3 * row.pitch for row in rows]
        if tests.effects:
            first = [row.statistic for row in rows]
            axes.plot(pitch, first, color=FAINT, linewidth=0.9, zorder=2)
        last = [row.statistic_with_effects for row in rows]
        axes.plot(pitch, last, color=STRUT_COLOURS[strut], linewidth=0.9, zorder=3)
        axes.axhline(scan.critical, color=ALERT, linewidth=0.9, linestyle=(0, (4, 2)), zorder=4)
        force = forces.get(strut)
        if force is not None:
            corner_text(
                axes,
                f"position-periodic:\n{force.amplitude:.3g} ± {force.amplitude_std:.1g} N\n"
                f"pitch {1e3 * force.pitch:.3f} mm",
            )
    _scales(panels[0], tests.position_periodic[0].critical)
    figure.supxlabel("Pitch (mm)", fontsize="medium")
    figure.supylabel("Statistic (χ² of sine and cosine)", fontsize="medium")
    return figure


def _scales(axes: Axes, critical: float) -> None:
    """Set the axes that all panels share."""
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    linear = 2 * critical if np.isfinite(critical) else 60.0
    axes.set_yscale("symlog", linthresh=linear, linscale=1.6)
    axes.set_ylim(bottom=0)


FIGURE = FigureDefinition(
    key="position_periodic",
    caption="Search for forces that are periodic in each strut's length (cogging): statistic over "
    "the pitch, grey in the residuals, coloured with the effects that were found taken out. "
    "Dashed: significant over all struts and pitches (family level 0.1 %).",
    draw=draw,
)
