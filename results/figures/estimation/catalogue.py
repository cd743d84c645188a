"""The figures of an estimate and its diagnostics, in the order in which a report shows them."""

from __future__ import annotations

from estimation.diagnostics import ExperimentDiagnosis
from estimation.diagnostics.noise_tests import NoiseTests
from estimation.identification import EstimationResult
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

NOISE_FIGURES: tuple[FigureDefinition[NoiseTests], ...] = (
    noise_distribution.FIGURE,
    noise_quantiles.FIGURE,
    noise_covariance.FIGURE,
)
"""What is shown of noise alone."""

DIAGNOSTIC_FIGURES: tuple[FigureDefinition[ExperimentDiagnosis], ...] = (
    residuals_over_time.FIGURE,
    residual_dependence.FIGURE,
    position_periodic.FIGURE,
    noise_distribution.FIGURE,
    noise_quantiles.FIGURE,
    noise_covariance.FIGURE,
)

ESTIMATE_FIGURES: tuple[FigureDefinition[EstimationResult], ...] = (
    estimates.FIGURE,
    correlation.FIGURE,
)
"""What is shown of the parameters."""
