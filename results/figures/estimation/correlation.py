"""Correlation of the parameters' estimates."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from estimation.identification.record import EstimateRecord
from estimation.uncertainty import correlation
from results.figures.definition import FigureDefinition
from results.style import new_figure
from results.symbols import symbol


def draw(record: EstimateRecord) -> Figure:
    """Draw the best estimator's correlation matrix."""
    summary = record.summary
    free = [k for k, name in enumerate(summary.parameters) if name not in summary.fixed]
    matrix = correlation(summary.best_estimator.covariance)[np.ix_(free, free)]
    figure = new_figure(4.6, width=5.2)
    axes = figure.subplots()
    image = axes.imshow(matrix, cmap="RdBu_r", vmin=-1, vmax=1, interpolation="nearest")
    labels = [symbol(summary.parameters[k]) for k in free]
    axes.set_xticks(range(len(free)), labels)
    axes.set_yticks(range(len(free)), labels)
    axes.tick_params(length=0)
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    axes.set_title(f"Correlation of the {summary.best.upper()} estimates")
    bar = figure.colorbar(image, ax=axes, shrink=0.8, ticks=[-1, -0.5, 0, 0.5, 1])
    bar.outline.set_visible(False)
    return figure


FIGURE = FigureDefinition(
    key="correlation",
    caption="Correlation between the estimates of the parameters, best estimator.",
    draw=draw,
)
