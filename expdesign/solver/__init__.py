"""Solving the design problem: Ipopt, continuation, many starts, and the finish."""

from expdesign.solver.feasibility import InfeasibleLimitsError
from expdesign.solver.search import NoDesignError

__all__ = ["InfeasibleLimitsError", "NoDesignError"]
