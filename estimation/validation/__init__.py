"""Prediction of motions that were not used for the estimate."""

from estimation.identification.saved import SavedEstimate, read_estimate
from estimation.validation.motions import benchmark_motion
from estimation.validation.validate import validate

__all__ = [
    "SavedEstimate",
    "benchmark_motion",
    "read_estimate",
    "validate",
]
