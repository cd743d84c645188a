"""The whole way from measurements to parameters: `estimate`, its result and its files."""

from estimation.identification.estimate import estimate, run_estimators
from estimation.identification.recording import prepare_experiment
from estimation.identification.result import EstimationResult, RecordSummary

__all__ = [
    "EstimationResult",
    "RecordSummary",
    "estimate",
    "prepare_experiment",
    "run_estimators",
]
