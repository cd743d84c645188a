"""Distribution of the forces' noise per actuator, with the normal curve: the paper's Fig. 4."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from estimation.diagnostics.noise_record import NoisePictures
from results.figures.definition import FigureDefinition
from results.figures.estimation.panels import corner_text, strut_panels
from results.style import INK, STRUT_COLOURS, new_figure
from results.units import plain_number


def draw(pictures: NoisePictures) -> Figure:
    """Draw a histogram per actuator; what lies beyond the axis is counted in its outer bins."""
    bins, test = pictures.histogram, pictures.normality
    figure = new_figure(4.3)
    reach = float(bins.high[-1])
    for j, axes in enumerate(strut_panels(figure, "Actuator", share=True)):
        axes.hist(
            bins.low,
            bins=[*bins.low.tolist(), reach],
            weights=bins.counts[:, j],
            density=True,
            color=STRUT_COLOURS[j],
            alpha=0.55,
            linewidth=0,
        )
        grid = np.linspace(-reach, reach, 400)
        curve = stats.norm.pdf(grid, test.mean[j], test.std[j])
        axes.plot(grid, curve, color=INK, linewidth=1.0)
        axes.set_xlim(-reach, reach)
        axes.grid(visible=False, axis="x")
        corner_text(
            axes,
            f"std {plain_number(test.std[j], 3)} N\nskew {_signed(test.skewness[j])}\n"
            f"kurt {_signed(test.kurtosis[j])}\np = {plain_number(test.p_values[j], 2)}",
        )
    figure.supxlabel("Noise of one force sample (N)", fontsize="medium")
    figure.supylabel("Probability density (1/N)", fontsize="medium")
    return figure


def _signed(value: float) -> str:
    return f"{value:+.2f}".replace("-", "−")


FIGURE = FigureDefinition(
    key="noise_distribution",
    caption="Distribution of the force noise of each actuator and the normal curve with the same "
    "mean and standard deviation; skewness, excess kurtosis and the p-value of normality.",
    draw=draw,
)
