"""Predicted standard deviation of every parameter, relative to its nominal value."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import Container
from matplotlib.figure import Figure

from constraints.arrays import Array
from expdesign.experiment import DesignRecord
from expdesign.experiment.result import IDENTIFIABLE
from results.figures.drawing import (
    FigureDefinition,
    legend_above,
    margin_text,
    parameter_axis,
    plain_ticks,
    standing_text,
)
from results.style import ALERT, EMPHASIS, SECOND, new_figure

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
    unknown = ~np.any(np.isfinite(percents), axis=1)
    standing_text(axes, position[unknown], "nominal value 0")
    axes.axhline(_IDENTIFIABLE, color=ALERT, linewidth=1.0, zorder=3)
    margin_text(axes, _IDENTIFIABLE, f"{_IDENTIFIABLE:g} %\nidentifiable\nbelow", ALERT)
    parameter_axis(axes, [parameter.name for parameter in parameters])
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
    axes.yaxis.set_major_formatter(plain_ticks())
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
