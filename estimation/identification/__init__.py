"""Identification: from recordings to parameters with their uncertainty and a diagnosis."""

from estimation.identification.estimate import estimate, estimation_result
from estimation.identification.estimation import Estimation, estimate_parameters, run_estimators
from estimation.identification.recording import PreparedRecording, prepare_experiment
from estimation.identification.result import EstimationResult

__all__ = [
    "Estimation",
    "EstimationResult",
    "PreparedRecording",
    "estimate",
    "estimate_parameters",
    "estimation_result",
    "prepare_experiment",
    "run_estimators",
]
