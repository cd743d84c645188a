"""Variance of the model's error against that of the measurement's, actuator by actuator."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from estimation.studies import ValidationStudy
from estimation.studies.validation_study import SITUATIONS
from results.figures.definition import FigureDefinition
from results.style import ALERT, BLUE, FAINT, MUTED, new_figure

_TITLES = {
    "without": "no cogging",
    "unknown": "unknown to the model",
    "known": "in the identification too",
}
_WIDTH = 0.38


def draw(study: ValidationStudy) -> Figure:
    """Draw mean variances of all runs; actuators that fail in most runs are marked."""
    figure = new_figure(1.2 + 1.7 * len(study.motions))
    panels = figure.subplots(
        len(study.motions), len(SITUATIONS), sharex=True, sharey=True, squeeze=False
    )
    places = np.arange(6)
    for row, motion in enumerate(study.motions):
        for column, situation in enumerate(SITUATIONS):
            axes = panels[row][column]
            found = [run.situations[situation][row] for run in study.runs]
            model = np.mean([one.variance_model_error for one in found], axis=0)
            noise = np.mean([one.variance_measurement_error for one in found], axis=0)
            fails = np.mean([one.failed for one in found], axis=0)
            colours = [ALERT if share > 0.5 else BLUE for share in fails]  # noqa: PLR2004
            axes.bar(places - _WIDTH / 2, model, _WIDTH, color=colours, zorder=3)
            axes.bar(places + _WIDTH / 2, noise, _WIDTH, color=FAINT, zorder=3)
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
                axes.set_title(_TITLES[situation])
            if column == 0:
                axes.set_ylabel(f"{motion} (N²)")
    panels[-1][1].set_xlabel("Actuator")
    top = panels[0][0].get_ylim()[1]
    panels[0][0].set_ylim(0, 1.08 * top)
    return figure


FIGURE = FigureDefinition(
    key="study_variances",
    caption="Variance of single samples about the prediction (coloured; red where the actuator "
    "fails the lack-of-fit test in most runs) beside the variance of the measurement's noise "
    "(grey), mean of all runs. Numbers: share of the runs in which the actuator fails.",
    draw=draw,
)
