"""Bias of LS, GM and ML with and without what disturbs the information matrix: Table III."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from estimation.studies import IdentificationStudy
from estimation.studies.identification_study import ESTIMATORS
from results.figures.definition import FigureDefinition
from results.figures.studies.parameter_places import parameter_places
from results.style import ESTIMATOR_LOOKS, FAINT, INK, new_figure

_SHIFT = {"ls": -0.25, "gm": 0.0, "ml": 0.25}
_ERRORS = 3.0


def draw(study: IdentificationStudy) -> Figure:
    """Draw mean errors with three standard errors, in the std that ML states undisturbed."""
    names = [study.knowledge.names[k] for k in np.flatnonzero(study.knowledge.free)]
    free = study.knowledge.free
    unit = study.cases[0].reported_std("ml")[free]
    figure = new_figure(6.4)
    panels = figure.subplots(len(study.cases), 1, sharex=True)
    for axes, result in zip(panels, study.cases, strict=True):
        largest = 1.0
        for name in ESTIMATORS:
            bias, error = result.bias(name)
            value, bar = bias[free] / unit, _ERRORS * error[free] / unit
            largest = max(largest, float(np.max(np.abs(value) + bar)))
            axes.errorbar(
                np.arange(len(names)) + _SHIFT[name],
                value,
                yerr=bar,
                **ESTIMATOR_LOOKS[name],
                linestyle="none",
                markersize=3.2,
                elinewidth=0.9,
                label=name.upper(),
                zorder=3,
            )
        axes.axhspan(-1, 1, color=FAINT, alpha=0.3, linewidth=0, zorder=1)
        axes.axhline(0, color=INK, linewidth=0.8, zorder=2)
        if largest > 10:  # noqa: PLR2004 - beyond that a linear axis shows nothing else
            axes.set_yscale("symlog", linthresh=2.0, linscale=0.9)
            axes.set_ylim(-2.2 * largest, 2.2 * largest)
        else:
            axes.set_ylim(-1.15 * largest, 1.15 * largest)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}".replace("-", "−")))
        parameter_places(axes, names)
        axes.set_title(f"{result.case.key}: {result.case.title}")
    panels[0].tick_params(labelbottom=False)
    panels[-1].set_xlabel("Parameter")
    figure.supylabel("Bias / standard deviation of one ML estimate", fontsize="medium")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3)
    return figure


FIGURE = FigureDefinition(
    key="study_bias",
    caption="Mean error of every parameter with three standard errors, in standard deviations that "
    "ML states for one undisturbed experiment (shaded: one of them). ML takes the Fourier series "
    "with the harmonics that the data show in all three cases.",
    draw=draw,
)
