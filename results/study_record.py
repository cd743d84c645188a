"""A Monte-Carlo study as its folder tells it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from results.reading.estimator_statistics import EstimatorStatistics


@dataclass(frozen=True, eq=False)
class StudyRecord:
    """What figures of a study are drawn from.

    Attributes
    ----------
    series : tuple of EstimatorStatistics
        The estimators, also those of several studies side by side.
    """

    series: tuple[EstimatorStatistics, ...]

    @classmethod
    def load(cls, folder: Path) -> StudyRecord:
        """Read a run folder; nothing else is read and nothing is computed.

        Raises
        ------
        InputError
            `tables/montecarlo.csv` is missing or no such table.
        """
        return cls(EstimatorStatistics.read(folder / "tables" / "montecarlo.csv"))
