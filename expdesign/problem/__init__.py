"""The design as a nonlinear program: stated here, solved elsewhere."""

from expdesign.problem.design_problem import DesignProblem, DesignProgram, build_problem
from expdesign.problem.program import LimitedProgram, hidden_by_smoothing
from expdesign.problem.variables import DesignVariables, coordinate_reach

__all__ = [
    "DesignProblem",
    "DesignProgram",
    "DesignVariables",
    "LimitedProgram",
    "build_problem",
    "coordinate_reach",
    "hidden_by_smoothing",
]
