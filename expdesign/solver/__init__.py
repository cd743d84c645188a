"""Solving the design problem: Ipopt, continuation, many starts, and the finish."""

from expdesign.solver.jobs import SearchPlan, Workshop
from expdesign.solver.pool import WorkerDiedError
from expdesign.solver.progress import Monitor, SearchEvent, SilentMonitor
from expdesign.solver.random_start import InfeasibleLimitsError
from expdesign.solver.search import NoDesignError, SearchResult, search

__all__ = [
    "InfeasibleLimitsError",
    "Monitor",
    "NoDesignError",
    "SearchEvent",
    "SearchPlan",
    "SearchResult",
    "SilentMonitor",
    "WorkerDiedError",
    "Workshop",
    "search",
]
