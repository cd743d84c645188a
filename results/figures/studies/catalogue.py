"""The figures of each kind of study."""

from __future__ import annotations

from estimation.studies import StudyRecord
from results.figures.definition import FigureDefinition
from results.figures.studies import by_parameter, distributions, model_error

RECORD_FIGURES: dict[str, tuple[FigureDefinition[StudyRecord], ...]] = {
    "design": (by_parameter.PRECISION_FIGURE, by_parameter.MEANS_FIGURE),
    "identification": (by_parameter.BIAS_FIGURE,),
    "validation": (model_error.FIGURE,),
}
"""What is drawn of a study's record, by its kind."""

REPETITIONS_FIGURE = distributions.FIGURE
"""What is drawn of the repetitions of a study of designs, of which no table holds each."""
