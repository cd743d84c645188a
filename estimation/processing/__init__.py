"""From a recording to what the estimators work on: periods, means over periods, noise."""

from estimation.processing.noise import NoiseEstimate, NoiseModel
from estimation.processing.period import PeriodError, PeriodSource
from estimation.processing.record import Channels, Record, make_record

__all__ = [
    "Channels",
    "NoiseEstimate",
    "NoiseModel",
    "PeriodError",
    "PeriodSource",
    "Record",
    "make_record",
]
