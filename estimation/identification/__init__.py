"""The whole way from measurements to parameters: `estimate`, its result and its files."""

from estimation.identification.estimate import estimate, prepare_experiment, run_estimators
from estimation.identification.result import EstimationResult, RecordSummary

__all__ = [
    "EstimationResult",
    "RecordSummary",
    "estimate",
    "prepare_experiment",
    "run_estimators",
]
