"""Time columns that count from a date: numbers since an epoch, and stamps of ISO 8601.

Both are exact before the first row is subtracted: a double of the nanoseconds since 1970 has steps
of 256 ns.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array

EARLIEST = 1e8
"""First time, in the file's unit and in s, from which on a column counts from a date: 1973."""
_UNITS = ((1e11, "s"), (1e14, "ms"), (1e17, "us"), (np.inf, "ns"))
"""Units of the time since 1970, with the number that no date of this and the next eon reaches."""
_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_SLOWEST = 0.5
"""s. No machine is sampled once in half a second."""
_LARGEST = 1e25
_STAMP = re.compile(
    r"(?P<date>\d{4}-\d\d-\d\d[T ])?([01]\d|2[0-3]):[0-5]\d(:[0-5]\d([.,]\d+)?)?"
    r"\s?(?P<zone>Z|[+-]\d\d:?\d\d)?"
)
EXAMPLE = "2026-11-27T10:15:00.123Z"


def epoch_unit(first: float, step: float) -> str | None:
    """Return the unit of times since 1970 by the first one and their step; None if none fits both.

    Examples
    --------
    >>> epoch_unit(1764212345.5, 0.001), epoch_unit(1764212345123, 1), epoch_unit(2.5e9, 1000)
    ('s', 'ms', None)
    """
    unit = next(unit for end, unit in _UNITS if first < end)
    return unit if step * _SECONDS[unit] < _SLOWEST else None


def median_step(times: Array) -> float:
    """Return the median step of the finite times; 0 without two of them."""
    steps = np.diff(times[np.isfinite(times)])
    return float(np.median(steps)) if len(steps) else 0.0


def is_stamp(text: str) -> bool:
    """Return whether a text is a date with a time, or a time of day, of ISO 8601.

    Examples
    --------
    >>> is_stamp("2026-11-27 10:15:00,25+01:00"), is_stamp("27.11.2026 10:15")
    (True, False)
    """
    return _form(text) is not None


def _form(text: str) -> tuple[bool, bool] | None:
    """Return whether a stamp has a date and a zone, None for another text."""
    found = _STAMP.fullmatch(text.strip())
    return None if found is None else (bool(found["date"]), bool(found["zone"]))


def count_from_first(values: NDArray[Any]) -> tuple[Array, float]:
    """Return times (T,) from the first finite one on if they count from a date, and the first.

    Other times are returned as floats, with 0.
    """
    if values.dtype.kind == "u":
        values = values.astype(np.int64)
    finite = values[np.isfinite(values)]
    if not len(finite) or finite[0] < EARLIEST:
        return np.ascontiguousarray(values, dtype=np.float64), 0.0
    return (values - finite[0]).astype(np.float64), float(finite[0])


@dataclass
class TimeCells:
    """Reader of the texts of a time column that counts from a date, block after block."""

    form: tuple[bool, bool] | None
    """Form of stamps of ISO 8601, in s, the same in all cells; None for numbers, in the file's
    unit."""
    first: Any = None
    """Time of the first cell: integer nanoseconds, or a decimal number."""

    @classmethod
    def starting_with(cls, text: str) -> TimeCells | None:
        """Return the reader for a column by its first cell; None for an ordinary number."""
        form, number = _form(text), _decimal(text)
        dated = form is not None or (number is not None and number >= EARLIEST)
        return cls(form) if dated else None

    @property
    def stamps(self) -> bool:
        """Whether the cells are stamps of ISO 8601."""
        return self.form is not None

    @property
    def origin(self) -> float:
        """Time of the first cell in the file's unit, of stamps in s, also of a time of day."""
        if self.first is None:
            return 0.0
        return float(self.first) * (1e-9 if self.stamps else 1.0)

    def read(self, cells: Sequence[str]) -> Array:
        """Return times (T,) from the first one on; NaN for a cell without a time."""
        if self.stamps:
            return self._read_stamps(cells)
        numbers = [_decimal(cell) for cell in cells]
        if self.first is None:
            self.first = next((number for number in numbers if number is not None), None)
        return np.array([np.nan if one is None else float(one - self.first) for one in numbers])

    def _read_stamps(self, cells: Sequence[str]) -> Array:
        pandas = import_module("pandas")  # slow to load
        texts = [text if _form(text := cell.strip()) == self.form else "" for cell in cells]
        texts = [f"1970-01-01 {text}" if text[2:3] == ":" else text for text in texts]
        plain = [text.replace(",", ".") for text in texts]
        read = pandas.to_datetime(plain, format="ISO8601", utc=True, errors="coerce")
        found = pandas.DatetimeIndex(read)
        valid, times = ~found.isna(), found.as_unit("ns").asi8
        if self.first is None and valid.any():
            self.first = times[valid][0]
        seconds = np.full(len(times), np.nan)
        seconds[valid] = (times[valid] - self.first) * 1e-9
        return seconds


def _decimal(text: str) -> Decimal | None:
    """Return the exact number of a cell, None without a finite one."""
    try:
        number = Decimal(text.strip().replace(",", "."))
    except InvalidOperation:
        return None
    usable = number.is_finite() and abs(number) < _LARGEST and "_" not in text
    return number if usable else None
