"""Bias of every parameter in units of the bound, estimators side by side."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from results.figures.definition import FigureDefinition
from results.figures.legends import legend_above
from results.figures.montecarlo.series import Series, parameter_axis, points
from results.style import FAINT, MUTED, new_figure

CLEAR = 3.5
"""Standard errors from which on a bias is no chance: one in 2 000."""

_LINEAR_REACH = 12.0


def draw(series: Series) -> Figure:
    """Draw the bias with its standard error, and the band in which chance leaves it.

    The axis is linear near zero and logarithmic further out when biases are large.
    """
    band = CLEAR / np.sqrt(min(one.estimates for one in series))
    figure = new_figure(3.3)
    axes = figure.subplots()
    handles = []
    largest = band
    for number, one in enumerate(series):
        bias, error = one.bias, one.bias_std_error
        largest = max(largest, float(np.nanmax(np.abs(bias) + np.nan_to_num(error))))
        handles.append(points(axes, series, number, bias, np.stack([error, error])))
    axes.axhspan(-band, band, color=FAINT, alpha=0.35, linewidth=0, zorder=1)
    axes.axhline(0.0, color=MUTED, linewidth=0.8, zorder=2)
    room = 1.25
    if largest > _LINEAR_REACH * band:
        room = 2.0
        axes.set_yscale("symlog", linthresh=2 * band, linscale=0.8)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}".replace("-", "−")))
        decades = 10.0 ** np.arange(np.ceil(np.log10(2 * band)), np.ceil(np.log10(room * largest)))
        axes.set_yticks([*-decades[::-1], 0.0, *decades])
    axes.set_ylim(-room * largest, room * largest)
    axes.annotate(
        f"±{CLEAR:g} standard\nerrors at\nthe bound",
        (1.0, 0.0),
        xycoords=("axes fraction", "data"),
        xytext=(4, 0),
        textcoords="offset points",
        va="center",
        color=MUTED,
        fontsize="small",
        annotation_clip=False,
    )
    parameter_axis(axes, series)
    axes.set_xlabel("Parameter")
    axes.set_ylabel("Bias / Cramér–Rao bound")
    axes.set_title("Bias")
    legend_above(axes, handles)
    return figure


FIGURE = FigureDefinition(
    key="montecarlo_bias",
    caption="Mean error of every parameter over all repetitions with its standard error, in units "
    "of the Cramér–Rao bound; in brackets the number of estimates. Within the band, of 3.5 "
    "standard errors of an estimator that reaches the bound, a bias cannot be told from chance.",
    draw=draw,
)
