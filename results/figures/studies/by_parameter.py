"""What a study shows of every parameter: precision and means of two designs, bias of estimators."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from constraints.arrays import Array
from estimation.studies import StudyRecord
from estimation.studies.design_study import rigid_body, shown_kinematics
from estimation.studies.identification_study import CASES, ESTIMATORS
from estimation.studies.records import ESTIMATES, MEANS, PRECISION, EstimateRow
from results.figures.drawing import FigureDefinition, parameter_axis, plain_decades, plain_ticks
from results.style import (
    BLUE,
    ESTIMATOR_LOOKS,
    FAINT,
    GREEN,
    INK,
    MUTED,
    VERMILLION,
    new_figure,
)

_WIDTH = 0.5
"""Of the points of one parameter, side by side."""

_CLEAR = 3.5
_LINEAR_REACH = 25.0
_KINEMATICS = {
    "exact": (GREEN, "no noise of the lengths"),
    "fourier": (BLUE, "Fourier differentiation"),
    "central": (VERMILLION, "central differences"),
}
_SHIFT = {"ls": -0.25, "gm": 0.0, "ml": 0.25}
_ERRORS = 3.0
_LARGEST_LINEAR_BIAS = 10.0
_BY_SET = "Parameter; one point for each set of initial parameters"


def draw_precision(study: StudyRecord) -> Figure:
    """Draw achieved standard deviations of LS, second criterion over first."""
    settings = study.summary.settings
    kinematics = shown_kinematics(settings["kinematics"])
    first, second = settings["criteria"]
    rows = [r for r in study.rows(PRECISION) if (r.kinematics, r.estimator) == (kinematics, "ls")]
    sets = sorted({row.set for row in rows})
    figure = new_figure(3.0)
    axes = figure.subplots()
    names = [row.parameter for row in rows if (row.set, row.criterion) == (sets[0], first)]
    for number, shift in zip(sets, _shifts(len(sets)), strict=True):
        one, two = (
            np.array([row.std for row in rows if (row.set, row.criterion) == (number, criterion)])
            for criterion in (first, second)
        )
        ratio = two / one
        colours = [BLUE if value > 1 else VERMILLION for value in ratio]
        axes.scatter(np.arange(len(names)) + shift, ratio, s=11, c=colours, linewidth=0, zorder=3)
    axes.axhline(1.0, color=INK, linewidth=0.9, zorder=2)
    axes.set_yscale("log")
    plain_decades(axes.yaxis)
    _parameter_axis(axes, names)
    axes.set_xlabel(_BY_SET)
    axes.set_ylabel(f"Std with '{second}' / std with '{first}'")
    axes.set_title(f"Above the line '{first}' knows the parameter better")
    return figure


def draw_means(study: StudyRecord) -> Figure:
    """Draw the differences of the mean LS estimates in standard errors, all sets."""
    rows = study.rows(MEANS)
    kinds = study.summary.settings["kinematics"]
    names = list(dict.fromkeys(row.parameter for row in rows))
    figure = new_figure(3.0)
    axes = figure.subplots()
    for kinematics, shift in zip(kinds, _shifts(len(kinds)), strict=True):
        t = [row.t for row in rows if row.kinematics == kinematics]
        places = np.arange(len(t)) % len(names) + shift  # all parameters of a set, set by set
        colour, title = _KINEMATICS[kinematics]
        axes.scatter(places, t, s=11, color=colour, linewidth=0, label=title, zorder=3)
    largest = max(2 * _CLEAR, *(abs(row.t) for row in rows))
    axes.axhspan(-_CLEAR, _CLEAR, color=FAINT, alpha=0.35, linewidth=0, zorder=1)
    if largest > _LINEAR_REACH:
        axes.set_yscale("symlog", linthresh=2 * _CLEAR, linscale=1.0)
    axes.yaxis.set_major_formatter(plain_ticks())
    room = 1.6 if largest > _LINEAR_REACH else 1.1
    axes.set_ylim(-room * largest, room * largest)
    _parameter_axis(axes, names)
    axes.set_xlabel(_BY_SET)
    axes.set_ylabel("Difference of means / standard error")
    figure.legend(loc="outside upper center", ncols=len(kinds))
    return figure


def draw_bias(study: StudyRecord) -> Figure:
    """Draw mean errors with three standard errors, in the std that ML states undisturbed."""
    found: dict[tuple[str, str], list[EstimateRow]] = {}
    for row in study.rows(ESTIMATES):
        found.setdefault((row.case, row.estimator), []).append(row)
    reference = found[CASES[0].key, "ml"]
    names = [row.parameter for row in reference]
    unit = np.array([row.bias / row.bias_over_std for row in reference])
    figure = new_figure(6.4)
    panels = figure.subplots(len(CASES), 1, sharex=True)
    for axes, case in zip(panels, CASES, strict=True):
        largest = 1.0
        for estimator in ESTIMATORS:
            rows = found[case.key, estimator]
            value = np.array([row.bias for row in rows]) / unit
            bar = _ERRORS * np.array([row.bias_std_error for row in rows]) / unit
            largest = max(largest, float(np.max(np.abs(value) + bar)))
            axes.errorbar(
                np.arange(len(names)) + _SHIFT[estimator],
                value,
                yerr=bar,
                **ESTIMATOR_LOOKS[estimator],
                linestyle="none",
                markersize=3.2,
                elinewidth=0.9,
                label=estimator.upper(),
                zorder=3,
            )
        axes.axhspan(-1, 1, color=FAINT, alpha=0.3, linewidth=0, zorder=1)
        axes.axhline(0, color=INK, linewidth=0.8, zorder=2)
        curved = largest > _LARGEST_LINEAR_BIAS  # beyond that a linear axis shows nothing else
        if curved:
            axes.set_yscale("symlog", linthresh=2.0, linscale=0.9)
        limit = (2.2 if curved else 1.15) * largest
        axes.set_ylim(-limit, limit)
        axes.yaxis.set_major_formatter(plain_ticks())
        _parameter_axis(axes, names)
        axes.set_title(f"{case.key}: {case.title}")
    panels[0].tick_params(labelbottom=False)
    panels[-1].set_xlabel("Parameter")
    figure.supylabel("Bias / standard deviation of one ML estimate", fontsize="medium")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


def _shifts(count: int) -> Array:
    return np.linspace(-_WIDTH / 2, _WIDTH / 2, count) if count > 1 else np.zeros(1)


def _parameter_axis(axes: Axes, names: Sequence[str]) -> None:
    """Label the axis with the parameters; a line parts rigid bodies from friction."""
    parameter_axis(axes, names, parted=True)
    rigid = np.count_nonzero(rigid_body(names))
    if 0 < rigid < len(names):
        axes.axvline(rigid - 0.5, color=MUTED, linewidth=0.9, zorder=1)


PRECISION_FIGURE = FigureDefinition(
    key="study_precision",
    caption="Achieved standard deviations of the LS estimates, second criterion over first, for "
    "every set of initial parameters. Left of the line the rigid bodies, right of it friction.",
    draw=draw_precision,
)
MEANS_FIGURE = FigureDefinition(
    key="study_means",
    caption="Difference of the mean LS estimates of both designs in its standard errors. In the "
    "band, of 3.5 standard errors, it may be chance. Noise of the lengths that is "
    "differentiated point by point biases each design's estimates differently.",
    draw=draw_means,
)
BIAS_FIGURE = FigureDefinition(
    key="study_bias",
    caption="Mean error of every parameter with three standard errors, in standard deviations that "
    "ML states for one undisturbed experiment (shaded: one of them). ML takes the Fourier series "
    "with the harmonics that the data show in all three cases.",
    draw=draw_bias,
)
