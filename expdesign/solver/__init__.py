"""Solving the design problem: Ipopt, continuation, many starts, and the finish."""

from expdesign.solver.initial import InfeasibleLimitsError
from expdesign.solver.jobs import DesignTask, SearchPlan
from expdesign.solver.search import NoDesignError, SearchResult, search
from expdesign.solver.stage import SearchEvent

__all__ = [
    "DesignTask",
    "InfeasibleLimitsError",
    "NoDesignError",
    "SearchEvent",
    "SearchPlan",
    "SearchResult",
    "search",
]
