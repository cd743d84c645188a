"""The design as a nonlinear program: stated here, solved elsewhere."""

from expdesign.problem.design_problem import DesignProblem, DesignProgram, build_problem
from expdesign.problem.limit_rows import LimitRows
from expdesign.problem.variables import DesignVariables

__all__ = ["DesignProblem", "DesignProgram", "DesignVariables", "LimitRows", "build_problem"]
