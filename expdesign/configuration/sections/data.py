"""`data:`, how a measured file maps to time, strut lengths and actuator forces."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from expdesign.configuration.problem import refusal, shown
from expdesign.configuration.section import Section
from expdesign.configuration.values.lists import per_strut
from expdesign.configuration.values.quantity import (
    CURRENT,
    DURATION,
    FORCE,
    LENGTH,
    Dimension,
    Duration,
    ForceConstant,
    Number,
    unit_dimension,
)
from expdesign.configuration.values.scalars import FilledText, Text, one_of
from expdesign.mechanism.hexapod import numbered

LENGTH_CHANNELS = numbered("q")
FORCE_CHANNELS = numbered("Q")
CHANNELS = ("t", *LENGTH_CHANNELS, *FORCE_CHANNELS, "period")
"""Columns of a measurement; `period` is optional."""

TimeGrid = Literal["uniform", "stamped"]
DecimalMark = Literal[".", ","]

_GROUPS: dict[str, tuple[str, tuple[Dimension, ...]]] = {
    "t": ("a unit of time", (DURATION,)),
    "q": ("a unit of length", (LENGTH,)),
    "Q": ("a unit of force or of current", (FORCE, CURRENT)),
}
"""Units that the channels of a group may have."""

_Channel = Annotated[str, one_of(CHANNELS, "channel")]
_Units = Annotated[
    str, one_of((*_GROUPS, *LENGTH_CHANNELS, *FORCE_CHANNELS), "channel or group of channels")
]


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
    """Where a measurement stands and how it is read."""

    file: FilledText | None = None
    """The measured file, relative to the run file; `--data` names another."""
    columns: dict[_Channel, FilledText] = Field(default_factory=dict)
    """Channel (t, q1 …, Q1 …, period) → name in the file. Default: the same names."""
    units: dict[_Units, FilledText] = Field(default_factory=dict)
    """Channel, or group t, q, Q → unit in the file. Default: SI."""
    delimiter: Annotated[Text, AfterValidator(_one_character)] = ","
    decimal: Annotated[DecimalMark, one_of(DecimalMark)] = "."
    force_constants: Annotated[tuple[ForceConstant, ...], per_strut("force constants")] | None = (
        None
    )
    """Force per ampere of the actuators, N/A, for files that hold currents."""
    start: Duration | None = None
    """Time of the trigger, s: rows before it are left out."""
    end: Duration | None = None
    """Time at which the measurement is over, s: rows from it on are left out."""
    delay: Delay = Delay()
    time: Annotated[TimeGrid, one_of(TimeGrid)] = "uniform"
    """Uniform time is replaced by the fitted grid, stamps are used as they are."""
    time_tolerance: Annotated[Number, AfterValidator(_step_share)] = 0.01
    """Largest deviation from uniform time, as a share of a step."""

    @model_validator(mode="after")
    def _keys_fit_each_other(self) -> DataSection:
        if self.delimiter == self.decimal:
            message = f"'{self.decimal}' is both delimiter and decimal mark"
            raise refusal(message, "two different characters", key="decimal")
        if self.end is not None and self.start is not None and self.end <= self.start:
            message = f"the end, {self.end:g} s, is not after the start, {self.start:g} s"
            raise refusal(message, "data.end later than data.start", key="end")
        for column in self.columns.values():
            channels = [channel for channel, name in self.columns.items() if name == column]
            if len(channels) > 1:
                message = f"column {shown(column)} is both {' and '.join(channels)}"
                raise refusal(message, "a column for each channel", key="columns")
        return self

    @model_validator(mode="after")
    def _units_fit(self) -> DataSection:
        for key, unit in self.units.items():
            allowed, dimensions = _GROUPS[key[0]]
            dimension = unit_dimension(unit)
            if dimension not in dimensions:
                raise refusal(f"'{unit}' is no unit for {key}", allowed, key="units")
            if dimension is CURRENT and self.force_constants is None:
                raise refusal(
                    f"{key} is a current, but no force_constants are given",
                    "force_constants: one value, or one for each actuator, in N/A",
                    key="units",
                )
        return self
