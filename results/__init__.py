"""What is shown of a run: tables, figures and reports. Computes nothing that a run decides."""

from results.comparison_study import comparison_study_figures
from results.design import design_figures
from results.estimation import (
    estimate_figures,
    noise_figures,
    study_figures,
    validation_figures,
)

__all__ = [
    "comparison_study_figures",
    "design_figures",
    "estimate_figures",
    "noise_figures",
    "study_figures",
    "validation_figures",
]
