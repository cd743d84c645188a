"""Variance of the model's error against that of the measurement's, actuator by actuator."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from estimation.studies import StudyRecord
from estimation.studies.records import VARIANCES
from expdesign.mechanism.hexapod import ACTUATORS
from results.figures.definition import FigureDefinition
from results.style import ALERT, BLUE, FAINT, MUTED, new_figure

_TITLES = {
    "without": "no cogging",
    "unknown": "unknown to the model",
    "known": "in the identification too",
}
_WIDTH = 0.38
_MOST = 0.5


def draw(study: StudyRecord) -> Figure:
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
                axes.set_title(title)
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
