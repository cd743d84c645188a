"""A simulated experiment as its run folder keeps it: `truth.json` and `measurement.csv`."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
import pandas as pd
from pydantic import PlainSerializer, PlainValidator

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from expdesign.runfolder import (
    ArrayTable,
    Column,
    Numbers,
    RunFile,
    describe_tables,
    described,
    strutwise,
)
from expdesign.runfolder.atomic import write_csv
from expdesign.runfolder.described import checker
from expdesign.trajectory import FourierKeys, FourierTrajectory, fourier_keys

_WRITTEN_BY = "`expdesign simulate`"
REPETITIONS = "repetitions"


@dataclass(frozen=True, eq=False)
class MeasurementColumns:
    """A simulated measurement; `estimation.data` reads it, and files of machines."""

    time: Annotated[Array, Column("t", "s", "time from the start of the experiment")]
    lengths: Annotated[Array, strutwise("q", "m", "measured length")]
    forces: Annotated[Array, strutwise("Q", "N", "measured actuator force, positive extends,")]
    period: Annotated[Array, Column("period", "1", "number of the period, from 1")]


MEASUREMENT = ArrayTable("measurement.csv", _WRITTEN_BY, MeasurementColumns)
"""The column `period` is optional in a file that is read."""


def repetition_file(repetition: int) -> str:
    """Return where in the run folder one of several repetitions stands."""
    return f"{REPETITIONS}/{repetition:04d}/{MEASUREMENT.file}"


def write_measurement(measurement: Measurement, path: Path) -> None:
    """Write a measurement with all digits: t, q1 … q6, Q1 … Q6 and, where known, the period."""
    write_csv(path, pd.DataFrame(measurement.channels))


def _motion_keys(motion: FourierTrajectory) -> dict[str, Any]:
    return {**fourier_keys(motion), "frequency_hz": motion.frequency, "period": motion.period}


Motion = Annotated[
    FourierTrajectory,
    PlainValidator(lambda value: checker(FourierKeys).validate_python(value).trajectory),
    PlainSerializer(_motion_keys),
]
"""A trajectory whose keys in a file are those of `design.json`, its frequency and its period."""


@dataclass(frozen=True)
class ExecutedTableTruth:
    """A controller table that the machine executed instead of the series itself."""

    file: Annotated[str, described("", "name of the file")]
    format: Annotated[str, described("", "name of its format")]
    sha256: Annotated[str, described("", "of the file")]
    window: Annotated[
        tuple[float, float],
        described("s", "measurement window: beginning and end, from the start of the table"),
    ]
    position_error: Annotated[
        float, described("m", "by which the struts are off `executed` at most")
    ]


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
class Truth(RunFile):
    """What is true of a simulated experiment, against which estimates are judged: `truth.json`.

    The motions begin at the first sample; `executed` is the design itself without tracking error.
    """

    FILE: ClassVar[str] = "truth.json"
    WRITTEN_BY: ClassVar[str] = _WRITTEN_BY
    parameters: Annotated[
        dict[str, float], described("SI", "true values by name, in the order of the regressor")
    ]
    experiment: Annotated[ExperimentKeys, described("", "length and sampling")]
    design: Annotated[Motion, described("", "the motion that was commanded")]
    executed: Annotated[Motion, described("", "the motion that was made")]
    force_covariance: Annotated[Numbers, described("N^2", "Σ of one sample, 6 × 6")]
    length_covariance: Annotated[Numbers, described("m^2", "Δ of one sample, 6 × 6")]
    table: Annotated[
        ExecutedTableTruth | None,
        described("", "the controller table that was executed; null for a design"),
    ] = None
    disturbances: Annotated[DisturbanceKeys, described("", "besides the noise")]
    seeds: Annotated[SeedKeys, described("", "of the random numbers")]

    @property
    def parameter_vector(self) -> Array:
        """(m,) the parameters in their order, SI."""
        return np.array(list(self.parameters.values()))


def write_truth(truth: Truth, folder: Path, *, repeated: bool) -> list[Path]:
    """Write what stands beside the measurements, `truth.json` and `columns.json`; return both.

    Parameters
    ----------
    repeated : bool
        Whether the measurements are in `repetitions/`.
    """
    table = replace(MEASUREMENT, file=f"{REPETITIONS}/*/{MEASUREMENT.file}")
    return [truth.write(folder), describe_tables(folder, [table if repeated else MEASUREMENT])]
