"""Predicted standard deviation of every parameter, relative to its nominal value."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import Container
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from constraints.arrays import Array
from expdesign.experiment import DesignRecord
from expdesign.experiment.result import IDENTIFIABLE
from results.figures.definition import FigureDefinition
from results.figures.legends import legend_above
from results.style import ALERT, EMPHASIS, MUTED, SECOND, new_figure
from results.symbols import symbol

_IDENTIFIABLE = 100 * IDENTIFIABLE
_WIDTH = 0.38


def draw(record: DesignRecord) -> Figure:
    """Draw two bars per parameter, one period and the whole experiment, on a logarithmic axis."""
    parameters, summary = record.parameters, record.summary
    experiment = summary.predicted_std.experiment
    periods = experiment.periods
    percents = np.array(
        [(p.rel_std_percent_per_period, p.rel_std_percent_experiment) for p in parameters]
    )
    series = (
        (
            f"one period ({_count(summary.samples)} samples)",
            percents[:, 0],
            SECOND,
            -_WIDTH / 2,
        ),
        (
            f"experiment ({periods:g} period{'s' * (periods != 1)}, "
            f"{_count(experiment.samples)} samples)",
            percents[:, 1],
            EMPHASIS,
            _WIDTH / 2,
        ),
    )
    figure = new_figure(3.3)
    axes = figure.subplots()
    position = np.arange(len(parameters), dtype=float)
    floor = _scale(axes, percents)
    handles: list[Container] = []
    for label, percent, colour, shift in series:
        known = np.isfinite(percent) & (percent > 0)
        handles.append(
            axes.bar(
                position[known] + shift,
                percent[known] - floor,
                width=_WIDTH,
                bottom=floor,
                color=colour,
                label=label,
                zorder=2,
            )
        )
    for k in np.flatnonzero(~np.any(np.isfinite(percents), axis=1)):
        axes.text(
            position[k],
            0.03,
            "nominal value 0",
            transform=axes.get_xaxis_transform(),
            rotation=90,
            ha="center",
            va="bottom",
            color=MUTED,
            fontsize="small",
        )
    axes.axhline(_IDENTIFIABLE, color=ALERT, linewidth=1.0, zorder=3)
    axes.annotate(
        f"{_IDENTIFIABLE:g} %\nidentifiable\nbelow",
        (1.0, _IDENTIFIABLE),
        xycoords=("axes fraction", "data"),
        xytext=(4, 0),
        textcoords="offset points",
        va="center",
        color=ALERT,
        fontsize="small",
        annotation_clip=False,
    )
    axes.set_xticks(position, [symbol(parameter.name) for parameter in parameters])
    axes.tick_params(axis="x", length=0)
    axes.grid(visible=False, axis="x")
    axes.set_xlim(-0.7, len(parameters) - 0.3)
    axes.set_xlabel("Parameter")
    axes.set_ylabel("Standard deviation / |nominal| (%)")
    axes.set_title("Predicted precision")
    legend_above(axes, handles)
    return figure


def _scale(axes: Axes, percent: Array) -> float:
    """Set the logarithmic axis; return where the bars begin."""
    shown = np.append(percent[np.isfinite(percent) & (percent > 0)], _IDENTIFIABLE)
    floor = 10.0 ** np.floor(np.log10(np.min(shown) / 1.5))
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_ylim(floor, 2.0 * np.max(shown))
    return float(floor)


def _count(number: int) -> str:
    return f"{number:,}".replace(",", "\u202f")


FIGURE = FigureDefinition(
    key="precision",
    caption="Predicted standard deviation of every parameter relative to its nominal value, over "
    "one period of the design and over the whole experiment.",
    draw=draw,
)
