"""LinuxCNC: strut lengths for `halstreamer`, one line per cycle of the servo thread."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from expdesign.configuration.export import STRUT_AXES, ExportSection
from expdesign.export.definition import (
    Guide,
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
)
from expdesign.export.text_table import (
    every_line,
    lines,
    mark_window,
    numbers,
    uniform_rows,
    write_lines,
)
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    def lines_of(part: Rows) -> Iterator[str]:
        return (" ".join(settings.numbers(row)) for row in part.position)

    text = mark_window(every_line(rows, lines_of), rows, settings, "# {}")
    write_lines(path, chain(_head(settings), text))


def _head(settings: Settings) -> list[str]:
    axes = f"{' '.join(settings.axes.names)} [{settings.axes.units[0]}]"
    return [f"# {settings.title}: {axes}", f"# one line every {settings.step!r} s"]


def _read(path: Path, settings: Settings) -> Rows:
    text = _with_our_head(lines(path), settings)
    return uniform_rows(numbers(text, ACTUATORS, "lengths", comment="#"), settings)


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


class HalstreamerOptions(ExportSection):
    """Options of strut lengths for halstreamer."""

    spaces = ("strut",)
    shared = ("digits", "units", *STRUT_AXES, "counts_per_metre")


FORMAT = TableFormat(
    name="linuxcnc-strut",
    title="LinuxCNC, strut lengths for halstreamer",
    suffix=".txt",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    options=HalstreamerOptions,
    guide=Guide(
        before="The period of the servo thread has to be {step}; no kinematics is needed.",
        load=(
            "Load the streamer with `loadrt streamer depth=4000 cfg=ffffff`, add it to the servo "
            "thread and connect its pins 0 to 5 to the position commands of {axes}."
        ),
        run=(
            "Move the struts to the start below and feed the file with `halstreamer {file}`. One "
            "line is taken every period of the servo thread."
        ),
    ),
    clock="one row every servo cycle",
    capacity="none: rows are streamed",
    axes={"strut": actuator_names("S")},
    repeats=True,
    uniform=True,
)
