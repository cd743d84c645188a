"""The figures of a Monte-Carlo study, in the order in which a report shows them."""

from __future__ import annotations

from results.figures.definition import FigureDefinition
from results.figures.montecarlo import bias, efficiency
from results.study_record import StudyRecord

STUDY_FIGURES: tuple[FigureDefinition[StudyRecord], ...] = (bias.FIGURE, efficiency.FIGURE)
