"""`data:`, `estimate:` and `montecarlo:`, from a measured file to parameters."""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

from pydantic import Discriminator, Field, Tag, model_validator

from expdesign.configuration.errors import refusal, require, shown
from expdesign.configuration.fields import (
    FilledText,
    ForceOffsets,
    Offsets,
    Order,
    Signs,
    Text,
    one_of,
    per_strut,
)
from expdesign.configuration.quantity import (
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
from expdesign.configuration.section import LATER, Section
from expdesign.mechanism.hexapod import ACTUATORS, numbered

LENGTH_CHANNELS = numbered("q")
FORCE_CHANNELS = numbered("Q")
CHANNELS = ("t", *LENGTH_CHANNELS, *FORCE_CHANNELS, "period")
"""Columns of a measurement; `period` is optional."""

TimeGrid = Literal["uniform", "stamped"]
DecimalMark = Literal[".", ","]

CHANNEL_UNITS: dict[str, tuple[str, tuple[Dimension, ...]]] = {
    "t": ("a unit of time", (DURATION,)),
    "q": ("a unit of length", (LENGTH,)),
    "Q": ("a unit of force or of current", (FORCE, CURRENT)),
}
"""Units that the channels of a group may have."""

_Channel = Annotated[str, one_of(CHANNELS, "channel")]
_Units = Annotated[
    str, one_of((*CHANNEL_UNITS, *LENGTH_CHANNELS, *FORCE_CHANNELS), "channel or group of channels")
]


_ONE_CHARACTER = require(
    lambda text: len(text) == 1,
    "{shown} is not one character",
    "one character, such as ',' or '\\t'",
)
_STEP_SHARE = require(
    lambda value: 0 < value < 0.5,  # noqa: PLR2004 - half a step confuses two samples
    "{value:g} is no tolerance",
    "0 < time_tolerance < 0.5 (of a step)",
)


class Delay(Section):
    """By how much the channels lag behind their time stamps, s."""

    forces: Duration = 0.0
    lengths: Duration = 0.0


class OrderOfChannels(Section):
    """Order of the channels where those of lengths and forces are not in the same one."""

    q: Order | None = None
    Q: Order | None = None


class SignsOfChannels(Section):
    """Signs of the channels where those of lengths and forces are not the same."""

    q: Signs | None = None
    Q: Signs | None = None


class OffsetsOfChannels(Section):
    """What a channel's strut has where the channel reads zero, m and N."""

    q: Offsets | None = None
    Q: ForceOffsets | None = None


def _both_or_each(value: object) -> str:
    return "(inline)" if isinstance(value, dict | Section) else "(name)"


_Both = TypeVar("_Both")
_Each = TypeVar("_Each")
_BothOrEach = Annotated[
    Annotated[_Both, Tag("(name)")] | Annotated[_Each, Tag("(inline)")],
    Discriminator(_both_or_each),
]
"""One for lengths and forces, or each of them its own."""


class DataSection(Section):
    """Where a measurement stands and how it is read."""

    file: FilledText | None = None
    """The measured file, relative to the run file; `--data` names another."""
    columns: dict[_Channel, FilledText] = Field(default_factory=dict)
    """Channel (t, q1 …, Q1 …, period) → name in the file. Default: the same names."""
    units: dict[_Units, FilledText] = Field(default_factory=dict)
    """Channel, or group t, q, Q → unit in the file. Default: SI."""
    delimiter: Annotated[Text, _ONE_CHARACTER] = ","
    decimal: Annotated[DecimalMark, one_of(DecimalMark)] = "."
    force_constants: Annotated[tuple[ForceConstant, ...], per_strut("force constants")] | None = (
        None
    )
    """Force per ampere of the actuators, N/A, for files that hold currents."""
    order: Annotated[_BothOrEach[Order, OrderOfChannels] | None, LATER] = None
    """Number of the strut on each channel."""
    sign: Annotated[_BothOrEach[Signs, SignsOfChannels] | None, LATER] = None
    """Of the struts by their number: length or force = sign · channel + offset."""
    offset: Annotated[_BothOrEach[Offsets, OffsetsOfChannels] | None, LATER] = None
    """Length, m, at which the channel of a strut reads zero; of forces, N, by their group only."""
    start: Duration | None = None
    """Time of the trigger, s: rows before it are left out."""
    end: Duration | None = None
    """Time at which the measurement is over, s: rows from it on are left out."""
    delay: Delay = Delay()
    time: Annotated[TimeGrid, one_of(TimeGrid)] = "uniform"
    """Uniform time is replaced by the fitted grid, stamps are used as they are."""
    time_tolerance: Annotated[Number, _STEP_SHARE] = 0.01
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
        for key, unit in self.units.items():
            allowed, dimensions = CHANNEL_UNITS[key[0]]
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

    def channel_order(self, group: str) -> tuple[int, ...]:
        """Return the strut, from 1, on each of the six channels of a group, ``q`` or ``Q``."""
        found = getattr(self.order, group) if isinstance(self.order, Section) else self.order
        return found or tuple(range(1, ACTUATORS + 1))

    def channel_signs(self, group: str) -> tuple[int, ...]:
        """Return the signs of the struts' channels in a group."""
        found = getattr(self.sign, group) if isinstance(self.sign, Section) else self.sign
        return found or (1,) * ACTUATORS

    @property
    def length_offsets(self) -> tuple[float, ...] | Literal["home"]:
        """Lengths of the struts at which their channels read zero, m, or at home."""
        found = self.offset.q if isinstance(self.offset, OffsetsOfChannels) else self.offset
        return found or (0.0,) * ACTUATORS

    @property
    def force_offsets(self) -> tuple[float, ...]:
        """Forces of the struts at which their channels read zero, N."""
        found = self.offset.Q if isinstance(self.offset, OffsetsOfChannels) else None
        return found or (0.0,) * ACTUATORS
