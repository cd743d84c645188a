"""The design as a nonlinear program: stated here, solved elsewhere."""

from expdesign.problem.design_problem import (
    DesignProblem,
    DesignProgram,
    LimitedProgram,
    build_problem,
    hidden_by_smoothing,
)
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
