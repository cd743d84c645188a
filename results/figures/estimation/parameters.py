"""Estimates against the a-priori values, and their correlation."""

from __future__ import annotations

import numpy as np
from matplotlib.container import Container
from matplotlib.figure import Figure

from estimation.identification.record import EstimateRecord
from estimation.uncertainty import correlation
from results.figures.drawing import (
    FigureDefinition,
    correlation_image,
    legend_above,
    parameter_axis,
    standing_text,
)
from results.style import ESTIMATOR_LOOKS, MUTED, new_figure
from results.symbols import symbol

_SPREAD = 0.5


def draw_estimates(record: EstimateRecord) -> Figure:
    """Draw deviations in units of the best estimator's standard deviation."""
    figure = new_figure(3.4)
    axes = figure.subplots()
    tables = record.by_estimator()
    best = record.summary.best
    names = record.summary.parameters
    position = np.arange(len(names), dtype=float)
    unit = np.array([row.std for row in tables[best]])
    free = np.isfinite(unit)
    handles: list[Container] = []
    for place, (name, rows) in enumerate(tables.items()):
        shift = _SPREAD * ((place + 0.5) / len(tables) - 0.5)
        numbers = np.array([(row.value, row.a_priori, row.ci_high) for row in rows])[free]
        handles.append(
            axes.errorbar(
                position[free] + shift,
                (numbers[:, 0] - numbers[:, 1]) / unit[free],
                yerr=(numbers[:, 2] - numbers[:, 0]) / unit[free],
                **ESTIMATOR_LOOKS[name],
                linestyle="none",
                markersize=3.0,
                elinewidth=1.0,
                capsize=1.5,
                label=name.upper(),
                zorder=2,
            )
        )
    standing_text(axes, position[~free], "fixed")
    axes.axhline(0.0, color=MUTED, linewidth=0.8, zorder=1)
    parameter_axis(axes, names)
    axes.set_xlabel("Parameter")
    axes.set_ylabel(f"(Estimate − a priori) / std of {best.upper()}")
    axes.set_title("Estimates against the a-priori values, 95 % intervals")
    legend_above(axes, handles)
    return figure


ESTIMATES = FigureDefinition(
    key="estimates",
    caption="Deviation of every estimate from the a-priori value, in units of the best estimator's "
    "standard deviation, with 95 % intervals. The a-priori values do not enter the estimates.",
    draw=draw_estimates,
)


def draw_correlation(record: EstimateRecord) -> Figure:
    """Draw the best estimator's correlation matrix."""
    summary = record.summary
    free = [k for k, name in enumerate(summary.parameters) if name not in summary.fixed]
    matrix = correlation(summary.best_estimator.covariance)[np.ix_(free, free)]
    figure = new_figure(4.6, width=5.2)
    axes = figure.subplots()
    correlation_image(axes, matrix, [symbol(summary.parameters[k]) for k in free], "RdBu_r")
    axes.set_title(f"Correlation of the {summary.best.upper()} estimates")
    return figure


CORRELATION = FigureDefinition(
    key="correlation",
    caption="Correlation between the estimates of the parameters, best estimator.",
    draw=draw_correlation,
)

ESTIMATE_FIGURES: tuple[FigureDefinition[EstimateRecord], ...] = (ESTIMATES, CORRELATION)
"""What is shown of the parameters, in the order of a report."""
