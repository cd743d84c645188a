"""Figures of parameters: predicted precision, estimates, comparisons, selection of terms."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.container import Container
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from constraints.arrays import Array
from expdesign.experiment import DesignResult
from expdesign.information.identifiable import IDENTIFIABLE
from results.figures import drawing
from results.notation import readable, symbol

if TYPE_CHECKING:  # an estimate's modules take half a second to load, which no design needs
    from estimation.identification.result import EstimationResult
    from estimation.selection import SelectionRow

_IDENTIFIABLE = 100 * IDENTIFIABLE
_WIDTH = 0.38


def _precision_seen(result: DesignResult) -> str:
    """Return what is in the bars, and the parameters with the smallest and the largest one."""
    known = [one for one in result.parameters if np.isfinite(one.rel_std_percent)]
    parts = ["The experiment's are with tolerances."] if result.systematic else []
    if result.configuration.run.design.prior is not None:
        parts.append("All are with the whole prior.")
    if not known:
        return " ".join(parts)
    ordered = sorted(known, key=lambda one: one.rel_std_percent)
    best, worst = (f"{one.name}, {one.rel_std_percent:.2g} %" for one in (ordered[0], ordered[-1]))
    return " ".join([*parts, f"The experiment determines best {best}, worst {worst}."])


@drawing.figure_definition(
    "precision",
    "Predicted standard deviation of every parameter relative to its nominal value, by the noise "
    "of one period of the design and over the whole experiment.",
    height=3.3,
    seen=_precision_seen,
)
def precision_figure(figure: Figure, result: DesignResult) -> None:
    """Draw two bars per parameter, one period and the whole experiment, on a logarithmic axis."""
    parameters, experiment = result.parameters, result.experiment
    periods = experiment.periods
    whole = f"experiment ({periods:g} period{'s' * (periods != 1)}"
    tolerated = ", with tolerances)"  # the number of samples would not fit into the title
    whole += tolerated if result.systematic else f", {_count(experiment.samples)} samples)"
    percents = np.array([(p.rel_std_percent_per_period, p.rel_std_percent) for p in parameters])
    series = (
        (f"one period ({_count(result.samples)} samples)", drawing.SECOND, -_WIDTH / 2),
        (whole, drawing.EMPHASIS, _WIDTH / 2),
    )
    axes = figure.subplots()
    position = np.arange(len(parameters), dtype=float)
    shown = np.append(percents[np.isfinite(percents) & (percents > 0)], _IDENTIFIABLE)
    floor = float(10.0 ** np.floor(np.log10(np.min(shown) / 1.5)))
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(drawing.plain_ticks())
    axes.set_ylim(floor, 2.0 * np.max(shown))
    handles: list[Container] = []
    for percent, (label, colour, shift) in zip(percents.T, series, strict=True):
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
    drawing.write_upright(axes, position[unknown], "nominal value 0")
    axes.axhline(_IDENTIFIABLE, color=drawing.ALERT, linewidth=1.0, zorder=3)
    drawing.write_margin(
        axes, _IDENTIFIABLE, f"{_IDENTIFIABLE:g} %\nidentifiable\nbelow", drawing.ALERT
    )
    drawing.set_parameter_axis(axes, [parameter.name for parameter in parameters])
    axes.set(ylabel="Standard deviation / |nominal| (%)", title="Predicted precision")
    drawing.add_legend_above(axes, handles)


def _count(number: int) -> str:
    return f"{number:,}".replace(",", "\u202f")


_SPREAD = 0.5


@drawing.figure_definition(
    "estimates",
    "Deviation of every estimate from the a-priori value, in units of the best estimator's "
    "standard deviation, with 95 % intervals. The a-priori values enter the estimates only where "
    "the run states a prior or holds parameters fixed.",
    height=3.4,
)
def estimates_figure(figure: Figure, result: EstimationResult) -> None:
    """Draw deviations in units of the best estimator's standard deviation."""
    axes = figure.subplots()
    tables = result.by_estimator()
    best = result.best
    names = result.parameters
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
                capsize=1.5,
                label=name.upper(),
                **drawing.ESTIMATOR_LOOKS[name]
                | {"markersize": 3.0, "elinewidth": 1.0, "zorder": 2},
            )
        )
    drawing.write_upright(axes, position[~free], "fixed")
    axes.axhline(0.0, color=drawing.MUTED, linewidth=0.8, zorder=1)
    drawing.set_parameter_axis(axes, names)
    axes.set_ylabel(f"(Estimate − a priori) / std of {best.upper()}")
    axes.set_title("Estimates against the a-priori values, 95 % intervals")
    drawing.add_legend_above(axes, handles)


def _correlation(result: EstimationResult) -> tuple[list[str], Array]:
    """Return the names of the free parameters and the correlation of their best estimates."""
    free = [k for k, name in enumerate(result.parameters) if name not in result.fixed]
    matrix = result.correlations[result.best][np.ix_(free, free)]
    return [result.parameters[k] for k in free], matrix


def _correlation_seen(result: EstimationResult) -> str:
    names, matrix = _correlation(result)
    others = np.nan_to_num(np.abs(np.triu(matrix, 1)))
    if not np.any(others):
        return ""
    j, k = np.unravel_index(int(np.argmax(others)), others.shape)
    return f"The largest is that of {names[j]} and {names[k]}, {matrix[j, k]:.2f}."


@drawing.figure_definition(
    "correlation",
    "Correlation between the estimates of the parameters, best estimator.",
    height=4.6,
    width=5.2,
    seen=_correlation_seen,
)
def correlation_figure(figure: Figure, result: EstimationResult) -> None:
    """Draw the best estimator's correlation matrix."""
    names, matrix = _correlation(result)
    axes = figure.subplots()
    drawing.draw_correlation(axes, matrix, [symbol(name) for name in names], "RdBu_r")
    axes.set_title(f"Correlation of the {result.best.upper()} estimates")


ESTIMATE_FIGURES = (estimates_figure, correlation_figure)
"""Figures of the parameters, in the order of a report."""

MARKERS = ("o", "s", "^", "D", "v", "P")


@dataclass(frozen=True, eq=False)
class ParameterSeries:
    """Several folders side by side: values of the parameters by folder, (m,), NaN where unknown.

    The errors are half-widths of intervals.
    """

    names: tuple[str, ...]
    values: dict[str, Array]
    errors: dict[str, Array] = field(default_factory=dict)


def draw_series(axes: Axes, result: ParameterSeries) -> None:
    """Draw a mark for each folder over every parameter."""
    count = len(result.values)
    step = min(0.18, 0.7 / max(count, 1))
    places = np.arange(len(result.names))
    for number, (label, values) in enumerate(result.values.items()):
        axes.errorbar(
            places + step * (number - (count - 1) / 2),
            values,
            yerr=result.errors.get(label),
            color=drawing.PALETTE[number % len(drawing.PALETTE)],
            marker=MARKERS[number // len(drawing.PALETTE) % len(MARKERS)],
            markersize=3.6,
            linestyle="none",
            elinewidth=1.0,
            # A name that begins with an underscore would be left out of the legend.
            label=f"\u200b{label}",
        )
    drawing.set_parameter_axis(axes, result.names)


@drawing.figure_definition(
    "compared_precision",
    "Predicted standard deviation of every parameter relative to its nominal value, for the same "
    "measuring time and sampling rate, with all of the prior of a design that has one.",
    height=2.9,
)
def compared_precision_figure(figure: Figure, result: ParameterSeries) -> None:
    """Draw one mark per design over every parameter, logarithmic."""
    axes = figure.add_subplot()
    draw_series(axes, result)
    axes.set_yscale("log")
    axes.set_ylabel("Predicted σ / nominal value (%)")
    figure.legend(loc="outside upper right", ncols=4)


@drawing.figure_definition(
    "compared_estimates",
    "Deviation of every estimate from that of the first folder, in units of the first's "
    "standard deviation, with 95 % intervals.",
    height=2.9,
)
def compared_estimates_figure(figure: Figure, result: ParameterSeries) -> None:
    """Draw the deviation of every estimate from the first folder's, in units of its σ."""
    axes = figure.add_subplot()
    axes.axhline(0.0, color=drawing.MUTED, linewidth=0.8)
    draw_series(axes, result)
    axes.set_ylabel("Deviation from the first (σ)")
    figure.legend(loc="outside upper right", ncols=4)


WORTH = {
    "bic": "fall of Schwarz's criterion with the term",
    "f": "ln(level) − ln(p) of the term",
    "holdout": "fall of −2 log L of held-out data with the term",
}
"""Criterion of a term in words: the term belongs to the model where it is above zero."""
_MOST_STEPS = 14
"""That fit into a figure: the last ones are shown."""


@drawing.figure_definition(
    "selection",
    "Selection of terms, step by step: what each candidate is worth in the model. Forward, the one "
    "that is worth most is added (framed) if it is worth more than zero; backward, the one that is "
    "worth least leaves (framed) if it is worth nothing with the others. A dot: in the model, "
    "and not tried in this step.",
    height=3.2,
)
def selection_figure(figure: Figure, result: EstimationResult) -> None:
    """Draw a cell for every candidate in every step, with its worth."""
    found = result.selection
    if found is None:
        raise ValueError("no terms were tried")
    axes = figure.subplots()
    names = [candidate.name for candidate in found.candidates]
    numbers = sorted({row.step for row in found.steps})[-_MOST_STEPS:]
    for place, number in enumerate(numbers):
        rows = [row for row in found.steps if row.step == number]
        _draw_step(axes, place, rows, names)
    last = len(numbers)
    for height, name in enumerate(names):
        if name in found.chosen:
            axes.plot(last, height, "o", color=drawing.EMPHASIS, markersize=6)
    directions = {row.step: row.direction for row in found.steps}
    heads = [f"{number}\n{directions[number]}" for number in numbers]
    axes.set_xticks(range(last + 1), [*heads, "result"])
    axes.set_yticks(range(len(names)), names)
    axes.set(xlim=(-0.55, last + 0.55), ylim=(len(names) - 0.45, -0.55), xlabel="Step")
    axes.tick_params(length=0)
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    axes.set_title(f"Selection of terms: {WORTH[found.by]}")


def _draw_step(axes: Axes, place: int, rows: list[SelectionRow], names: list[str]) -> None:
    worth = {row.term: row for row in rows}
    inside = set(rows[0].others.split()) if rows[0].direction == "add" else set()
    largest = max(1.0, *(abs(row.worth) for row in rows))
    for height, name in enumerate(names):
        if name in inside:
            axes.plot(place, height, "o", color=drawing.MUTED, markersize=3)
        if name not in worth:
            continue
        row = worth[name]
        share = np.sqrt(abs(row.worth) / largest)
        colour = drawing.SECOND if row.worth > 0 else drawing.FAINT
        corner = (place - 0.45, height - 0.4)
        axes.add_patch(Rectangle(corner, 0.9, 0.8, color=colour, alpha=0.15 + 0.55 * share, lw=0))
        if row.chosen:
            axes.add_patch(
                Rectangle(corner, 0.9, 0.8, fill=False, edgecolor=drawing.EMPHASIS, lw=1.4)
            )
        weight = "bold" if row.chosen else "normal"
        text = readable(float(f"{row.worth:.3g}"), 3)
        axes.text(
            place,
            height,
            text,
            ha="center",
            va="center",
            color=drawing.INK,
            fontsize=7,
            weight=weight,
        )
