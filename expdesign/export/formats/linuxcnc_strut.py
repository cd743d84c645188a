"""LinuxCNC: strut lengths for `halstreamer`, one line per cycle of the servo thread."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from expdesign.configuration.export import STRUT_AXES, ExportSection
from expdesign.export.definition import Guide, Interpolation, Rows, Settings, TableFormat
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
    head = [
        f"# {settings.title}: {' '.join(settings.axes.names)} [{settings.axes.units[0]}]",
        f"# one line every {settings.step!r} s",
    ]

    def lines_of(part: Rows) -> Iterator[str]:
        return (" ".join(settings.numbers(row)) for row in part.position)

    text = mark_window(every_line(rows, lines_of), rows, settings, "# {}")
    write_lines(path, chain(head, text))


def _read(path: Path, settings: Settings) -> Rows:
    return uniform_rows(numbers(lines(path), ACTUATORS, "lengths", comment="#"), settings)


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
