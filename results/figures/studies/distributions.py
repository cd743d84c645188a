"""Estimates of chosen parameters with two designs, as normal distributions: the paper's Fig. 6."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

from estimation.studies import DesignStudy
from estimation.studies.design_study import shown_kinematics
from expdesign.mechanism.catalogue import parameter_unit
from results.figures.definition import FigureDefinition
from results.style import BLUE, INK, VERMILLION, new_figure
from results.symbols import symbol

_REACH = 4.0
_POINTS = 400
_BINS = 16


def draw(study: DesignStudy) -> Figure:
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


FIGURE = FigureDefinition(
    key="study_distributions",
    caption="LS estimates of chosen parameters with both designs of the first set: histograms of "
    "the repetitions and the normal distributions with their means and standard deviations.",
    draw=draw,
)
