"""`data:`: location and format of a recording."""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar

from pydantic import Discriminator, Field, Tag, model_validator

from expdesign.configuration.errors import quote, refusal, require
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
    Duration,
    ForceConstant,
    Number,
    Quantity,
    quantity_of_unit,
)
from expdesign.configuration.section import Section
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names

LENGTH_CHANNELS = actuator_names("q")
FORCE_CHANNELS = actuator_names("Q")
CHANNELS = ("t", *LENGTH_CHANNELS, *FORCE_CHANNELS, "period")
"""Columns of a recording; `period` is optional."""

TimeGrid = Literal["uniform", "stamped"]
DecimalMark = Literal[".", ","]

CHANNEL_UNITS: dict[str, tuple[str, tuple[Quantity, ...]]] = {
    "t": ("a unit of time", (DURATION,)),
    "q": ("a unit of length", (LENGTH,)),
    "Q": ("a unit of force or of current", (FORCE, CURRENT)),
}
"""Quantities of the channels in a group, with words for messages."""

_Channel = Annotated[str, one_of(CHANNELS, "channel")]
_Units = Annotated[
    str, one_of((*CHANNEL_UNITS, *LENGTH_CHANNELS, *FORCE_CHANNELS), "channel or group of channels")
]


_ONE_CHARACTER = require(
    lambda text: len(text) == 1,
    "{quoted} is not one character",
    "one character, such as ',' or '\\t'",
)
_STEP_SHARE = require(
    lambda value: 0 < value < 0.5,  # noqa: PLR2004 - half a step confuses two samples
    "{value:g} is not a tolerance",
    "0 < time_tolerance < 0.5 (of a step)",
)


class Delay(Section):
    """Delays of the channels against their time stamps, s."""

    forces: Duration = 0.0
    lengths: Duration = 0.0


class OrderOfChannels(Section):
    """Separate orders of the channels for lengths and forces."""

    q: Order | None = None
    Q: Order | None = None


class SignsOfChannels(Section):
    """Separate signs of the channels for lengths and forces."""

    q: Signs | None = None
    Q: Signs | None = None


class OffsetsOfChannels(Section):
    """Lengths, m, and forces, N, of the struts at readings of zero."""

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
"""One value for lengths and forces, or separate ones."""


class DataSection(Section):
    """Location and format of a recording."""

    file: FilledText | None = None
    """File of the recording, relative to the run file; `--data` overrides it."""
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
    order: _BothOrEach[Order, OrderOfChannels] | None = None
    """Number of the strut on each channel."""
    sign: _BothOrEach[Signs, SignsOfChannels] | None = None
    """Signs by the struts' numbers: length or force = sign · channel + offset."""
    offset: _BothOrEach[Offsets, OffsetsOfChannels] | None = None
    """Lengths of the struts at readings of zero, m; forces, N, in a mapping with the key Q."""
    start: Duration | None = None
    """Time of the trigger, s: earlier rows are ignored."""
    end: Duration | None = None
    """End of the measurement, s: rows from then on are ignored."""
    delay: Delay = Delay()
    time: Annotated[TimeGrid, one_of(TimeGrid)] = "uniform"
    """Uniform time is replaced by the fitted grid, stamps are used as they are."""
    time_tolerance: Annotated[Number, _STEP_SHARE] = 0.01
    """Largest deviation from uniform time, as a share of a step."""

    @model_validator(mode="after")
    def _check_combination(self) -> DataSection:
        if self.delimiter == self.decimal:
            message = f"'{self.decimal}' is both delimiter and decimal mark"
            raise refusal(message, "two different characters", key="decimal")
        if self.end is not None and self.start is not None and self.end <= self.start:
            message = f"the end, {self.end:g} s, is not after the start, {self.start:g} s"
            raise refusal(message, "data.end later than data.start", key="end")
        for column in self.columns.values():
            channels = [channel for channel, name in self.columns.items() if name == column]
            if len(channels) > 1:
                message = f"column {quote(column)} is both {' and '.join(channels)}"
                raise refusal(message, "a column for each channel", key="columns")
        for key, unit in self.units.items():
            allowed, dimensions = CHANNEL_UNITS[key[0]]
            dimension = quantity_of_unit(unit)
            if dimension not in dimensions:
                raise refusal(f"'{unit}' is not a unit for {key}", allowed, key="units")
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
        """Lengths of the struts at readings of zero, m; ``"home"``: their lengths at home."""
        found = self.offset.q if isinstance(self.offset, OffsetsOfChannels) else self.offset
        return found or (0.0,) * ACTUATORS

    @property
    def force_offsets(self) -> tuple[float, ...]:
        """Forces of the struts at readings of zero, N."""
        found = self.offset.Q if isinstance(self.offset, OffsetsOfChannels) else None
        return found or (0.0,) * ACTUATORS
