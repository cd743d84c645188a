"""The figures of each kind of study: those of every parameter, and the two of this file."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from estimation.studies import DesignStudy, StudyRecord
from estimation.studies.design_study import shown_kinematics
from estimation.studies.records import VARIANCES
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.mechanism.hexapod import ACTUATORS
from results.figures.drawing import FigureDefinition
from results.figures.studies.by_parameter import BIAS_FIGURE, MEANS_FIGURE, PRECISION_FIGURE
from results.style import ALERT, BLUE, FAINT, INK, MUTED, VERMILLION, new_figure
from results.symbols import symbol

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


def draw_distributions(study: DesignStudy) -> Figure:
    """Draw histograms of the first set's LS estimates and the normal distributions fitted."""
    section = study.section
    kinematics = shown_kinematics(section.kinematics)
    pair = study.sets[0]
    names = study.robot.parameter_names
    shown = [name for name in section.shown if name in names]
    figure = new_figure(2.5)
    panels = figure.subplots(1, len(shown), squeeze=False)[0]
    for axes, name in zip(panels, shown, strict=True):
        k = names.index(name)
        samples = [trial.values[kinematics]["ls"][:, k] for trial in pair]
        spread = max(values.std(ddof=1) for values in samples)
        truth = float(study.robot.parameters[k])
        middle = 0.5 * (min(v.mean() for v in samples) + max(v.mean() for v in samples))
        grid = np.linspace(middle - _REACH * spread, middle + _REACH * spread, _POINTS)
        for trial, values, colour in zip(pair, samples, (BLUE, VERMILLION), strict=True):
            axes.hist(values, bins=_BINS, density=True, color=colour, alpha=0.22, linewidth=0)
            axes.plot(
                grid,
                stats.norm.pdf(grid, values.mean(), values.std(ddof=1)),
                color=colour,
                label=f"criterion '{trial.criterion}'",
            )
        axes.axvline(truth, color=INK, linewidth=0.9, linestyle=(0, (4, 2)), label="truth")
        axes.set_yticks([])
        axes.set_ylim(bottom=0)
        axes.set_xlabel(f"{symbol(name)} ({parameter_unit(name)})")
    panels[0].set_ylabel("Density")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


def draw_variances(study: StudyRecord) -> Figure:
    """Draw mean variances of all runs; actuators that fail in most runs are marked."""
    rows = study.rows(VARIANCES)
    motions = list(dict.fromkeys(row.motion for row in rows))
    figure = new_figure(1.2 + 1.7 * len(motions))
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
            axes.set_xticks(places, [str(j + 1) for j in places])
            axes.tick_params(axis="x", length=0)
            axes.grid(visible=False, axis="x")
            if row == 0:
                axes.set_title(title)
            if column == 0:
                axes.set_ylabel(f"{motion} (N²)")
    panels[-1][1].set_xlabel("Actuator")
    top = panels[0][0].get_ylim()[1]
    panels[0][0].set_ylim(0, 1.08 * top)
    return figure


VARIANCES_FIGURE = FigureDefinition(
    key="study_variances",
    caption="Variance of single samples about the prediction (coloured; red where the actuator "
    "fails the lack-of-fit test in most runs) beside the variance of the measurement's noise "
    "(grey), mean of all runs. Numbers: share of the runs in which the actuator fails.",
    draw=draw_variances,
)
RECORD_FIGURES: dict[str, tuple[FigureDefinition[StudyRecord], ...]] = {
    "design": (PRECISION_FIGURE, MEANS_FIGURE),
    "identification": (BIAS_FIGURE,),
    "validation": (VARIANCES_FIGURE,),
}
"""What is drawn of a study's record, by its kind."""

REPETITIONS_FIGURE = FigureDefinition(
    key="study_distributions",
    caption="LS estimates of chosen parameters with both designs of the first set: histograms of "
    "the repetitions and the normal distributions with their means and standard deviations.",
    draw=draw_distributions,
)
"""What is drawn of the repetitions of a study of designs, of which no table holds each."""
