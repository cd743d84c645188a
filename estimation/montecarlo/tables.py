"""The columns of the study's tables."""

from __future__ import annotations

from collections.abc import Iterable

from expdesign.runfolder.described import Column

_INTERVAL = "of the 95 % interval"

STATISTICS = (
    Column("estimator", "", "ls, gm or ml"),
    Column("parameter", "", "name"),
    Column("unit", "", "SI unit of the columns that refer to it"),
    Column("truth", "see unit", "true value"),
    Column("identified", "", "bound below half the parameter's scale"),
    Column("estimates", "1", "repetitions in which the estimator came to an estimate"),
    Column("bias", "see unit", "mean error"),
    Column("bias_std_error", "see unit", "standard error of the bias"),
    Column("bias_t", "1", "bias in standard errors"),
    Column("spread", "see unit", "standard deviation of the estimates"),
    Column("rmse", "see unit", "root mean square of the errors"),
    Column("bound", "see unit", "Cramér–Rao bound at the truth, as a standard deviation"),
    Column("reported_std", "see unit", "root mean square of the standard deviations stated"),
    Column("reported_over_spread", "1", "the stated over the true standard deviation"),
    Column("rmse_over_bound", "1", "1 for an estimator that cannot be improved"),
    Column("rmse_over_bound_low", "1", f"lower end {_INTERVAL}"),
    Column("rmse_over_bound_high", "1", f"upper end {_INTERVAL}"),
    Column("coverage", "1", "share of the stated 95 % intervals that hold the truth"),
    Column("coverage_low", "1", f"lower end {_INTERVAL}"),
    Column("coverage_high", "1", f"upper end {_INTERVAL}"),
    Column("largest_error", "1", "in any repetition, in units of the RMSE"),
)
"""Columns of `tables/montecarlo.csv`."""


def repetition_columns(parameters: Iterable[str]) -> tuple[Column, ...]:
    """Return the columns of `tables/montecarlo_repetitions.csv`."""
    names = tuple(parameters)
    return (
        Column("repetition", "1", "number, from 1"),
        Column("estimator", "", "ls, gm or ml"),
        Column("failure", "", "why there is no estimate; empty when there is one"),
        Column("converged", "", "whether the iteration ended as it should"),
        Column("iterations", "1", "of the estimator"),
        Column("harmonics", "1", "of the fitted motion; empty after pointwise differentiation"),
        Column("freedom", "1", "degrees of freedom of the noise covariance; inf when given"),
        *(Column(name, "SI", f"estimate of {name}") for name in names),
        *(Column(f"std_{name}", "SI", f"stated standard deviation of {name}") for name in names),
    )
