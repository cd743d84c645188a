"""The figures of each kind of comparison."""

from __future__ import annotations

from results.figures.studies import (
    design_precision,
    distributions,
    identification_bias,
    mean_differences,
    model_error,
)

DESIGN_STUDY_FIGURES = (distributions.FIGURE, design_precision.FIGURE, mean_differences.FIGURE)
IDENTIFICATION_STUDY_FIGURES = (identification_bias.FIGURE,)
VALIDATION_STUDY_FIGURES = (model_error.FIGURE,)
