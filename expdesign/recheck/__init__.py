"""Checks of a trajectory that share nothing with the optimiser but the graph."""

from expdesign.recheck.information import Judge
from expdesign.recheck.limit_check import TOLERANCE, LimitCheck
from expdesign.recheck.recheck import (
    Motion,
    Recheck,
    check_limits,
    grid_points,
    recheck,
    states_at,
)

__all__ = [
    "TOLERANCE",
    "Judge",
    "LimitCheck",
    "Motion",
    "Recheck",
    "check_limits",
    "grid_points",
    "recheck",
    "states_at",
]
