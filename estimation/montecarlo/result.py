"""A study as its run folder keeps it. Values are SI; the same study gives the same bytes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import pandas as pd

from estimation.montecarlo.repetition import Repetition
from estimation.montecarlo.statistics import ParameterStatistics, PooledStatistics
from estimation.montecarlo.study import Study
from expdesign.configuration import Problem
from expdesign.configuration.section import unstated
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.runfolder import (
    Column,
    Contents,
    CsvFile,
    FolderRecord,
    Numbers,
    RowKeys,
    RowTable,
    RunFile,
    described,
)
from expdesign.runfolder.fields import unknown_names, wrong_covariance

_WRITTEN_BY = "`expdesign montecarlo`"


@dataclass(frozen=True)
class FailureKeys:
    """A repetition in which an estimator failed."""

    repetition: Annotated[int, described("1", "number of the repetition")]
    reason: Annotated[str, described("", "in words")]


@dataclass(frozen=True)
class EstimatorKeys:
    """One estimator over all repetitions."""

    estimates: Annotated[int, described("1", "repetitions in which there is an estimate")]
    not_converged: Annotated[tuple[int, ...], described("1", "numbers of repetitions")]
    failures: Annotated[tuple[FailureKeys, ...], described("", "repetitions without an estimate")]
    iterations: Annotated[dict[str, int], described("1", "how often each number of them")]
    pooled: Annotated[PooledStatistics | None, described("", "all identified parameters together")]

    @classmethod
    def of(cls, study: Study, estimator: str) -> Self:
        """Count one estimator's outcomes."""
        found = study.estimated(estimator)
        return cls(
            estimates=len(found),
            not_converged=tuple(r.number for r, outcome in found if not outcome.converged),
            failures=tuple(FailureKeys(*failure) for failure in study.failures(estimator)),
            iterations=_counts(outcome.iterations for _, outcome in found),
            pooled=study.pooled(estimator),
        )


@dataclass(frozen=True)
class CountKeys:
    """How many repetitions there are."""

    wanted: Annotated[int, described("1", "repetitions asked for")]
    done: Annotated[int, described("1", "repetitions that were done")]


@dataclass(frozen=True, eq=False, kw_only=True)
class MonteCarloFile(RunFile):
    """`montecarlo.json`."""

    FILE: ClassVar[str] = "montecarlo.json"
    WRITTEN_BY: ClassVar[str] = _WRITTEN_BY
    repetitions: Annotated[CountKeys, described("1", "wanted and done")]
    interrupted: Annotated[bool, described("", "some are missing")]
    estimators: Annotated[dict[str, EstimatorKeys], described("", "of each estimator")]
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

    def contradictions(self) -> Iterator[Problem]:
        """Yield what is not of these parameters."""
        names, count = self.parameters, len(self.truth)
        yield from unknown_names("parameters", names, self.truth, "truth")
        yield from unknown_names("identified", self.identified, names, "parameters")
        yield from wrong_covariance("bound_covariance", self.bound_covariance, count, "truth")

    @classmethod
    def of(cls, study: Study) -> Self:
        """Describe a study."""
        names = study.knowledge.names
        run, truth = study.configuration.run, study.truth
        return cls(
            name=run.name,
            robot=study.robot.name,
            repetitions=CountKeys(study.wanted, len(study.repetitions)),
            interrupted=study.interrupted,
            estimators={name: EstimatorKeys.of(study, name) for name in study.estimators},
            parameters=tuple(names[k] for k in study.free),
            identified=tuple(names[k] for k in study.identified),
            truth=dict(zip(names, truth.values_of(names).tolist(), strict=True)),
            bound_covariance=study.bound,
            harmonics=_counts(repetition.harmonics for repetition in study.repetitions),
            settings={
                "seed": run.montecarlo.seed,
                "experiment": run.experiment.model_dump(
                    mode="json", exclude=unstated(run.experiment)
                ),
                "samples": truth.experiment.samples,
                "samples_per_period": truth.experiment.samples_per_period,
                "estimate": run.estimate.model_dump(mode="json", exclude={"estimators"}),
            },
        )


@dataclass(frozen=True)
class _Subject:
    """Which estimator and parameter a row is about."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    parameter: Annotated[str, described("", "name")]
    unit: Annotated[str, described("", "SI unit of the columns that refer to it")]
    truth: Annotated[float, described("see unit", "true value")]
    identified: Annotated[bool, described("", "bound below half the parameter's scale")]
    estimates: Annotated[int, described("1", "repetitions in which there is an estimate")]


@dataclass(frozen=True)
class StatisticsRow(ParameterStatistics, _Subject):
    """One parameter of one estimator over all repetitions: a row of `tables/montecarlo.csv`."""


@dataclass(frozen=True)
class RepetitionTable(CsvFile[Iterable[Repetition], None]):
    """One row per repetition and estimator, those that failed included."""

    parameters: tuple[str, ...]

    @property
    def columns(self) -> tuple[Column, ...]:
        """Those of the repetition, then those of the parameters."""
        return (
            Column("repetition", "1", "number, from 1"),
            Column("estimator", "", "ls, gm or ml"),
            Column("failure", "", "why there is no estimate; empty when there is one"),
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

    def write(self, folder: Path, content: Iterable[Repetition]) -> list[Path]:
        """Write the rows."""
        return self.write_frame(folder, self.frame(content))

    def frame(self, repetitions: Iterable[Repetition]) -> pd.DataFrame:
        """Return the rows."""
        blank = np.full(len(self.parameters), np.nan)
        rows = [
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
        return pd.DataFrame(rows, columns=list(self.names)).astype({"harmonics": "Int64"})


def repetition_table(parameters: Iterable[str]) -> RepetitionTable:
    """Return `tables/montecarlo_repetitions.csv` for these parameters."""
    return RepetitionTable("tables/montecarlo_repetitions.csv", _WRITTEN_BY, tuple(parameters))


@dataclass(frozen=True, eq=False)
class MonteCarloRecord(FolderRecord):
    """A study, from memory or from its run folder: what figures and reports are made from.

    The repetitions are not read again.
    """

    TABLES: ClassVar = {
        "rows": RowTable(
            "tables/montecarlo.csv",
            _WRITTEN_BY,
            StatisticsRow,
            some=True,
            rows_of=("estimator", "parameter", "estimates"),
        )
    }
    summary: MonteCarloFile
    rows: tuple[StatisticsRow, ...]
    repetitions: tuple[Repetition, ...] = ()

    @classmethod
    def of(cls, study: Study) -> Self:
        """Take it from a study."""
        summary = MonteCarloFile.of(study)
        rows = tuple(
            StatisticsRow(
                estimator=estimator,
                parameter=name,
                unit=parameter_unit(name),
                truth=summary.truth[name],
                identified=name in summary.identified,
                estimates=summary.estimators[estimator].estimates,
                **asdict(found),
            )
            for estimator in study.estimators
            for name, found in study.statistics(estimator).items()
        )
        return cls(summary, rows, study.repetitions)

    @classmethod
    def row_keys(cls, found: Mapping[str, Any]) -> RowKeys:
        """Return the estimators with estimates, of each the parameters, and how many there are."""
        summary: MonteCarloFile = found["summary"]
        return {
            "rows": [
                (estimator, name, entry.estimates)
                for estimator, entry in summary.estimators.items()
                if entry.estimates
                for name in summary.parameters
            ]
        }

    def contents(self) -> Contents:
        """Yield the tables, the repetitions first."""
        yield repetition_table(self.summary.truth), self.repetitions
        yield from super().contents()


def _counts(values: Iterable[int | None]) -> dict[str, int]:
    """Return how often each number occurs, in ascending order."""
    counted = Counter(value for value in values if value is not None)
    return {str(value): counted[value] for value in sorted(counted)}
