"""Quantiles of the forces' noise against those of the normal distribution."""

from __future__ import annotations

from matplotlib.figure import Figure

from estimation.diagnostics.noise_record import NoisePictures
from results.figures.definition import FigureDefinition
from results.figures.estimation.panels import strut_panels
from results.style import INK, STRUT_COLOURS, new_figure


def draw(pictures: NoisePictures) -> Figure:
    """Draw quantiles in standard deviations, dense in the tails, with their 95 % band."""
    found = pictures.quantiles
    figure = new_figure(4.6)
    for j, axes in enumerate(strut_panels(figure, "Actuator", share=True)):
        axes.fill_between(
            found.normal, found.low, found.high, color="#e4e4e4", linewidth=0, zorder=1
        )
        axes.plot(found.normal, found.normal, color=INK, linewidth=0.8, zorder=2)
        axes.plot(
            found.normal, found.noise[:, j], ".", color=STRUT_COLOURS[j], markersize=2.4, zorder=3
        )
    figure.supxlabel("Quantile of the normal distribution (standard deviations)", fontsize="medium")
    figure.supylabel("Quantile of the noise (standard deviations)", fontsize="medium")
    return figure


FIGURE = FigureDefinition(
    key="noise_quantiles",
    caption="Quantiles of the force noise of each actuator against those of the normal "
    "distribution. Grey: where each point lies with a probability of 95 % if the noise is normal.",
    draw=draw,
)
