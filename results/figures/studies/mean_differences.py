"""Whether two designs lead to the same mean estimates, by how the motion was measured."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter

from estimation.studies import DesignStudy
from results.figures.definition import FigureDefinition
from results.figures.studies.parameter_places import parameter_places
from results.style import BLUE, FAINT, GREEN, VERMILLION, new_figure

_CLEAR = 3.5
_COLOURS = {"exact": GREEN, "fourier": BLUE, "central": VERMILLION}
_TITLES = {
    "exact": "no noise of the lengths",
    "fourier": "Fourier differentiation",
    "central": "central differences",
}
_WIDTH = 0.5
_LINEAR_REACH = 25.0


def draw(study: DesignStudy) -> Figure:
    """Draw the differences of the mean LS estimates in standard errors, all sets."""
    kinds = study.section.kinematics
    names = study.robot.parameter_names
    figure = new_figure(3.0)
    axes = figure.subplots()
    shifts = np.linspace(-_WIDTH / 2, _WIDTH / 2, len(kinds)) if len(kinds) > 1 else [0.0]
    largest = 2 * _CLEAR
    for kinematics, shift in zip(kinds, shifts, strict=True):
        for number, pair in enumerate(study.sets):
            t = study.means(pair, kinematics, "ls").z
            largest = max(largest, float(np.max(np.abs(t))))
            label = None if number else _TITLES[kinematics]
            axes.scatter(
                np.arange(len(names)) + shift,
                t,
                s=11,
                color=_COLOURS[kinematics],
                linewidth=0,
                label=label,
                zorder=3,
            )
    axes.axhspan(-_CLEAR, _CLEAR, color=FAINT, alpha=0.35, linewidth=0, zorder=1)
    if largest > _LINEAR_REACH:
        axes.set_yscale("symlog", linthresh=2 * _CLEAR, linscale=1.0)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}".replace("-", "−")))
    room = 1.6 if largest > _LINEAR_REACH else 1.1
    axes.set_ylim(-room * largest, room * largest)
    parameter_places(axes, names)
    axes.set_xlabel("Parameter; one point for each set of initial parameters")
    axes.set_ylabel("Difference of means / standard error")
    figure.legend(loc="outside upper center", ncols=len(kinds))
    return figure


FIGURE = FigureDefinition(
    key="study_means",
    caption="Difference of the mean LS estimates of both designs in its standard errors. In the "
    "band, of 3.5 standard errors, it cannot be told from chance. Noise of the lengths that is "
    "differentiated point by point biases each design's estimates differently.",
    draw=draw,
)
