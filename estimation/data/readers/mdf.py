"""MDF 4 (and 3) recordings of measurement systems, ASAM."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from constraints.arrays import Array
from estimation.data.formats import FileFormat
from estimation.data.table import (
    NUMERIC,
    OPTIONAL,
    FileContent,
    RawTable,
    RecordedColumn,
    pick_columns,
    refuse_long,
)
from expdesign.configuration import DataSection, InputError, Problem

_MASTER = "time stamps"


def read(path: Path, section: DataSection) -> RawTable:
    """Read channels by their names; time is that of their group unless `columns` names a channel.

    A name in several groups is qualified by the group's number from zero: ``2/q1``.

    Raises
    ------
    InputError
        Channels are missing, or have been recorded at different times.
    """
    signals: dict[str, Any] = {}
    with import_module("asammdf").MDF(path) as file:
        columns = pick_columns(
            list(_columns(file)),
            section.columns,
            path,
            optional=OPTIONAL | {"t"},
            channels=section.channels,
        )
        if "t" not in section.columns:
            columns.pop("t", None)
        for channel, column in columns.items():
            group, index = column.place
            refuse_long(int(file.groups[group].channel_group.cycles_nr), path)
            signals[channel] = file.get(group=group, index=index, ignore_invalidation_bits=True)
    _refuse_other_times(signals, columns, path)
    values: dict[str, Array] = {}
    texts: dict[tuple[str, int], str] = {}
    if "t" not in signals:
        columns["t"] = RecordedColumn(_MASTER, _MASTER, unit="s")
        values["t"] = np.asarray(next(iter(signals.values())).timestamps, dtype=np.float64)
    for channel, signal in signals.items():
        samples = signal.samples
        if samples.dtype.kind in NUMERIC and samples.ndim == 1:
            # Nanoseconds since 1970 are exact as integers only, which cannot be NaN.
            exact = channel == "t" and signal.invalidation_bits is None
            values[channel] = samples if exact else samples.astype(np.float64)
        else:
            values[channel] = np.full(len(samples), np.nan)
            texts |= {(channel, row): _text(item) for row, item in enumerate(samples)}
        if signal.invalidation_bits is not None:
            invalid = np.asarray(signal.invalidation_bits, dtype=bool)
            values[channel][invalid] = np.nan
            texts |= {(channel, int(row)): "marked invalid" for row in np.flatnonzero(invalid)}
    return RawTable(path, values, columns, texts=texts)


def list_channels(path: Path) -> FileContent:
    """List the channels of a file."""
    with import_module("asammdf").MDF(path) as file:
        return FileContent(list(_columns(file)), has_time=True)


def _columns(file: Any) -> Iterator[RecordedColumn]:
    for name, places in file.channels_db.items():
        for group, index in dict.fromkeys(places):
            text = name if len(places) == 1 else f"{group}/{name}"
            unit = str(file.get_channel_unit(group=group, index=index)).strip() or None
            yield RecordedColumn(text, (group, index), name=name, unit=unit)


def _refuse_other_times(
    signals: Mapping[str, Any], columns: Mapping[str, RecordedColumn], path: Path
) -> None:
    first, *others = signals
    times = signals[first].timestamps
    problems = [
        Problem(
            f"the channel was recorded at other times ({len(signals[channel].timestamps)} samples) "
            f"than '{columns[first].label}' ({len(times)} samples)",
            path,
            key=columns[channel].label,
            allowed="channels with the same time stamps: resample the file before",
        )
        for channel in others
        if not np.array_equal(signals[channel].timestamps, times)
    ]
    if problems:
        raise InputError(problems)


def _text(item: Any) -> str:
    return item.decode("utf-8", "replace") if isinstance(item, bytes) else str(item)


FORMATS = (
    FileFormat(
        "MDF 4",
        (".mf4", ".mdf"),
        read,
        "asammdf",
        "mdf",
        may_crash=True,
        list_columns=list_channels,
    ),
)
