"""Quantiles of the forces' noise against those of the normal distribution."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from estimation.diagnostics.noise_tests import NoiseTests
from results.figures.definition import FigureDefinition
from results.figures.estimation.panels import strut_panels
from results.style import INK, STRUT_COLOURS, new_figure

_POINTS = 400


def draw(diagnosis: NoiseTests) -> Figure:
    """Draw quantiles in standard deviations, dense in the tails, with their 95 % band."""
    samples = diagnosis.samples.forces.pooled
    count = len(samples)
    figure = new_figure(4.6)
    rank = np.unique(
        np.concatenate(
            [
                np.arange(min(count, 40)),
                np.linspace(0, count - 1, _POINTS).astype(int),
                count - 1 - np.arange(min(count, 40)),
            ]
        )
    )
    share = (rank + 0.5) / count
    normal = stats.norm.ppf(share)
    low = stats.norm.ppf(stats.beta.ppf(0.025, rank + 1, count - rank))
    high = stats.norm.ppf(stats.beta.ppf(0.975, rank + 1, count - rank))
    for j, axes in enumerate(strut_panels(figure, "Actuator", share=True)):
        centred = samples[:, j] - samples[:, j].mean()
        ordered = np.sort(centred / centred.std(ddof=1))[rank]
        axes.fill_between(normal, low, high, color="#e4e4e4", linewidth=0, zorder=1)
        axes.plot(normal, normal, color=INK, linewidth=0.8, zorder=2)
        axes.plot(normal, ordered, ".", color=STRUT_COLOURS[j], markersize=2.4, zorder=3)
    figure.supxlabel("Quantile of the normal distribution (standard deviations)", fontsize="medium")
    figure.supylabel("Quantile of the noise (standard deviations)", fontsize="medium")
    return figure


FIGURE = FigureDefinition(
    key="noise_quantiles",
    caption="Quantiles of the force noise of each actuator against those of the normal "
    "distribution. Grey: where each point lies with a probability of 95 % if the noise is normal.",
    draw=draw,
)
