"""A simulated experiment as its run folder keeps it: `truth.json` and `measurement.csv`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import pandas as pd

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.twin.truth import ExecutedTableTruth, Truth
from expdesign.mechanism.hexapod import numbered
from expdesign.runfolder import (
    ArrayTable,
    Column,
    JsonFile,
    Numbers,
    array_columns,
    describe_tables,
    described,
)
from expdesign.runfolder.atomic import write_csv
from expdesign.runfolder.columns import strutwise
from expdesign.trajectory import FourierKeys, FourierTrajectory, fourier_keys

_WRITTEN_BY = "`expdesign simulate`"
REPETITIONS = "repetitions"


@dataclass(frozen=True, eq=False)
class MeasurementColumns:
    """A simulated measurement; `estimation.data` reads it, and files of machines."""

    time: Annotated[Array, array_columns(Column("t", "s", "time from the start of the experiment"))]
    lengths: Annotated[Array, array_columns(*strutwise("q", "m", "measured length"))]
    forces: Annotated[
        Array, array_columns(*strutwise("Q", "N", "measured actuator force, positive extends,"))
    ]
    period: Annotated[Array, array_columns(Column("period", "1", "number of the period, from 1"))]


MEASUREMENT = ArrayTable("measurement.csv", _WRITTEN_BY, MeasurementColumns)
"""The column `period` is optional in a file that is read."""


def repetition_file(repetition: int) -> str:
    """Return where in the run folder one of several repetitions stands."""
    return f"{REPETITIONS}/{repetition:04d}/{MEASUREMENT.file}"


def write_measurement(measurement: Measurement, path: Path) -> None:
    """Write a measurement with all digits: t, q1 … q6, Q1 … Q6 and, where known, the period."""
    columns = {
        "t": measurement.time,
        **dict(zip(numbered("q"), measurement.lengths.T, strict=True)),
        **dict(zip(numbered("Q"), measurement.forces.T, strict=True)),
    }
    if measurement.period is not None:
        columns["period"] = measurement.period
    write_csv(path, pd.DataFrame(columns))


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionKeys(FourierKeys):
    """A motion of the twin."""

    frequency_hz: Annotated[float, described("Hz", "base frequency")]
    period: Annotated[float, described("s", "duration of a period")]

    @classmethod
    def of(cls, motion: FourierTrajectory) -> Self:
        """Describe a motion."""
        return cls(**fourier_keys(motion), frequency_hz=motion.frequency, period=motion.period)


@dataclass(frozen=True)
class ExperimentKeys:
    """Length and sampling of a simulated experiment."""

    periods: Annotated[float, described("1", "number of periods")]
    sampling: Annotated[float, described("Hz", "samples per second")]
    samples: Annotated[int, described("1", "rows of a measurement")]
    samples_per_period: Annotated[float, described("1", "whole or not")]


@dataclass(frozen=True)
class DisturbanceKeys:
    """What disturbs the experiment besides the noise, as the run file names it; null when off."""

    tracking_error: Annotated[dict[str, Any] | None, described("m, rad", "of the execution")]
    drift: Annotated[
        dict[str, Any] | None, described("m", "of the lengths: size, and final of each strut")
    ]
    cogging: Annotated[dict[str, Any] | None, described("N, m, rad", "position-periodic forces")]
    quantisation: Annotated[dict[str, Any] | None, described("m, N", "of lengths and forces")]
    outliers: Annotated[dict[str, Any] | None, described("1", "share and size")]

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the disturbances that are on, in words."""
        return tuple(name.replace("_", " ") for name, value in vars(self).items() if value)


@dataclass(frozen=True)
class SeedKeys:
    """Seeds of the random numbers."""

    experiment: Annotated[int, described("1", "of what all repetitions share")]
    repetitions: Annotated[int, described("1", "of their noise and outliers")]


@dataclass(frozen=True, eq=False, kw_only=True)
class TruthFile(JsonFile):
    """`truth.json`."""

    FILE: ClassVar[str] = "truth.json"
    WRITTEN_BY: ClassVar[str] = _WRITTEN_BY

    units: Annotated[str, described("", "of all values")] = "SI and radians"
    name: Annotated[str, described("", "name of the run")]
    robot: Annotated[str, described("", "name of the robot")]
    parameters: Annotated[dict[str, float], described("SI", "true values by name")]
    experiment: Annotated[ExperimentKeys, described("", "length and sampling")]
    design: Annotated[MotionKeys, described("", "the motion that was commanded")]
    executed: Annotated[MotionKeys, described("", "the motion that was made")]
    force_covariance: Annotated[Numbers, described("N^2", "Σ of one sample, 6 × 6")]
    length_covariance: Annotated[Numbers, described("m^2", "Δ of one sample, 6 × 6")]
    table: Annotated[
        ExecutedTableTruth | None,
        described("", "the controller table that was executed; null for a design"),
    ] = None
    disturbances: Annotated[DisturbanceKeys, described("", "besides the noise")]
    seeds: Annotated[SeedKeys, described("", "of the random numbers")]

    @classmethod
    def of(cls, truth: Truth) -> Self:
        """Describe the truth of an experiment."""
        section = truth.experiment

        def dumped(name: str) -> dict[str, Any] | None:
            part = getattr(section, name)
            return None if part is None else part.model_dump()

        drift = {"size": section.drift, "final": truth.final_drift} if section.drift else None
        return cls(
            name=truth.name,
            robot=truth.robot,
            parameters=dict(truth.parameters),
            experiment=ExperimentKeys(
                section.periods, section.sampling, truth.samples, truth.samples_per_period
            ),
            design=MotionKeys.of(truth.design),
            executed=MotionKeys.of(truth.executed),
            force_covariance=truth.force_covariance,
            length_covariance=truth.length_covariance,
            table=truth.table,
            disturbances=DisturbanceKeys(
                dumped("tracking_error"),
                drift,
                dumped("cogging"),
                dumped("quantisation"),
                dumped("outliers"),
            ),
            seeds=SeedKeys(section.seed, truth.seed),
        )


def write_truth(truth: Truth, folder: Path, *, repeated: bool) -> list[Path]:
    """Write what stands beside the measurements, `truth.json` and `columns.json`; return both.

    Parameters
    ----------
    truth : Truth
    folder : Path
    repeated : bool
        Whether the measurements are in `repetitions/`.
    """
    table = replace(MEASUREMENT, file=f"{REPETITIONS}/*/{MEASUREMENT.file}")
    return [
        TruthFile.of(truth).write(folder),
        describe_tables(folder, [table if repeated else MEASUREMENT]),
    ]
