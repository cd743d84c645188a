"""Galil DMC: a program in contour mode, one line `CD` of whole counts per step of time."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import chain, islice
from pathlib import Path

import numpy as np
from pydantic import model_validator

from constraints.arrays import Array
from expdesign.configuration.errors import refusal
from expdesign.configuration.export import STRUT_ONLY, ExportSection
from expdesign.export.definition import (
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
)
from expdesign.export.text_table import every_line, lines, numbers, uniform_rows, write_lines
from expdesign.mechanism.hexapod import ACTUATORS

_AXES = ("A", "B", "C", "D", "E", "F")
_UPDATES = range(125, 2001, 125)
"""Times of a servo update that `TM` takes, µs."""
_MOST_DOUBLINGS = 8
_END = "CD 0,0,0,0,0,0=0"


def _clock(settings: Settings) -> tuple[int, int]:
    """Return TM, µs, and DT of a step: it lasts 2^DT updates of TM; the TM closest to 1 ms."""
    step = 1e6 * (settings.step or 0.0)
    found = [
        (update, doublings)
        for doublings in range(_MOST_DOUBLINGS + 1)
        for update in _UPDATES
        if abs(update * 2**doublings - step) < 1e-6 * step
    ]
    if not found:
        raise TableError(
            f"a step of {step / 1e3:g} ms is not 2^n servo updates of n × 0.125 ms: choose a "
            "segment of 1, 2, 4, 5, 8 or 10 ms"
        )
    return min(found, key=lambda one: abs(np.log(one[0] / 1000)))


def _head(settings: Settings) -> list[str]:
    update, doublings = _clock(settings)
    start = ",".join(settings.numbers(settings.start))
    return [
        f"' start: {start} {settings.axes.units[0]}",
        f"TM {update}",
        f"CM {''.join(_AXES)}",
        f"DT {doublings}",
    ]


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    def lines_of(part: Rows) -> Iterator[str]:
        moved = np.diff(np.round(part.position), axis=0, prepend=np.round(part.position[:1]))
        return ("CD " + ",".join(settings.numbers(row)) for row in moved)

    # A line is the step that ends at its row: the start has none.
    steps = islice(every_line(rows, lines_of), 1, None)
    write_lines(path, chain(_head(settings), steps, [_END, "EN"]))


def _read(path: Path, settings: Settings) -> Rows:
    head = _head(settings)
    text = lines(path)
    if [line.rstrip("\n") for line in islice(text, len(head))] != head:
        raise TableError(f"the file does not begin with {'; '.join(head[1:])} and the start")
    ended = False

    def increments() -> Iterator[str]:
        nonlocal ended
        for line in text:
            if line.strip() == _END:
                ended = [rest.strip() for rest in text] == ["EN"]
                return
            if not (match := re.fullmatch(r"CD (.*)", line.strip())):
                raise TableError(f"'{line.strip()}' is not a line of contour data")
            yield match[1]

    def positions() -> Iterator[Array]:
        position = settings.start
        yield position[None]
        for block in numbers(increments(), ACTUATORS, "increments", ",", first=len(head) + 1):
            if np.any(block != np.rint(block)):
                raise TableError("an increment is not a whole number of counts")
            found = position + np.cumsum(block, axis=0)
            position = found[-1]
            yield found

    rows = uniform_rows(positions(), settings)
    if not ended:
        raise TableError(f"the file does not end in {_END} and EN")
    return rows


class GalilOptions(ExportSection):
    """Options of a program in contour mode."""

    spaces = ("strut",)
    shared = STRUT_ONLY

    @model_validator(mode="after")
    def _check_counts(self) -> GalilOptions:
        if self.length_unit is None:
            message = "increments are whole counts: counts_per_metre is missing"
            allowed = "counts of the encoder per metre of the strut, or counts_per_revolution"
            raise refusal(message, allowed)
        return self


def _guide_values(settings: Settings) -> Mapping[str, str]:
    update, doublings = _clock(settings)
    return {"update": f"TM {update}", "doublings": f"DT {doublings}"}


FORMAT = TableFormat(
    name="galil-contour",
    title="Galil DMC, contour mode",
    suffix=".dmc",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    options=GalilOptions,
    guide='{% extends "guides/galil-contour.txt.j2" %}',
    guide_values=_guide_values,
    clock="2ⁿ servo updates (TM, DT), the same for all rows",
    capacity="lines of the program memory, by controller",
    count_digits=0,
    axes={"strut": _AXES},
    repeats=True,
    uniform=True,
)
