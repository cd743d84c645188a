"""An estimate as its run folder keeps it: `estimate.json`, `estimates.csv` and the tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, astuple, dataclass
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.diagnosis_result import Diagnosis, ExperimentRecord
from estimation.diagnostics.noise_result import CovarianceRow, covariance_rows
from estimation.identification.estimate_file import EstimateFile
from estimation.identification.estimator_result import (
    BudgetRow,
    ConsistentRow,
    ConstantRow,
    DeviationRow,
    OfEstimator,
    PayloadRow,
    budget_rows,
    consistent_rows,
    constant_rows,
    deviation_rows,
    payload_rows,
)
from estimation.identification.identified_robot import FILE as IDENTIFIED_ROBOT
from estimation.identification.identified_robot import identified_robot
from estimation.identification.result import EstimationResult
from estimation.selection.selection import SelectionRow
from estimation.uncertainty.intervals import ParameterRow, correlation
from expdesign.experiment.combinations import KnownCombination
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.runfolder import (
    ArrayTable,
    Column,
    Contents,
    FolderRecord,
    MatrixTable,
    OpenNumber,
    RowKeys,
    RowTable,
    described,
)
from expdesign.runfolder.fields import (
    ACCELERATION_COLUMNS,
    POSE_COLUMNS,
    RATE_COLUMNS,
    TIME,
    strutwise,
)
from expdesign.runfolder.files import write_text
from expdesign.runfolder.tables import Matrices

_WRITTEN_BY = EstimateFile.WRITTEN_BY


@dataclass(frozen=True)
class PrecisionRow:
    """The shares of one standard deviation beside the Cramér–Rao bound."""

    estimator: Annotated[str, described("", "ls, gm or ml")]
    parameter: Annotated[str, described("", "name")]
    std: Annotated[float, described("SI", "standard deviation")]
    std_forces: Annotated[float, described("SI", "the share that the noise of the forces makes")]
    std_kinematics: Annotated[
        OpenNumber, described("SI", "the share that the noise of the lengths makes")
    ]
    bound: Annotated[
        OpenNumber, described("SI", "Cramér–Rao bound with noise in forces and lengths")
    ]


@dataclass(frozen=True)
class _OfRecording:
    recording: Annotated[int, described("1", "number of the recording")]


@dataclass(frozen=True)
class NoiseRow(CovarianceRow, _OfRecording):
    """One element of Σ or Δ of one recording."""


@dataclass(frozen=True, kw_only=True)
class EstimatedCombination(KnownCombination, OfEstimator):
    """A combination of parameters that the data identify."""


@dataclass(frozen=True, eq=False)
class EstimatedMotion:
    """Measured and modelled quantities at the samples of one recording."""

    time: Annotated[Array, TIME]
    state: Annotated[Array, POSE_COLUMNS, RATE_COLUMNS, ACCELERATION_COLUMNS]
    lengths: Annotated[Array, strutwise("q", "m", "measured length, mean over periods,")]
    lengths_model: Annotated[
        Array, strutwise("q", "m", "length on the estimated motion", suffix="_model")
    ]
    forces: Annotated[Array, strutwise("Q", "N", "measured force, mean over periods,")]
    forces_model: Annotated[Array, strutwise("Q", "N", "force by the estimate", suffix="_model")]

    @classmethod
    def of(cls, result: EstimationResult, number: int) -> Self:
        """Evaluate the best estimate at the samples of a recording, counted from 0."""
        experiment, motion = result.records[number].experiment, result.best.motions[number]
        record = experiment.record
        length_state = motion.at(record.lengths.times).state()
        return cls(
            record.forces.times + record.origin,
            motion.at(record.forces.times).state(),
            record.lengths.values,
            result.robot.inverse_kinematics(length_state[:, :COORDINATES]),
            record.forces.values,
            experiment.regressors(result.robot, motion) @ result.best.values,
        )


def _matrix_table(name: str, unit: str) -> MatrixTable:
    keys = (Column("estimator", "", "ls, gm or ml"), Column("parameter", "", "name of the row"))
    entry = Column("<parameter>", unit, name)
    return MatrixTable(f"tables/{name}.csv", _WRITTEN_BY, keys, entry)


ESTIMATES = RowTable(
    "estimates.csv", _WRITTEN_BY, ParameterRow, some=True, rows_of=("estimator", "parameter")
)
MOTION = ArrayTable("tables/estimated_motion.csv", _WRITTEN_BY, EstimatedMotion)


@dataclass(frozen=True, eq=False)
class EstimateRecord(FolderRecord):
    """An estimate, from memory or from its run folder: what figures and reports are made from.

    There are no experiments without a diagnosis, and in a folder whose version did not keep their
    tables; and no motions, by the recording's number from 1, after pointwise differentiation.
    """

    TABLES: ClassVar = {
        "correlations": _matrix_table("correlation", "1"),
        "covariances": _matrix_table("covariance", "SI"),
        "precision": RowTable("tables/precision.csv", _WRITTEN_BY, PrecisionRow),
        "base_parameters": RowTable(
            "tables/estimate_combinations.csv", _WRITTEN_BY, EstimatedCombination
        ),
        "budget": RowTable("tables/budget.csv", _WRITTEN_BY, BudgetRow),
        "deviations": RowTable("tables/deviations.csv", _WRITTEN_BY, DeviationRow),
        "constants": RowTable("tables/constants.csv", _WRITTEN_BY, ConstantRow),
        "payload": RowTable("tables/payload.csv", _WRITTEN_BY, PayloadRow),
        "consistent": RowTable("tables/consistent.csv", _WRITTEN_BY, ConsistentRow),
        "noise": RowTable("tables/noise.csv", _WRITTEN_BY, NoiseRow),
        "selection": RowTable("tables/selection.csv", _WRITTEN_BY, SelectionRow),
        "rows": ESTIMATES,
    }
    summary: EstimateFile
    rows: tuple[ParameterRow, ...]
    experiments: tuple[ExperimentRecord, ...]
    motions: dict[int, EstimatedMotion]
    identified: str | None = None
    """The robot file of what was found; None in a folder whose version did not write it."""

    @classmethod
    def of(cls, result: EstimationResult, diagnosis: Diagnosis | None = None) -> Self:
        """Take it from a result; `diagnosis` is that of its best estimator."""
        return cls(
            EstimateFile.of(result, diagnosis),
            result.rows,
            diagnosis.experiments if diagnosis else (),
            {
                number + 1: EstimatedMotion.of(result, number)
                for number, record in enumerate(result.records)
                if record.experiment.fit is not None
            },
            identified_robot(result, diagnosis),
        )

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read it from a run folder."""
        found = cls.fields_in(folder)
        summary: EstimateFile = found["summary"]
        tested = () if summary.diagnostics is None else summary.diagnostics.experiments
        experiments = tuple(
            ExperimentRecord(
                tests=tests,
                noise=recording.noise,
                normality=tests.normality.forces,
                **ExperimentRecord.fields_in(folder, n),
            )
            for tests, recording, n in zip(
                tested, summary.recordings, summary.numbers, strict=False
            )
            if ExperimentRecord.TABLES["residuals"].numbered(n).is_in(folder)
        )
        tables = enumerate(map(MOTION.numbered, summary.numbers), start=1)
        motions = {n: table.read(folder) for n, table in tables if table.is_in(folder)}
        robot = folder / IDENTIFIED_ROBOT
        identified = robot.read_text(encoding="utf-8") if robot.is_file() else None
        return cls(**found, experiments=experiments, motions=motions, identified=identified)

    @classmethod
    def row_keys(cls, found: Mapping[str, Any]) -> RowKeys:
        """Return the estimators, and of each the parameters."""
        summary: EstimateFile = found["summary"]
        return {"rows": product(summary.estimators, summary.parameters)}

    def contents(self) -> Contents:
        """Yield the tables, with those of each recording before the estimates themselves."""
        optional = {
            "budget": self.budget,
            "deviations": self.budget,
            "constants": self.constants,
            "payload": self.payload,
            "consistent": self.consistent,  # a folder of a version before has none
            "selection": self.selection,
        }
        unsaid = (*(self.TABLES[name] for name, rows in optional.items() if not rows), ESTIMATES)
        yield from ((table, part) for table, part in super().contents() if table not in unsaid)
        numbers = self.summary.numbers
        for n, motion in self.motions.items():
            yield MOTION.numbered(numbers[n - 1]), motion
        for experiment, place in zip(self.experiments, numbers, strict=False):
            yield from ((table.numbered(place), part) for table, part in experiment.contents())
        yield ESTIMATES, self.rows

    def write(self, folder: Path) -> list[Path]:
        """Write the files, and the robot that was found."""
        written = super().write(folder)
        if self.identified is not None:
            write_text(folder / IDENTIFIED_ROBOT, self.identified)
            written.append(folder / IDENTIFIED_ROBOT)
        return written

    def by_estimator(self) -> dict[str, tuple[ParameterRow, ...]]:
        """Return the rows of each estimator, in the order of the parameters."""
        return {
            name: tuple(row for row in self.rows if row.estimator == name)
            for name in dict.fromkeys(row.estimator for row in self.rows)
        }

    @property
    def covariances(self) -> Matrices:
        """The covariance of every estimator, with the names of its rows and columns."""
        names = self.summary.parameters
        return [
            ([(estimator, name) for name in names], names, entry.covariance)
            for estimator, entry in self.summary.estimators.items()
        ]

    @property
    def correlations(self) -> Matrices:
        """The same as correlations."""
        return [(keys, names, correlation(matrix)) for keys, names, matrix in self.covariances]

    @property
    def precision(self) -> list[PrecisionRow]:
        """The shares of every standard deviation."""
        unknown = np.full(len(self.summary.parameters), np.nan)
        bound = self.summary.cramer_rao_covariance
        rows = []
        for estimator, entry in self.summary.estimators.items():
            share = entry.covariance_kinematics
            columns = (
                np.sqrt(np.diag(entry.covariance)),
                np.sqrt(np.diag(entry.covariance_forces)),
                unknown if share is None else np.sqrt(np.maximum(np.diag(share), 0.0)),
                unknown if bound is None else np.sqrt(np.diag(bound)),
            )
            rows += [
                PrecisionRow(estimator, name, *numbers)
                for name, *numbers in zip(
                    self.summary.parameters, *(c.tolist() for c in columns), strict=True
                )
            ]
        return rows

    @property
    def base_parameters(self) -> list[EstimatedCombination]:
        """What every estimator knows of combinations; empty in a folder of an earlier version."""
        return [
            EstimatedCombination(estimator=estimator, **asdict(row))
            for estimator, entry in self.summary.estimators.items()
            for row in entry.base_parameters
        ]

    @property
    def budget(self) -> list[BudgetRow]:
        """What every tolerance costs every parameter; empty where all is taken as exact."""
        names = self.summary.parameters
        return [
            row
            for estimator, entry in self.summary.estimators.items()
            if entry.systematic is not None and entry.systematic.groups
            for row in budget_rows(estimator, names, entry.covariance, entry.systematic)
        ]

    @property
    def deviations(self) -> list[DeviationRow]:
        """What is known of every number that is not known exactly."""
        return [
            row
            for estimator, entry in self.summary.estimators.items()
            if entry.systematic is not None
            for row in deviation_rows(estimator, entry.systematic)
        ]

    @property
    def constants(self) -> list[ConstantRow]:
        """Constants of terms that were estimated; empty where none was."""
        return [
            row
            for estimator, entry in self.summary.estimators.items()
            for row in constant_rows(estimator, entry.constants)
        ]

    @property
    def selection(self) -> tuple[SelectionRow, ...]:
        """Every term that was tried; empty where none was."""
        return () if self.summary.selection is None else self.summary.selection.steps

    @property
    def payload(self) -> list[PayloadRow]:
        """What the platform carries, by every estimator; empty without an earlier machine."""
        return [
            row
            for estimator, entry in self.summary.estimators.items()
            if entry.payload is not None
            for row in payload_rows(estimator, entry.payload)
        ]

    @property
    def consistent(self) -> list[ConsistentRow]:
        """Every estimate beside the nearest parameters that bodies have."""
        return [
            row
            for estimator, entry in self.summary.estimators.items()
            if entry.consistent is not None
            for row in consistent_rows(estimator, entry.values, entry.covariance, entry.consistent)
        ]

    @property
    def noise(self) -> list[NoiseRow]:
        """Σ and Δ of every recording, element by element."""
        return [
            NoiseRow(number, *astuple(row))
            for number, recording in enumerate(self.summary.recordings, start=1)
            for row in covariance_rows(recording.noise)
        ]
