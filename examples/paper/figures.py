"""Figures of the three studies, each drawn from the tables of its study."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import scipy

from constraints.arrays import Array
from examples.paper.designs import CRITERIA, KINEMATICS, ls_rows, rigid_body
from examples.paper.identification import CASES, ESTIMATORS
from examples.paper.validation import MOST, SITUATIONS, motion_rows
from expdesign.mechanism.hexapod import ACTUATORS
from results.figures.drawing import (
    ALERT,
    BLUE,
    ESTIMATOR_LOOKS,
    FAINT,
    GREEN,
    INK,
    MUTED,
    VERMILLION,
    FigureDefinition,
    figure_definition,
    label_decades,
    name_places,
    plain_ticks,
    set_parameter_axis,
)
from results.notation import symbol

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_BAND = 3.5
_LINEAR_REACH = 25.0
_SHIFT = {"ls": -0.25, "gm": 0.0, "ml": 0.25}
_ERRORS = 3.0
_LARGEST_LINEAR_BIAS = 10.0
_BAR = 0.38
_TITLES = {
    "without": "no cogging",
    "unknown": "unknown to the model",
    "known": "in the identification too",
}
"""Of the situations of the validation, short."""


@figure_definition(
    "distributions",
    "LS estimates of some parameters with both designs of the first set: histograms of the "
    "repetitions, and normal distributions with their means and standard deviations.",
    height=2.5,
)
def distributions_figure(figure: Figure, table: pd.DataFrame) -> None:
    """Draw histograms of LS estimates and the normal distributions fitted to them."""
    groups = table.groupby("parameter", sort=False)
    panels = figure.subplots(1, len(groups), squeeze=False)[0]
    for axes, (name, found) in zip(panels, groups, strict=True):
        samples = [found[found["criterion"] == one]["value"] for one in CRITERIA]
        spread = max(values.std() for values in samples)
        middle = 0.5 * (min(v.mean() for v in samples) + max(v.mean() for v in samples))
        grid = np.linspace(middle - 4 * spread, middle + 4 * spread, 400)
        for criterion, values, colour in zip(CRITERIA, samples, (BLUE, VERMILLION), strict=True):
            axes.hist(values, bins=16, density=True, color=colour, alpha=0.22, linewidth=0)
            density = scipy.stats.norm.pdf(grid, values.mean(), values.std())
            axes.plot(grid, density, color=colour, label=f"criterion '{criterion}'")
        truth, unit = found[["truth", "unit"]].iloc[0]
        axes.axvline(truth, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), label="truth")
        axes.set_yticks([])
        axes.set_ylim(bottom=0)
        axes.set_xlabel(f"{symbol(name)} ({unit})")
    panels[0].set_ylabel("Density")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)


@figure_definition(
    "precision",
    "Achieved standard deviations of the LS estimates, second criterion over first, for every set "
    "of initial parameters. Left of the line are the rigid bodies, right of it is friction.",
    height=3.0,
)
def precision_figure(figure: Figure, table: pd.DataFrame) -> None:
    """Draw achieved standard deviations of LS, second criterion over first."""
    first, second = CRITERIA
    found = ls_rows(table, "fourier")
    names = list(found["parameter"].unique())
    std = {
        name: found[found["criterion"] == name]["std"].to_numpy().reshape(-1, len(names))
        for name in CRITERIA
    }
    ratios = std[second] / std[first]
    axes = figure.subplots()
    for shift, ratio in zip(_shifts(len(ratios)), ratios, strict=True):
        colours = [BLUE if value > 1 else VERMILLION for value in ratio]
        places = np.arange(len(names)) + shift
        axes.scatter(places, ratio, s=11, c=colours, linewidth=0, zorder=3)
    axes.axhline(1.0, color=INK, linewidth=0.9, zorder=2)
    axes.set_yscale("log")
    label_decades(axes.yaxis)
    _name_parameters(axes, names)
    axes.set_ylabel(f"Std with '{second}' / std with '{first}'")
    axes.set_title(f"Above the line '{first}' is more precise")


@figure_definition(
    "means",
    "Difference of the mean LS estimates of both designs in its standard errors. Within the band, "
    "of 3.5 standard errors, it may be chance. Noise of the lengths that is differentiated point "
    "by point biases each design's estimates differently.",
    height=3.0,
)
def means_figure(figure: Figure, table: pd.DataFrame) -> None:
    """Draw the differences of the mean LS estimates in standard errors, all sets."""
    names = list(table["parameter"].unique())
    axes = figure.subplots()
    looks = zip(KINEMATICS, (GREEN, BLUE, VERMILLION), _shifts(len(KINEMATICS)), strict=True)
    for kinematics, colour, shift in looks:
        t = table[table["kinematics"] == kinematics]["t"]
        places = np.arange(len(t)) % len(names) + shift  # all parameters of a set, set by set
        label = KINEMATICS[kinematics].removeprefix("with noise of the lengths, ")
        axes.scatter(places, t, s=11, color=colour, linewidth=0, label=label, zorder=3)
    largest = max(2 * _BAND, table["t"].abs().max())
    axes.axhspan(-_BAND, _BAND, color=FAINT, alpha=0.35, linewidth=0, zorder=1)
    if largest > _LINEAR_REACH:
        axes.set_yscale("symlog", linthresh=2 * _BAND, linscale=1.0)
    axes.yaxis.set_major_formatter(plain_ticks())
    room = 1.6 if largest > _LINEAR_REACH else 1.1
    axes.set_ylim(-room * largest, room * largest)
    _name_parameters(axes, names)
    axes.set_ylabel("Difference of means / standard error")
    figure.legend(loc="outside upper center", ncols=len(KINEMATICS))


def _shifts(count: int) -> Array:
    return np.linspace(-0.25, 0.25, count) if count > 1 else np.zeros(1)


def _name_parameters(axes: Axes, names: Sequence[str]) -> None:
    """Label the axis with the parameters; a line separates rigid bodies from friction."""
    label = "Parameter; one point for each set of initial parameters"
    set_parameter_axis(axes, names, label, parted=True)
    rigid = np.count_nonzero(rigid_body(names))
    if 0 < rigid < len(names):
        axes.axvline(rigid - 0.5, color=MUTED, linewidth=0.9, zorder=1)


@figure_definition(
    "estimates",
    "Mean error of every parameter with three standard errors, in standard deviations that ML "
    "states for one undisturbed experiment (shaded: one of them). ML takes the Fourier series with "
    "the harmonics that the data show in all three cases.",
    height=6.4,
)
def bias_figure(figure: Figure, table: pd.DataFrame) -> None:
    """Draw mean errors with three standard errors, in the std that ML states undisturbed."""
    by_case = table.groupby(["case", "estimator"], sort=False)
    reference = by_case.get_group((CASES[0].key, "ml"))
    names = list(reference["parameter"])
    unit = (reference["bias"] / reference["bias_over_std"]).to_numpy()
    panels = figure.subplots(len(CASES), 1, sharex=True)
    for axes, case in zip(panels, CASES, strict=True):
        largest = 1.0
        for estimator in ESTIMATORS:
            found = by_case.get_group((case.key, estimator))
            value = found["bias"].to_numpy() / unit
            bar = _ERRORS * found["bias_std_error"].to_numpy() / unit
            largest = max(largest, float(np.max(np.abs(value) + bar)))
            places = np.arange(len(names)) + _SHIFT[estimator]
            look = ESTIMATOR_LOOKS[estimator]
            axes.errorbar(places, value, yerr=bar, label=estimator.upper(), **look)
        axes.axhspan(-1, 1, color=FAINT, alpha=0.3, linewidth=0, zorder=1)
        axes.axhline(0, color=INK, linewidth=0.8, zorder=2)
        curved = largest > _LARGEST_LINEAR_BIAS  # on a linear axis nothing else would be visible
        if curved:
            axes.set_yscale("symlog", linthresh=2.0, linscale=0.9)
        limit = (2.2 if curved else 1.15) * largest
        axes.set_ylim(-limit, limit)
        axes.yaxis.set_major_formatter(plain_ticks())
        set_parameter_axis(axes, names, "Parameter" if axes is panels[-1] else "", parted=True)
        axes.set_title(f"{case.key}: {case.title}")
    panels[0].tick_params(labelbottom=False)
    figure.supylabel("Bias / standard deviation of one ML estimate", fontsize="medium")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=3)


@figure_definition(
    "variances",
    "Variance of single samples about the prediction (coloured; red where the actuator fails the "
    "lack-of-fit test in most runs) and variance of the measurement's noise (grey), mean of all "
    "runs. Numbers: share of the runs in which the actuator fails.",
    height=4.6,
)
def variances_figure(figure: Figure, table: pd.DataFrame) -> None:
    """Draw mean variances of all runs; actuators that fail in most runs are marked."""
    motions = list(table["motion"].unique())
    panels = figure.subplots(len(motions), len(SITUATIONS), sharex=True, sharey=True, squeeze=False)
    places = np.arange(ACTUATORS)
    for (row, motion), (column, situation) in product(enumerate(motions), enumerate(SITUATIONS)):
        axes, found = panels[row][column], motion_rows(table, situation, motion)
        model = found["variance_model_error"].to_numpy()
        noise = found["variance_measurement_error"].to_numpy()
        fails = (found["fails"] / found["runs"]).to_numpy()
        colours = [ALERT if share > MOST else BLUE for share in fails]
        axes.bar(places - _BAR / 2, model, _BAR, color=colours, zorder=3)
        axes.bar(places + _BAR / 2, noise, _BAR, color=FAINT, zorder=3)
        for place in np.flatnonzero(fails):
            axes.annotate(
                f"{100 * fails[place]:.0f} %",
                (place, max(model[place], noise[place])),
                xytext=(0, 2),
                textcoords="offset points",
                ha="center",
                fontsize="small",
                color=MUTED,
            )
        name_places(axes, [str(j + 1) for j in places])
        if row == 0:
            axes.set_title(_TITLES[situation])
        if column == 0:
            axes.set_ylabel(f"{motion} (N²)")
    panels[-1][1].set_xlabel("Actuator")
    panels[0][0].set_ylim(0, 1.08 * panels[0][0].get_ylim()[1])


FIGURES: dict[str, FigureDefinition[pd.DataFrame]] = {
    figure.key: figure
    for figure in (
        distributions_figure,
        precision_figure,
        means_figure,
        bias_figure,
        variances_figure,
    )
}
"""By the name of the table that each is drawn from."""
