"""The figures of a design, in the order in which a report shows them."""

from __future__ import annotations

from expdesign.experiment import DesignRecord
from results.figures.design import (
    convergence,
    eigenvalues,
    excitation,
    limits_used,
    path,
    precision,
)
from results.figures.drawing import FigureDefinition
from results.figures.struts import CARDAN_ANGLES, STRUTS

DESIGN_FIGURES: tuple[FigureDefinition[DesignRecord], ...] = (
    excitation.FIGURE,
    path.FIGURE,
    STRUTS,
    CARDAN_ANGLES,
    limits_used.FIGURE,
    precision.FIGURE,
    eigenvalues.FIGURE,
    convergence.FIGURE,
)
