"""The result of a Monte-Carlo study: bias, spread, RMSE and coverage against truth and bound.

K repetitions are independent of each other; the parameters of one repetition are not. Statistics
over several parameters are therefore first averaged within each repetition, and their uncertainty
comes from the scatter of these averages between repetitions.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import scipy
from pydantic import ConfigDict

from constraints.arrays import Array
from estimation.uncertainty.intervals import LEVEL
from expdesign.configuration import Problem
from expdesign.runfolder import (
    Column,
    CsvFile,
    Numbers,
    OpenNumber,
    Place,
    RunFile,
    StageResult,
    Table,
    UnboundedNumber,
    described,
)
from expdesign.runfolder.fields import unknown_names, wrong_covariance

_LOW, _HIGH = "lower end of its 95 % interval", "upper end of its 95 % interval"


@dataclass(frozen=True, eq=False)
class RepetitionEstimate:
    """Estimate of one estimator in one repetition."""

    values: Annotated[Numbers | None, described("SI", "(m,) estimates; null when it failed")] = None
    std: Annotated[Numbers | None, described("SI", "(m,) as stated; null when it failed")] = None
    widths: Annotated[
        Numbers | None, described("1", "(m,) half widths of the 95 % intervals, in std")
    ] = None
    converged: Annotated[bool, described("", "the iteration ended as it should")] = False
    iterations: Annotated[int, described("1", "number of iterations")] = 0
    error: Annotated[str, described("", "why it failed; empty when it did not")] = ""


@dataclass(frozen=True, eq=False)
class Repetition:
    """Estimates of one repetition: a line of the journal."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    number: Annotated[int, described("1", "from 1")]
    harmonics: Annotated[
        int | None, described("1", "of the motion that ML estimates; null where there is none")
    ]
    freedom: Annotated[
        UnboundedNumber,
        described("1", "degrees of freedom behind the noise covariance; null when given"),
    ]
    outcomes: Annotated[dict[str, RepetitionEstimate], described("", "by estimator")]


@dataclass(frozen=True)
class PooledStatistics:
    """Several parameters of one estimator together."""

    rmse_over_bound: Annotated[OpenNumber, described("1", "root mean square over the parameters")]
    rmse_over_bound_std_error: Annotated[OpenNumber, described("1", "its standard error")]
    rmse_over_bound_low: Annotated[OpenNumber, described("1", _LOW)]
    rmse_over_bound_high: Annotated[OpenNumber, described("1", _HIGH)]
    coverage: Annotated[OpenNumber, described("1", "mean over the parameters")]
    coverage_std_error: Annotated[OpenNumber, described("1", "its standard error")]
    coverage_low: Annotated[OpenNumber, described("1", _LOW)]
    coverage_high: Annotated[OpenNumber, described("1", _HIGH)]
    largest_bias_t: Annotated[OpenNumber, described("1", "of all parameters, without its sign")]


@dataclass(frozen=True)
class Failure:
    """A repetition without an estimate."""

    repetition: Annotated[int, described("1", "number of the repetition")]
    reason: Annotated[str, described("", "in words")]


@dataclass(frozen=True)
class EstimatorStatistics:
    """One estimator over all repetitions."""

    estimates: Annotated[int, described("1", "repetitions in which there is an estimate")]
    not_converged: Annotated[tuple[int, ...], described("1", "numbers of repetitions")]
    failures: Annotated[tuple[Failure, ...], described("", "repetitions without an estimate")]
    iterations: Annotated[dict[str, int], described("1", "how often each number of them")]
    pooled: Annotated[PooledStatistics | None, described("", "all identified parameters together")]


@dataclass(frozen=True)
class RepetitionCounts:
    """Numbers of repetitions."""

    wanted: Annotated[int, described("1", "repetitions asked for")]
    done: Annotated[int, described("1", "repetitions that were done")]


@dataclass(frozen=True)
class StatisticsRow:
    """Statistics of one parameter of one estimator: a row of `tables/montecarlo.csv`."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    parameter: Annotated[str, described("", "name")]
    unit: Annotated[str, described("", "SI unit of the columns that refer to it")]
    truth: Annotated[float, described("see unit", "true value")]
    identified: Annotated[bool, described("", "bound below half the parameter's scale")]
    estimates: Annotated[int, described("1", "repetitions in which there is an estimate")]
    bias: Annotated[OpenNumber, described("see unit", "mean error")]
    bias_std_error: Annotated[OpenNumber, described("see unit", "standard error of the bias")]
    bias_t: Annotated[OpenNumber, described("1", "bias in standard errors")]
    spread: Annotated[OpenNumber, described("see unit", "standard deviation of the estimates")]
    rmse: Annotated[OpenNumber, described("see unit", "root mean square of the errors")]
    bound: Annotated[
        OpenNumber,
        described("see unit", "Cramér–Rao bound at the truth, as a standard deviation"),
    ]
    reported_std: Annotated[
        OpenNumber,
        described("see unit", "root mean square of the standard deviations stated"),
    ]
    reported_over_spread: Annotated[
        OpenNumber, described("1", "the stated over the true standard deviation")
    ]
    rmse_over_bound: Annotated[
        OpenNumber, described("1", "1 for an estimator that cannot be improved")
    ]
    rmse_over_bound_low: Annotated[OpenNumber, described("1", _LOW)]
    rmse_over_bound_high: Annotated[OpenNumber, described("1", _HIGH)]
    coverage: Annotated[
        OpenNumber, described("1", "share of the stated 95 % intervals that hold the truth")
    ]
    coverage_low: Annotated[OpenNumber, described("1", _LOW)]
    coverage_high: Annotated[OpenNumber, described("1", _HIGH)]
    largest_error: Annotated[OpenNumber, described("1", "in any repetition, in units of the RMSE")]


@dataclass(frozen=True)
class RepetitionTable(CsvFile[tuple[Repetition, ...], None]):
    """A table of all repetitions and estimators, failures included, with columns by parameter."""

    parameters: tuple[str, ...]

    @property
    def columns(self) -> tuple[Column, ...]:
        """Those of the repetition, then those of the parameters."""
        return (
            Column("repetition", "1", "number, from 1"),
            Column("estimator", "", "ls, gm or ml"),
            Column("failure", "", "reason for a missing estimate; otherwise empty"),
            Column("converged", "", "whether the iteration ended as it should"),
            Column("iterations", "1", "of the estimator"),
            Column("harmonics", "1", "of ML's motion; empty after pointwise differentiation"),
            Column("freedom", "1", "degrees of freedom of the noise covariance; inf when given"),
            *(Column(name, "SI", f"estimate of {name}") for name in self.parameters),
            *(
                Column(f"std_{name}", "SI", f"stated standard deviation of {name}")
                for name in self.parameters
            ),
        )

    def write(self, folder: Path, content: tuple[Repetition, ...]) -> list[Path]:
        """Write the rows."""
        return self.write_rows(folder, self.rows(content))

    def rows(self, repetitions: tuple[Repetition, ...]) -> list[list[Any]]:
        """Return the rows."""
        blank = np.full(len(self.parameters), np.nan)
        return [
            [
                repetition.number,
                estimator,
                outcome.error,
                outcome.converged,
                outcome.iterations,
                repetition.harmonics,
                repetition.freedom,
                *(blank if outcome.values is None else outcome.values),
                *(blank if outcome.std is None else outcome.std),
            ]
            for repetition in repetitions
            for estimator, outcome in repetition.outcomes.items()
        ]


class _WrittenRepetitions(Place):
    """The table of all repetitions, which is not read: the statistics follow from it."""

    FILE = "tables/montecarlo_repetitions.csv"

    def read(self, result: Any, kind: Any, folder: Path) -> tuple[Repetition, ...]:
        """Return no repetitions."""
        del result, kind, folder
        return ()

    def write(self, result: Any, kind: Any, value: Any, folder: Path) -> Iterator[Path]:
        """Write the table."""
        del kind
        names = tuple(result.truth)
        yield from RepetitionTable(self.FILE, result.WRITTEN_BY, names).write(folder, value)

    def tables(self, kind: Any, written_by: str) -> Iterator[CsvFile[Any, Any]]:
        """Yield the table with a placeholder for the parameters."""
        del kind
        yield RepetitionTable(self.FILE, written_by, ("<parameter>",))


@dataclass(frozen=True, eq=False, kw_only=True)
class MonteCarloResult(RunFile, StageResult):
    """Statistics of the estimators over many simulated experiments, SI."""

    FILE: ClassVar[str] = "montecarlo.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign montecarlo`"
    counts: Annotated[RepetitionCounts, described("1", "wanted and done", name="repetitions")]
    estimators: Annotated[dict[str, EstimatorStatistics], described("", "of each estimator")]
    parameters: Annotated[tuple[str, ...], described("", "names of those estimated")]
    identified: Annotated[tuple[str, ...], described("", "names of those that are pooled")]
    truth: Annotated[dict[str, float], described("SI", "true values")]
    bound_covariance: Annotated[
        Numbers, described("SI", "Cramér–Rao bound, all parameters; zero for fixed ones")
    ]
    harmonics: Annotated[dict[str, int], described("1", "how often each number was fitted")]
    settings: Annotated[
        dict[str, Any],
        described("", "`seed`, `experiment`, `samples`, `samples_per_period`, `estimate`"),
    ]
    repetitions: Annotated[tuple[Repetition, ...], _WrittenRepetitions()] = ()
    """Empty in a result that was read."""
    rows: Annotated[
        tuple[StatisticsRow, ...],
        Table(
            "tables/montecarlo.csv",
            some=True,
            rows_of=("estimator", "parameter", "estimates"),
            as_in=("subjects",),
        ),
    ]

    @property
    def interrupted(self) -> Annotated[bool, described("", "some are missing")]:
        """True when repetitions are missing."""
        return self.counts.done < self.counts.wanted

    @property
    def subjects(self) -> tuple[tuple[str, str, int], ...]:
        """Estimator, parameter and number of estimates of every row of statistics."""
        return tuple(
            (estimator, name, entry.estimates)
            for estimator, entry in self.estimators.items()
            if entry.estimates
            for name in self.parameters
        )

    @property
    def bound_std(self) -> Array:
        """(m,) smallest standard deviations of an unbiased estimator, SI."""
        return np.sqrt(np.diag(self.bound_covariance))

    def statistics(self, estimator: str) -> dict[str, StatisticsRow]:
        """Return the statistics of every free parameter; none without an estimate."""
        return {row.parameter: row for row in self.rows if row.estimator == estimator}

    def contradictions(self) -> Iterator[Problem]:
        """Yield names and shapes that differ from those of the parameters."""
        names, count = self.parameters, len(self.truth)
        yield from unknown_names("parameters", names, self.truth, "truth")
        yield from unknown_names("identified", self.identified, names, "parameters")
        yield from wrong_covariance("bound_covariance", self.bound_covariance, count, "truth")


def parameter_statistics(
    errors: Array, std: Array, widths: Array, bound: float
) -> dict[str, float]:
    """Return the statistics of one parameter: those fields of `StatisticsRow`.

    Parameters
    ----------
    errors : (K,)
        Estimate minus truth, K ≥ 1.
    std : (K,)
        As the estimator states it.
    widths : (K,)
        Half widths of its intervals in units of `std`.
    bound : float
        Smallest standard deviation that an unbiased estimator can have.

    Notes
    -----
    The interval of RMSE/bound is that of a root of a scaled χ². K errors without a bias have K
    degrees of freedom; with a bias b and a spread σ the mean square has more,
    K (σ² + b²)² / (σ⁴ + 2 σ² b²). That of the coverage is Clopper's and Pearson's.
    """
    count = len(errors)
    bias = float(np.mean(errors))
    spread = float(np.std(errors, ddof=1)) if count > 1 else np.nan
    mean_square = float(np.mean(errors**2))
    std_error = spread / float(np.sqrt(count))
    reported = float(np.sqrt(np.mean(std**2)))
    variance = max(mean_square - bias**2, 0.0)
    steadiness = variance * (variance + 2 * bias**2)
    freedom = count * mean_square**2 / steadiness if steadiness > 0 else np.nan
    rmse = float(np.sqrt(mean_square))
    share = float(np.count_nonzero(np.abs(errors) <= widths * std)) / count
    return dict(
        bias=bias,
        bias_std_error=std_error,
        bias_t=_ratio(bias, std_error),
        spread=spread,
        rmse=rmse,
        bound=bound,
        reported_std=reported,
        reported_over_spread=_ratio(reported, spread),
        **_with_ends("rmse_over_bound", rmse / bound, _root_interval(rmse / bound, freedom)),
        **_with_ends("coverage", share, share_interval(share, count)),
        largest_error=_ratio(float(np.max(np.abs(errors))), rmse),
    )


def pooled_statistics(errors: Array, std: Array, widths: Array, bound: Array) -> PooledStatistics:
    """Return the statistics of m parameters together; arguments as of `parameter_statistics`.

    Errors, std and widths are (K, m) here, the bound is (m,).

    Notes
    -----
    The square of the pooled RMSE/bound is the mean of K independent numbers, the mean squares of
    each repetition: their scatter gives its standard error however the parameters are correlated
    (the jackknife over repetitions gives the same), and with it the degrees of freedom of the χ²
    that the interval is taken from. The coverage's interval is Clopper's and Pearson's with as
    many independent trials as have this standard error.
    """
    count = len(errors)
    squares = np.mean((errors / bound) ** 2, axis=1)
    mean = float(np.mean(squares))
    error = float(np.std(squares, ddof=1) / np.sqrt(count)) if count > 1 else np.nan
    ratio = float(np.sqrt(mean))
    freedom = 2 * (mean / error) ** 2 if error > 0 else np.nan
    hits = np.mean(np.abs(errors) <= widths * std, axis=1)
    coverage = float(np.mean(hits))
    coverage_error = float(np.std(hits, ddof=1) / np.sqrt(count)) if count > 1 else np.nan
    trials = float(count)
    if coverage_error > 0:
        trials = coverage * (1 - coverage) / coverage_error**2
    biases = np.mean(errors, axis=0)
    spreads = np.std(errors, axis=0, ddof=1) if count > 1 else np.full(len(bound), np.nan)
    return PooledStatistics(
        **_with_ends("rmse_over_bound", ratio, _root_interval(ratio, freedom)),
        rmse_over_bound_std_error=_ratio(error, 2 * ratio),
        **_with_ends("coverage", coverage, share_interval(coverage, trials)),
        coverage_std_error=coverage_error,
        largest_bias_t=max(
            abs(_ratio(float(b), float(s / np.sqrt(count))))
            for b, s in zip(biases, spreads, strict=True)
        ),
    )


def _with_ends(name: str, value: float, ends: tuple[float, float]) -> dict[str, float]:
    return {name: value, f"{name}_low": ends[0], f"{name}_high": ends[1]}


def share_interval(share: float, trials: float) -> tuple[float, float]:
    """Return Clopper's and Pearson's 95 % interval of a probability; trials need not be whole."""
    tail = (1 - LEVEL) / 2
    hits = share * trials
    misses = trials - hits
    low = scipy.stats.beta.ppf(tail, hits, misses + 1) if hits > 0 else 0.0
    high = scipy.stats.beta.ppf(1 - tail, hits + 1, misses) if misses > 0 else 1.0
    return float(low), float(high)


def _root_interval(root: float, freedom: float) -> tuple[float, float]:
    """Return the 95 % interval of a root mean square with these degrees of freedom."""
    tail = (1 - LEVEL) / 2
    quantiles = scipy.stats.chi2.ppf([1 - tail, tail], freedom)
    low, high = root * np.sqrt(freedom / quantiles)
    return float(low), float(high)


def _ratio(value: float, unit: float) -> float:
    return value / unit if unit > 0 else np.nan
