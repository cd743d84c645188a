"""How sure one may be: intervals, what is identified, and the bound that no estimator beats."""

from estimation.uncertainty.differences import Differences, difference_test
from estimation.uncertainty.intervals import (
    Combination,
    ParameterRow,
    correlation,
    identified_combinations,
    interval_width,
    parameter_rows,
)

__all__ = [
    "Combination",
    "Differences",
    "ParameterRow",
    "correlation",
    "difference_test",
    "identified_combinations",
    "interval_width",
    "parameter_rows",
]
