"""Files of a simulated experiment in its run folder: `truth.json` and `measurement.csv`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from pydantic import ConfigDict, PlainSerializer, PlainValidator

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.data.reading import file_channels
from expdesign.configuration import InputError, RunConfiguration, quote
from expdesign.configuration.estimate import Delay
from expdesign.configuration.experiment import ExperimentSection
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot
from expdesign.runfolder import (
    ArrayTable,
    Column,
    Covariance,
    Numbers,
    RunFile,
    describe_tables,
    described,
    sized,
    strutwise,
)
from expdesign.runfolder.fields import checker
from expdesign.runfolder.tables import write_csv
from expdesign.trajectory import FourierKeys, FourierTrajectory, fourier_keys

_WRITTEN_BY = "`expdesign simulate`"
_FORMS = {"ar": "autoregressive", "table": "as in its file", "band": "bands"}
"""Forms of a spectrum in words."""
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


def write_measurement(
    measurement: Measurement, path: Path, configuration: RunConfiguration | None = None
) -> None:
    """Write a measurement with all digits: t, q1 … q6, Q1 … Q6 and the period, if known.

    With a run they have the columns, units, signs, order and header of its section `data`.
    """
    if configuration is None:
        _write_columns(path, measurement.channels)
        return
    section, names = configuration.run.data, headings(configuration)
    channels = file_channels(measurement, section, configuration.robot)
    table = {
        names.get(name, (name, ""))[0]: values
        for name, values in channels.items()
        if name in section.channels
    }
    header = section.header
    if header.names is not None:
        zeros = np.zeros(len(measurement.time), dtype=int)
        table = {name: table.get(name, zeros) for name in header.names}
    _write_columns(path, table, section.delimiter, section.decimal, header)


def _write_columns(path: Path, columns: Mapping[str, Array], *form: Any) -> None:
    rows = zip(*(values.tolist() for values in columns.values()), strict=True)
    write_csv(path, list(columns), rows, *form)


def headings(configuration: RunConfiguration) -> dict[str, tuple[str, str]]:
    """Return names and units of the channels whose section `data` states others than SI.

    Raises
    ------
    InputError
        The section is not that of one file of the twin.
    """
    section, found = configuration.run.data, dict[str, tuple[str, str]]()
    experiment, file = configuration.run.experiment, configuration.file
    if section.sampling not in (None, experiment.sampling):
        message = "the twin samples at another frequency than a file without time is read with"
        allowed = f"experiment.sampling, {experiment.sampling:g} Hz"
        raise InputError(message, file, key="data.sampling", allowed=allowed)
    columns = [section.columns.get(channel, channel) for channel in section.channels]
    if double := next((name for name in columns if columns.count(name) > 1), ""):
        message = f"the twin writes lengths and forces into one file, where {quote(double)} is both"
        allowed = "a column for each channel"
        raise InputError(message, file, key="data.columns", allowed=allowed)
    for channel in section.channels:
        name, unit = section.columns.get(channel, channel), section.unit_of(channel)
        if unit is not None:
            # Names that are stated without the file have no unit in brackets.
            found[channel] = f"{name} [{unit}]" if section.header.names is None else name, unit
        elif name != channel:
            found[channel] = name, {"q": "m", "Q": "N", "t": "s"}.get(channel[0], "1")
    return found


Motion = Annotated[
    FourierTrajectory,
    PlainValidator(lambda value: checker(FourierKeys).validate_python(value).trajectory),
    PlainSerializer(
        lambda motion: (
            fourier_keys(motion) | {"frequency_hz": motion.frequency, "period": motion.period}
        )
    ),
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
    position_error: Annotated[float, described("m", "largest deviation of a strut from `executed`")]


@dataclass(frozen=True)
class ExperimentKeys:
    """Length and sampling of a simulated experiment."""

    periods: Annotated[float, described("1", "number of periods")]
    sampling: Annotated[float, described("Hz", "samples per second")]
    samples: Annotated[int, described("1", "rows of a measurement")]
    samples_per_period: Annotated[float, described("1", "whole or not")]
    follows: Annotated[
        str, described("", "what the controller follows: lengths of the robot, or platform")
    ] = "lengths"


_UNDISTURBED = {"periods", "sampling", "seed", "truth", "follows", "payload"}
"""Keys of the section `experiment` that are no disturbances."""


def disturbance_keys(section: ExperimentSection, drift: dict[str, Any] | None) -> dict[str, Any]:
    """Return the disturbances of a run by their keys, SI, None if off; `drift`: that was drawn."""
    found = section.model_dump(exclude=_UNDISTURBED) | {"drift": drift}
    off = (None, 0.0, (0.0,) * ACTUATORS, Delay().model_dump())
    return {name: None if value in off else value for name, value in found.items()}


@dataclass(frozen=True, eq=False)
class MachineKeys:
    """The machine that was measured, where it is not the run's robot."""

    __pydantic_config__ = ConfigDict(arbitrary_types_allowed=True)

    name: Annotated[str, described("", "of the machine")]
    terms: Annotated[tuple[Any, ...], described("", "of its model, with their constants")]
    base_joints: Annotated[Numbers, sized(ACTUATORS, 3), described("m", "6 × 3, base frame")]
    platform_joints: Annotated[
        Numbers, sized(ACTUATORS, 3), described("m", "6 × 3, platform frame")
    ]
    alpha_axes: Annotated[
        Numbers, sized(ACTUATORS, 3), described("1", "6 × 3, first cardan axes, base frame")
    ]
    gravity: Annotated[Numbers, sized(3), described("m/s^2", "base frame")]

    @classmethod
    def of(cls, robot: Robot) -> Self:
        """Describe a robot."""
        about = robot.description
        known = about.constants_by_term
        return cls(
            name=about.name,
            terms=tuple({name: own} if own else name for name, own in known.items()),
            base_joints=about.base_joints,
            platform_joints=about.platform_joints,
            alpha_axes=about.alpha_axes,
            gravity=about.gravity,
        )


@dataclass(frozen=True)
class SeedKeys:
    """Seeds of the random numbers."""

    experiment: Annotated[int, described("1", "of the draws that all repetitions share")]
    repetitions: Annotated[int, described("1", "of their noise, outliers, hum and lost samples")]


@dataclass(frozen=True, eq=False, kw_only=True)
class Truth(RunFile):
    """True values of a simulated experiment, the reference for estimates: `truth.json`.

    The motions begin at the first sample; `executed` is the design itself without tracking error.
    """

    FILE: ClassVar[str] = "truth.json"
    WRITTEN_BY: ClassVar[str] = _WRITTEN_BY
    machine: Annotated[
        MachineKeys | None,
        described("", "the machine that was measured; null: the robot itself"),
    ] = None
    parameters: Annotated[
        dict[str, float], described("SI", "true values by name, in the order of the regressor")
    ]
    payload: Annotated[
        dict[str, float] | None,
        described("SI", "share of the payload in p6 … Iyz (experiment.payload); null: none"),
    ] = None
    experiment: Annotated[ExperimentKeys, described("", "length and sampling")]
    design: Annotated[Motion, described("", "the motion that was commanded")]
    executed: Annotated[
        Motion,
        described("", "the motion that was made, as the robot's joints turn lengths into it"),
    ]
    force_covariance: Annotated[Covariance, described("N^2", "Σ of one sample, 6 × 6")]
    length_covariance: Annotated[Covariance, described("m^2", "Δ of one sample, 6 × 6")]
    force_spectrum: Annotated[
        dict[str, Any] | None,
        described("", "of the forces' noise, as the robot file states it; null: white"),
    ] = None
    length_spectrum: Annotated[
        dict[str, Any] | None, described("", "of the lengths' noise; null: white")
    ] = None
    table: Annotated[
        ExecutedTableTruth | None,
        described("", "the controller table that was executed; null for a design"),
    ] = None
    disturbances: Annotated[
        dict[str, Any],
        described("SI", "those of `experiment:` by their keys, drift with its final; null: off"),
    ]
    seeds: Annotated[SeedKeys, described("", "of the random numbers")]

    @property
    def disturbed_by(self) -> tuple[str, ...]:
        """Names of the disturbances that are on, in words."""
        return tuple(name.replace("_", " ") for name, given in self.disturbances.items() if given)

    @property
    def memory(self) -> str:
        """Colour of the noise in words: ``white``, or the channels with memory."""
        named = {"forces": self.force_spectrum, "lengths": self.length_spectrum}
        coloured = []
        for kind, spectrum in named.items():
            if spectrum is not None:
                forms = [_FORMS.get(key, key) for key, given in spectrum.items() if given]
                coloured.append(f"in the {kind} ({', '.join(forms)})")
        return f"with memory {' and '.join(coloured)}" if coloured else "white"

    def values_of(self, names: Iterable[str]) -> Array:
        """Return the true values of parameters, SI, in their order; zero for missing terms."""
        return np.array([self.parameters.get(name, 0.0) for name in names])


def write_truth(
    truth: Truth, folder: Path, configuration: RunConfiguration, *, repeated: bool
) -> list[Path]:
    """Write `truth.json` and `columns.json` next to the measurements; return their paths.

    `repeated`: the measurements are in `repetitions/`.
    """
    file = f"{REPETITIONS}/*/{MEASUREMENT.file}" if repeated else MEASUREMENT.file
    table = replace(MEASUREMENT, file=file, headings=headings(configuration))
    return [*truth.write(folder), describe_tables(folder, [table])]
