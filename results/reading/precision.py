"""`tables/parameters.csv`: nominal parameters and their predicted standard deviations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from constraints.arrays import Array
from results.reading.table import Table


@dataclass(frozen=True, eq=False)
class Precision:
    """What the design promises for every parameter, in the order of the model.

    Attributes
    ----------
    names, units : tuple of str
    nominal : (m,)
        SI.
    per_period, experiment : (m,)
        Predicted standard deviations over the samples of one period and over the whole
        experiment, SI; NaN for a parameter that is not designed for.
    percent_per_period, percent_experiment : (m,)
        The same relative to the nominal value; NaN where that is zero.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    nominal: Array
    per_period: Array
    experiment: Array
    percent_per_period: Array
    percent_experiment: Array

    @classmethod
    def read(cls, path: Path) -> Precision:
        """Read the file.

        Raises
        ------
        RunFolderError
            It is missing or no such table.
        """
        spreads = (
            "std_per_period",
            "std_experiment",
            "rel_std_percent_per_period",
            "rel_std_percent_experiment",
        )
        table = Table.read(path, ["parameter", "unit", "nominal", *spreads])
        return cls(
            table.columns["parameter"],
            table.columns["unit"],
            table.numbers("nominal", blank=True),
            *(table.numbers(name, blank=True) for name in spreads),
        )
