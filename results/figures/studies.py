"""Figures of studies on the digital twin: designs, estimators, validations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import scipy

from constraints.arrays import Array
from estimation.studies.design_study import DesignStudy, rigid_body, shown_kinematics
from estimation.studies.identification_study import CASES, ESTIMATORS
from estimation.studies.records import (
    ESTIMATES,
    MEANS,
    PRECISION,
    VARIANCES,
    EstimateRow,
    StudyRecord,
)
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.mechanism.hexapod import ACTUATORS
from results.figures.drawing import (
    FigureDefinition,
    figure_definition,
    named_places,
    parameter_axis,
    plain_decades,
    plain_ticks,
)
from results.notation import symbol
from results.style import ALERT, BLUE, ESTIMATOR_LOOKS, FAINT, GREEN, INK, MUTED, VERMILLION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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


@figure_definition(
    "study_precision",
    "Achieved standard deviations of the LS estimates, second criterion over first, for "
    "every set of initial parameters. Left of the line the rigid bodies, right of it friction.",
    height=3.0,
)
def precision_figure(figure: Figure, study: StudyRecord) -> None:
    """Draw achieved standard deviations of LS, second criterion over first."""
    settings = study.summary.settings
    kinematics = shown_kinematics(settings["kinematics"])
    first, second = settings["criteria"]
    rows = [r for r in study.rows(PRECISION) if (r.kinematics, r.estimator) == (kinematics, "ls")]
    sets = sorted({row.set for row in rows})
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
    _parameter_axis(axes, names, _BY_SET)
    axes.set_ylabel(f"Std with '{second}' / std with '{first}'")
    axes.set_title(f"Above the line '{first}' knows the parameter better")


@figure_definition(
    "study_means",
    "Difference of the mean LS estimates of both designs in its standard errors. In the "
    "band, of 3.5 standard errors, it may be chance. Noise of the lengths that is "
    "differentiated point by point biases each design's estimates differently.",
    height=3.0,
)
def means_figure(figure: Figure, study: StudyRecord) -> None:
    """Draw the differences of the mean LS estimates in standard errors, all sets."""
    rows = study.rows(MEANS)
    kinds = study.summary.settings["kinematics"]
    names = list(dict.fromkeys(row.parameter for row in rows))
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
    _parameter_axis(axes, names, _BY_SET)
    axes.set_ylabel("Difference of means / standard error")
    figure.legend(loc="outside upper center", ncols=len(kinds))


@figure_definition(
    "study_bias",
    "Mean error of every parameter with three standard errors, in standard deviations that "
    "ML states for one undisturbed experiment (shaded: one of them). ML takes the Fourier series "
    "with the harmonics that the data show in all three cases.",
    height=6.4,
)
def bias_figure(figure: Figure, study: StudyRecord) -> None:
    """Draw mean errors with three standard errors, in the std that ML states undisturbed."""
    found: dict[tuple[str, str], list[EstimateRow]] = {}
    for row in study.rows(ESTIMATES):
        found.setdefault((row.case, row.estimator), []).append(row)
    reference = found[CASES[0].key, "ml"]
    names = [row.parameter for row in reference]
    unit = np.array([row.bias / row.bias_over_std for row in reference])
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
                label=estimator.upper(),
                **ESTIMATOR_LOOKS[estimator],
            )
        axes.axhspan(-1, 1, color=FAINT, alpha=0.3, linewidth=0, zorder=1)
        axes.axhline(0, color=INK, linewidth=0.8, zorder=2)
        curved = largest > _LARGEST_LINEAR_BIAS  # beyond that a linear axis shows nothing else
        if curved:
            axes.set_yscale("symlog", linthresh=2.0, linscale=0.9)
        limit = (2.2 if curved else 1.15) * largest
        axes.set_ylim(-limit, limit)
        axes.yaxis.set_major_formatter(plain_ticks())
        _parameter_axis(axes, names, "Parameter" if axes is panels[-1] else "")
        axes.set_title(f"{case.key}: {case.title}")
    panels[0].tick_params(labelbottom=False)
    figure.supylabel("Bias / standard deviation of one ML estimate", fontsize="medium")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)


def _shifts(count: int) -> Array:
    return np.linspace(-_WIDTH / 2, _WIDTH / 2, count) if count > 1 else np.zeros(1)


def _parameter_axis(axes: Axes, names: Sequence[str], label: str) -> None:
    """Label the axis with the parameters; a line parts rigid bodies from friction."""
    parameter_axis(axes, names, label, parted=True)
    rigid = np.count_nonzero(rigid_body(names))
    if 0 < rigid < len(names):
        axes.axvline(rigid - 0.5, color=MUTED, linewidth=0.9, zorder=1)


_REACH = 4.0
_POINTS = 400
_BINS = 16
_TITLES = {
    "without": "no cogging",
    "unknown": "unknown to the model",
    "known": "in the identification too",
}
_BAR = 0.38
_MOST = 0.5


@figure_definition(
    "study_distributions",
    "LS estimates of chosen parameters with both designs of the first set: histograms of "
    "the repetitions and the normal distributions with their means and standard deviations.",
    height=2.5,
)
def distributions_figure(figure: Figure, study: DesignStudy) -> None:
    """Draw histograms of the first set's LS estimates and the normal distributions fitted."""
    section = study.section
    kinematics = shown_kinematics(section.kinematics)
    pair = study.sets[0]
    names = study.robot.parameter_names
    shown = [name for name in section.shown if name in names]
    panels = figure.subplots(1, len(shown), squeeze=False)[0]
    for axes, name in zip(panels, shown, strict=True):
        k = names.index(name)
        samples = [trial.values[kinematics]["ls"][:, k] for trial in pair]
        spread = max(values.std(ddof=1) for values in samples)
        truth = float(study.truth[k])
        middle = 0.5 * (min(v.mean() for v in samples) + max(v.mean() for v in samples))
        grid = np.linspace(middle - _REACH * spread, middle + _REACH * spread, _POINTS)
        for trial, values, colour in zip(pair, samples, (BLUE, VERMILLION), strict=True):
            axes.hist(values, bins=_BINS, density=True, color=colour, alpha=0.22, linewidth=0)
            axes.plot(
                grid,
                scipy.stats.norm.pdf(grid, values.mean(), values.std(ddof=1)),
                color=colour,
                label=f"criterion '{trial.criterion}'",
            )
        axes.axvline(truth, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), label="truth")
        axes.set_yticks([])
        axes.set_ylim(bottom=0)
        axes.set_xlabel(f"{symbol(name)} ({parameter_unit(name)})")
    panels[0].set_ylabel("Density")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)


@figure_definition(
    "study_variances",
    "Variance of single samples about the prediction (coloured; red where the actuator "
    "fails the lack-of-fit test in most runs) beside the variance of the measurement's noise "
    "(grey), mean of all runs. Numbers: share of the runs in which the actuator fails.",
    height=1.0,
)
def variances_figure(figure: Figure, study: StudyRecord) -> None:
    """Draw mean variances of all runs; actuators that fail in most runs are marked."""
    rows = study.rows(VARIANCES)
    motions = list(dict.fromkeys(row.motion for row in rows))
    figure.set_figheight(1.2 + 1.7 * len(motions))
    panels = figure.subplots(len(motions), len(_TITLES), sharex=True, sharey=True, squeeze=False)
    places = np.arange(ACTUATORS)
    for row, motion in enumerate(motions):
        for column, (situation, title) in enumerate(_TITLES.items()):
            axes = panels[row][column]
            found = [one for one in rows if (one.situation, one.motion) == (situation, motion)]
            model = np.array([one.variance_model_error for one in found])
            noise = np.array([one.variance_measurement_error for one in found])
            fails = np.array([one.fails / one.runs for one in found])
            colours = [ALERT if share > _MOST else BLUE for share in fails]
            axes.bar(places - _BAR / 2, model, _BAR, color=colours, zorder=3)
            axes.bar(places + _BAR / 2, noise, _BAR, color=FAINT, zorder=3)
            for place, share, height in zip(places, fails, np.maximum(model, noise), strict=True):
                if share > 0:
                    axes.annotate(
                        f"{100 * share:.0f} %",
                        (place, height),
                        xytext=(0, 2),
                        textcoords="offset points",
                        ha="center",
                        fontsize="small",
                        color=MUTED,
                    )
            named_places(axes, [str(j + 1) for j in places])
            if row == 0:
                axes.set_title(title)
            if column == 0:
                axes.set_ylabel(f"{motion} (N²)")
    panels[-1][1].set_xlabel("Actuator")
    top = panels[0][0].get_ylim()[1]
    panels[0][0].set_ylim(0, 1.08 * top)


RECORD_FIGURES: dict[str, tuple[FigureDefinition[StudyRecord], ...]] = {
    "design": (precision_figure, means_figure),
    "identification": (bias_figure,),
    "validation": (variances_figure,),
}
"""What is drawn of a study's record, by its kind.

`distributions_figure` is drawn of the repetitions, of which no table holds each.
"""
