"""The whole way from measurements to parameters: `estimate`, its result and its files."""

from estimation.identification.estimate import estimate, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.identification.result import EstimationResult, PreparedRecording

__all__ = [
    "EstimationResult",
    "PreparedRecording",
    "estimate",
    "prepare_experiment",
    "run_estimators",
]
