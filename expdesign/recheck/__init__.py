"""Checks of a motion that share nothing with the optimiser but the graph."""

from expdesign.recheck.information import Evaluator
from expdesign.recheck.judge import (
    TOLERANCE,
    LimitCheck,
    Motion,
    Recheck,
    grid_points,
    judge,
    local_worst,
    recheck,
    states_at,
    worst_of_each,
)

__all__ = [
    "TOLERANCE",
    "Evaluator",
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
