"""How much better one design knows every parameter than the other, set by set."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from estimation.studies import DesignStudy
from results.figures.definition import FigureDefinition
from results.figures.studies.parameter_places import parameter_places
from results.style import BLUE, INK, VERMILLION, new_figure

_WIDTH = 0.5


def draw(study: DesignStudy) -> Figure:
    """Draw achieved standard deviations of LS, second criterion over first."""
    section = study.section
    kinematics = "fourier" if "fourier" in section.kinematics else section.kinematics[0]
    names = study.robot.parameter_names
    figure = new_figure(3.0)
    axes = figure.subplots()
    shifts = np.linspace(-_WIDTH / 2, _WIDTH / 2, len(study.sets)) if len(study.sets) > 1 else [0.0]
    for pair, shift in zip(study.sets, shifts, strict=True):
        first, second = (t.values[kinematics]["ls"].std(axis=0, ddof=1) for t in pair)
        ratio = second / first
        colours = [BLUE if value > 1 else VERMILLION for value in ratio]
        axes.scatter(np.arange(len(names)) + shift, ratio, s=11, c=colours, linewidth=0, zorder=3)
    axes.axhline(1.0, color=INK, linewidth=0.9, zorder=2)
    axes.set_yscale("log")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
    parameter_places(axes, names)
    axes.set_xlabel("Parameter; one point for each set of initial parameters")
    first_name, second_name = section.criteria
    axes.set_ylabel(f"Std with '{second_name}' / std with '{first_name}'")
    axes.set_title(f"Above the line '{first_name}' knows the parameter better")
    return figure


FIGURE = FigureDefinition(
    key="study_precision",
    caption="Achieved standard deviations of the LS estimates, second criterion over first, for "
    "every set of initial parameters. Left of the line the rigid bodies, right of it friction.",
    draw=draw,
)
