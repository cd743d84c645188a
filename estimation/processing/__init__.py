"""Processing of recordings for the estimators: periods, means over periods, noise."""

from estimation.processing.noise import NoiseEstimate, NoiseModel
from estimation.processing.period import PeriodError, PeriodSource
from estimation.processing.periodic_recording import (
    Channels,
    PeriodicRecording,
    fold_recording,
    single_recording,
)

__all__ = [
    "Channels",
    "NoiseEstimate",
    "NoiseModel",
    "PeriodError",
    "PeriodSource",
    "PeriodicRecording",
    "fold_recording",
    "single_recording",
]
