"""`data:`, how a measured file maps to time, strut lengths and actuator forces."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from expdesign.configuration.base import Section
from expdesign.configuration.failure import refusal, shown
from expdesign.configuration.quantity import (
    Duration,
    ForceConstant,
    Number,
    unit_dimension,
)
from expdesign.configuration.scalars import FilledText, Text, known_key, one_of, one_or_six

LENGTH_CHANNELS = tuple(f"q{j}" for j in range(1, 7))
FORCE_CHANNELS = tuple(f"Q{j}" for j in range(1, 7))
CHANNELS = ("t", *LENGTH_CHANNELS, *FORCE_CHANNELS, "period")
"""Columns of a measurement; `period` is optional."""

GROUPS = ("t", "q", "Q")
TimeGrid = Literal["uniform", "stamped"]
DecimalMark = Literal[".", ","]

Channel = Annotated[str, BeforeValidator(known_key(CHANNELS, "channel"))]
UnitKey = Annotated[
    str,
    BeforeValidator(
        known_key((*GROUPS, *LENGTH_CHANNELS, *FORCE_CHANNELS), "channel or group of channels")
    ),
]

_ADMITTED = {"t": ("a duration",), "q": ("a length",), "Q": ("a force", "a current")}
_UNITS = {"t": "a unit of time", "q": "a unit of length", "Q": "a unit of force or of current"}


def _one_character(text: str) -> str:
    if len(text) != 1:
        raise refusal(f"{shown(text)} is not one character", "one character, such as ',' or '\\t'")
    return text


def _step_share(value: float) -> float:
    if not 0 < value < 0.5:  # noqa: PLR2004 - half a step confuses two samples
        raise refusal(f"{value:g} is no tolerance", "0 < time_tolerance < 0.5 (of a step)")
    return value


class Delay(Section):
    """By how much the channels lag behind their time stamps, s."""

    forces: Duration = 0.0
    lengths: Duration = 0.0


class DataSection(Section):
    """Where a measurement stands and how it is read.

    Attributes
    ----------
    file : str or None
        The measured file, relative to the run file; `--data` names another.
    columns : dict
        Channel (t, q1…q6, Q1…Q6, period) → name in the file. Default: the same names.
    units : dict
        Channel, or group t, q, Q → unit in the file. Default: SI.
    delimiter, decimal : str
        Between columns, and the decimal mark.
    force_constants : (6,) or None
        Force per ampere of the actuators, N/A, for files that hold currents.
    start : float or None
        Time of the trigger, s: rows before it are left out.
    end : float or None
        Time at which the measurement is over, s: rows from it on are left out.
    delay : Delay
    time : {"uniform", "stamped"}
        Uniform time is replaced by the fitted grid, stamps are used as they are.
    time_tolerance : float
        Largest deviation from uniform time, as a share of a step.
    """

    file: FilledText | None = None
    columns: dict[Channel, FilledText] = Field(default_factory=dict)
    units: dict[UnitKey, FilledText] = Field(default_factory=dict)
    delimiter: Annotated[Text, AfterValidator(_one_character)] = ","
    decimal: Annotated[DecimalMark, one_of(DecimalMark)] = "."
    force_constants: Annotated[tuple[ForceConstant, ...], one_or_six("force constants")] | None = (
        None
    )
    start: Duration | None = None
    end: Duration | None = None
    delay: Delay = Delay()
    time: Annotated[TimeGrid, one_of(TimeGrid)] = "uniform"
    time_tolerance: Annotated[Number, AfterValidator(_step_share)] = 0.01

    @model_validator(mode="after")
    def _marks_differ(self) -> DataSection:
        if self.delimiter == self.decimal:
            raise refusal(
                f"'{self.decimal}' is both delimiter and decimal mark",
                "two different characters",
                key="decimal",
            )
        return self

    @model_validator(mode="after")
    def _ends_after_its_start(self) -> DataSection:
        if self.end is not None and self.start is not None and self.end <= self.start:
            raise refusal(
                f"the end, {self.end:g} s, is not after the start, {self.start:g} s",
                "data.end later than data.start",
                key="end",
            )
        return self

    @model_validator(mode="after")
    def _units_fit(self) -> DataSection:
        for key, unit in self.units.items():
            dimension = unit_dimension(unit)
            if dimension is None or dimension.name not in _ADMITTED[key[0]]:
                raise refusal(f"'{unit}' is no unit for {key}", _UNITS[key[0]], key="units")
            if dimension.name == "a current" and self.force_constants is None:
                raise refusal(
                    f"{key} is a current, but no force_constants are given",
                    "force_constants: one value or six, in N/A",
                    key="units",
                )
        return self

    @model_validator(mode="after")
    def _columns_differ(self) -> DataSection:
        seen: dict[str, str] = {}
        for channel, column in self.columns.items():
            if column in seen:
                raise refusal(
                    f"column {shown(column)} is both {seen[column]} and {channel}",
                    "a column for each channel",
                    key="columns",
                )
            seen[column] = channel
        return self
