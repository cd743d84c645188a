"""The figures of a Monte-Carlo study, in the order in which a report shows them."""

from __future__ import annotations

from results.figures.definition import FigureDefinition
from results.figures.montecarlo import bias, efficiency
from results.figures.montecarlo.series import Series

STUDY_FIGURES: tuple[FigureDefinition[Series], ...] = (bias.FIGURE, efficiency.FIGURE)
