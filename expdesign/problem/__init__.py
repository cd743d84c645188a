"""The design as a nonlinear program: variables, objective and rows of limits."""
