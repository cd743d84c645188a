"""Newport XPS: a PVT trajectory file, one row `dt, dP1, v1, …, dP6, v6` per element."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from itertools import chain, islice
from pathlib import Path

import numpy as np

from expdesign.configuration.export import PVT_OPTIONS, ExportSection
from expdesign.export.definition import (
    POSE_AXES,
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
    round_to_clock,
    switched_at,
    switching,
)
from expdesign.export.repetition import collect
from expdesign.export.text_table import (
    add_times,
    every_line,
    lines,
    numbers,
    refuse_motion_at_end,
    write_lines,
)
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names

_TIME_DIGITS = 8
_CELLS = 1 + 2 * ACTUATORS
_EVENTS = ".events.txt"
_EVENT = re.compile(
    r"EventExtendedConfigurationTriggerSet \(GROUP\.PVT\.ElementNumberStart, (\d{1,9}), 0, 0, 0\)\n"
    r"EventExtendedConfigurationActionSet \(GPIO1\.DO\.DOSet, (\d{1,3}), (\d{1,3}), 0, 0\)\n"
    r"EventExtendedStart \(int \*\)\n"
)


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    if settings.digits is None:
        raise ValueError("the table needs a number of digits")
    digits = settings.digits

    def lines_of(part: Rows) -> Iterator[str]:
        # Displacements are relative: those of rounded positions add up to rounded positions.
        moved = np.diff(np.round(part.position, digits), axis=0, prepend=part.position[:1])
        steps = np.diff(part.times, prepend=part.times[0])
        cells = np.stack([moved, part.velocities], axis=2).reshape(len(steps), -1)
        for step, row in zip(steps, cells, strict=True):
            yield ", ".join([f"{step:.{_TIME_DIGITS}f}", *settings.numbers(row)])

    # A line is the element that ends at its row: the start has none.
    write_lines(path, islice(every_line(rows, lines_of), 1, None))


def _events(rows: Rows, settings: Settings) -> list[str]:
    """Return the events that switch the output; element k of the trajectory ends at row k."""
    mask = _mask(settings)
    behind = switching(rows, settings, (f"{mask}", "0"))
    return [
        line
        for row, value in behind.items()
        for line in (
            "EventExtendedConfigurationTriggerSet "
            f"(GROUP.PVT.ElementNumberStart, {row + 1}, 0, 0, 0)",
            f"EventExtendedConfigurationActionSet (GPIO1.DO.DOSet, {mask}, {value}, 0, 0)",
            "EventExtendedStart (int *)",
        )
    ]


def _mask(settings: Settings) -> int:
    """Return the bit of the output, which are numbered from 1; 0 without one."""
    trigger = settings.section.trigger
    return 0 if trigger is None else 1 << (trigger - 1)


def _read_events(path: Path, settings: Settings) -> list[tuple[int, bool]]:
    """Return the rows after which the output is switched; none without an events file."""
    events = path.with_name(f"{path.stem}{_EVENTS}")
    if settings.section.trigger is None or not events.is_file():
        return []
    mask = _mask(settings)
    text = "".join(f"{line}\n" for line in lines(events))
    found = _EVENT.findall(text)
    values = [(int(bits), int(value)) for _, bits, value in found]
    if _EVENT.sub("", text) or values != [(mask, mask), (mask, 0)]:
        raise TableError(
            f"{events.name}: expected one event that switches the output on, and one off"
        )
    return [(int(element) - 1, value != "0") for element, _, value in found]


def _read(path: Path, settings: Settings) -> Rows:
    start = np.zeros((1, _CELLS))
    start[0, 1::2] = settings.start
    blocks = chain([start], numbers(lines(path), _CELLS, "cells", ","))
    ticks = 10**_TIME_DIGITS
    found = collect(add_times(blocks, ticks, ticks), settings)
    rows = found.rows(np.cumsum(found.values[:, 1::2], axis=0), found.values[:, 2::2])
    refuse_motion_at_end(rows.velocities[-1], rows.count - 1)
    return switched_at(_read_events(path, settings), rows)


class XpsOptions(ExportSection):
    """Options of a PVT trajectory of the XPS."""

    spaces = ("strut", "pose")
    shared = PVT_OPTIONS
    outputs = (1, 8)
    """GPIO1.DO."""


FORMAT = TableFormat(
    name="xps-pvt",
    title="Newport XPS, PVT trajectory",
    suffix=".trj",
    interpolation=Interpolation.CUBIC,
    write=_write,
    read=_read,
    options=XpsOptions,
    guide='{% extends "guides/xps-pvt.txt.j2" %}',
    clock="10 ns in the file; the controller's is not known",
    capacity="8 positioners",
    digits=8,
    axes={"strut": actuator_names("S"), "pose": POSE_AXES},
    repeats=True,
    written_times=partial(round_to_clock, ticks=10**_TIME_DIGITS),
    companions={_EVENTS: _events},
)
