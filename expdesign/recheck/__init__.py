"""Checks of a motion that share nothing with the optimiser but the graph."""

from expdesign.recheck.information import Judge
from expdesign.recheck.judge import (
    Motion,
    Recheck,
    grid_points,
    judge,
    local_worst,
    recheck,
    states_at,
    worst_of_each,
)
from expdesign.recheck.limit_check import TOLERANCE, LimitCheck

__all__ = [
    "TOLERANCE",
    "Judge",
    "LimitCheck",
    "Motion",
    "Recheck",
    "grid_points",
    "judge",
    "local_worst",
    "recheck",
    "states_at",
    "worst_of_each",
]
