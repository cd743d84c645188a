"""`tables/montecarlo.csv`: how good each estimator is, parameter by parameter."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError, Problem
from expdesign.runfolder import MissingFileError
from results.reading.table import Table

_NUMBERS = (
    "bias",
    "bias_std_error",
    "bound",
    "rmse_over_bound",
    "rmse_over_bound_low",
    "rmse_over_bound_high",
    "coverage",
    "coverage_low",
    "coverage_high",
)


@dataclass(frozen=True, eq=False)
class EstimatorStatistics:
    """One estimator over all repetitions.

    Attributes
    ----------
    estimator : str
        ``"ls"``, ``"gm"`` or ``"ml"``.
    label : str
        Its name in legends.
    estimates : int
        Repetitions that it is judged by.
    parameters : tuple of str
    bias, bias_std_error, bound : (m,)
        SI.
    rmse_over_bound, coverage : (m, 3)
        Value, lower and upper end of its 95 % interval.
    """

    estimator: str
    label: str
    estimates: int
    parameters: tuple[str, ...]
    bias: Array
    bias_std_error: Array
    bound: Array
    rmse_over_bound: Array
    coverage: Array

    @classmethod
    def read(cls, path: Path) -> tuple[EstimatorStatistics, ...]:
        """Read all estimators of the file, in its order.

        Raises
        ------
        InputError
            It is missing or no such table.
        """
        if not path.is_file():
            raise MissingFileError(path, "`expdesign montecarlo`")
        table = Table.read(path, ["estimator", "parameter", "estimates", *_NUMBERS])
        if not len(table):
            raise InputError(Problem("the table has no rows", path))
        numbers = {name: table.numbers(name, blank=True) for name in _NUMBERS}
        counts = table.numbers("estimates")
        found = []
        for estimator in dict.fromkeys(table.columns["estimator"]):
            rows = np.flatnonzero([name == estimator for name in table.columns["estimator"]])
            of = {name: values[rows] for name, values in numbers.items()}
            found.append(
                cls(
                    estimator=estimator,
                    label=estimator.upper(),
                    estimates=int(counts[rows[0]]),
                    parameters=tuple(table.columns["parameter"][k] for k in rows),
                    bias=of["bias"],
                    bias_std_error=of["bias_std_error"],
                    bound=of["bound"],
                    rmse_over_bound=_with_ends(of, "rmse_over_bound"),
                    coverage=_with_ends(of, "coverage"),
                )
            )
        return tuple(found)


def _with_ends(numbers: dict[str, Array], name: str) -> Array:
    return np.column_stack([numbers[name], numbers[f"{name}_low"], numbers[f"{name}_high"]])
