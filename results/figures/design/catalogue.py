"""The figures of a design, in the order in which a report shows them."""

from __future__ import annotations

from results.figures.definition import FigureDefinition
from results.figures.design import (
    cardan_angles,
    convergence,
    eigenvalues,
    excitation,
    limits_used,
    path,
    precision,
    struts,
)
from results.record import DesignRecord

DESIGN_FIGURES: tuple[FigureDefinition[DesignRecord], ...] = (
    excitation.FIGURE,
    path.FIGURE,
    struts.FIGURE,
    cardan_angles.FIGURE,
    limits_used.FIGURE,
    precision.FIGURE,
    eigenvalues.FIGURE,
    convergence.FIGURE,
)
