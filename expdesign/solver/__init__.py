"""Solving the design problem: Ipopt, continuation, many starts, and the finish."""

from expdesign.solver.jobs import SearchPlan, Workshop
from expdesign.solver.progress import SearchEvent
from expdesign.solver.random_start import InfeasibleLimitsError
from expdesign.solver.search import NoDesignError, SearchResult, search

__all__ = [
    "InfeasibleLimitsError",
    "NoDesignError",
    "SearchEvent",
    "SearchPlan",
    "SearchResult",
    "Workshop",
    "search",
]
