"""LinuxCNC: strut lengths for `halstreamer`, one line per cycle of the servo thread."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import chain, islice
from pathlib import Path

from constraints.arrays import Array
from expdesign.configuration.export import STRUT_ONLY, ExportSection
from expdesign.export.definition import (
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
)
from expdesign.export.repetition import lead_files, read_looped, split_rows
from expdesign.export.text_table import (
    every_line,
    lines,
    mark_window,
    numbers,
    uniform_rows,
    write_lines,
)
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names
from expdesign.templates import text_templates


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    text: Iterator[str]
    if settings.section.looped:
        text = islice(_lines(split_rows(rows)[1], settings), 1, None)
    else:
        made = every_line(rows, partial(_lines, settings=settings))
        text = mark_window(made, rows, settings, "# {}")
    write_lines(path, chain(_head(settings), text))


def _lines(part: Rows, settings: Settings) -> Iterator[str]:
    return (" ".join(settings.numbers(row)) for row in part.position)


def _head(settings: Settings) -> list[str]:
    axes = f"{' '.join(settings.axes.names)} [{settings.axes.units[0]}]"
    return [f"# {settings.title}: {axes}", f"# one line every {settings.step!r} s"]


def _read(path: Path, settings: Settings) -> Rows:
    def read(file: Path) -> Iterator[Array]:
        text = _with_our_head(lines(file), settings)
        return numbers(text, ACTUATORS, "lengths", comment="#")

    looped = settings.section.looped
    return uniform_rows(read_looped(path, settings, read) if looped else read(path), settings)


def _with_our_head(text: Iterator[str], settings: Settings) -> Iterator[str]:
    """Yield the lines; refuse comments that state other axes, units or times than the export."""
    title, step = _head(settings)
    stated = {f"# {settings.title}: ": title, "# one line every ": step}
    for k, line in enumerate(text, start=1):
        if line.startswith("#"):
            for begin, own in stated.items():
                if line.startswith(begin) and line.rstrip() != own:
                    raise TableError(f"line {k}: '{line[:60]}' where the table says '{own}'")
        yield line


STREAMER_ENDING = ".streamer.hal"


def hal_lines(_rows: Rows, settings: Settings) -> list[str]:
    """Return the HAL file that adds a table to the commands of the joints.

    Until the first row, and whenever the table is at its start, the joints obey LinuxCNC alone. The
    first row is played in the cycle in which `table-run` is seen, so that no other value of the
    streamer's pins, which are 0 before, reaches the drives.
    """
    template = text_templates("expdesign.export").get_template("streamer.hal.j2")
    text = template.render(
        title=settings.title,
        step=settings.step,
        joints=range(ACTUATORS),
        offsets=[settings.number(-start) for start in settings.start],
    )
    return text.splitlines()


class HalstreamerOptions(ExportSection):
    """Options of strut lengths for halstreamer."""

    spaces = ("strut",)
    shared = ("digits", "units", *STRUT_ONLY, "repeat")


FORMAT = TableFormat(
    name="linuxcnc-strut",
    title="LinuxCNC, strut lengths for halstreamer",
    suffix=".txt",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    options=HalstreamerOptions,
    guide='{% extends "guides/linuxcnc-strut.txt.j2" %}',
    executed="halrun of LinuxCNC 2.9 ran these commands: every row in its cycle",
    companions={STREAMER_ENDING: hal_lines, **lead_files(".txt", _lines)},
    clock="one row every servo cycle",
    capacity="none: rows are streamed",
    axes={"strut": actuator_names("S")},
    repeats=True,
    uniform=True,
)
