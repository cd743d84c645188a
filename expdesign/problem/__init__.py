"""The design as a nonlinear program: stated here, solved elsewhere."""

from expdesign.problem.design_problem import DesignProblem, build_problem

__all__ = ["DesignProblem", "build_problem"]
