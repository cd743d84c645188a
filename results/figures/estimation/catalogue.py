"""The figures of an estimate and its diagnostics, in the order in which a report shows them."""

from __future__ import annotations

from estimation.diagnostics.noise_record import NoisePictures
from estimation.diagnostics.record import ExperimentRecord
from estimation.identification.record import EstimateRecord
from results.figures.definition import FigureDefinition
from results.figures.estimation import (
    correlation,
    estimates,
    noise_covariance,
    noise_distribution,
    noise_quantiles,
    position_periodic,
    residual_dependence,
    residuals_over_time,
)

NOISE_FIGURES: tuple[FigureDefinition[NoisePictures], ...] = (
    noise_distribution.FIGURE,
    noise_quantiles.FIGURE,
    noise_covariance.FIGURE,
)
"""What is shown of noise alone."""

DIAGNOSTIC_FIGURES: tuple[FigureDefinition[ExperimentRecord], ...] = (
    residuals_over_time.FIGURE,
    residual_dependence.FIGURE,
    position_periodic.FIGURE,
)
"""What is shown of the residuals, beside the noise."""

ESTIMATE_FIGURES: tuple[FigureDefinition[EstimateRecord], ...] = (
    estimates.FIGURE,
    correlation.FIGURE,
)
"""What is shown of the parameters."""

PREDICTION_FIGURE = residuals_over_time.PREDICTION
"""What is shown of the prediction of each motion of a validation."""
