"""Physik Instrumente C-887: points of a wave table, one row of X Y Z U V W each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from expdesign.configuration.export import ExportSection
from expdesign.export.definition import (
    POSE_AXES,
    Guide,
    Interpolation,
    Rows,
    Settings,
    TableFormat,
)
from expdesign.export.text_table import every_line, lines, numbers, uniform_rows, write_lines


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    def lines_of(part: Rows) -> Iterator[str]:
        return ("\t".join(settings.numbers(row)) for row in part.position)

    write_lines(path, every_line(rows, lines_of))


def _read(path: Path, settings: Settings) -> Rows:
    return uniform_rows(numbers(lines(path), len(POSE_AXES), "coordinates"), settings)


class WaveTableOptions(ExportSection):
    """Options of a wave table of the C-887."""

    spaces = ("pose",)
    shared = ("digits", "units", "angles")


FORMAT = TableFormat(
    name="pi-wave",
    title="Physik Instrumente C-887, wave generator",
    suffix=".txt",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    options=WaveTableOptions,
    guide=Guide(
        before=(
            "Ask with `HLP?` whether the controller has WAV, WSL, WTR and WGO, and compare the "
            "rows with its capacity of points. Set the pivot point (SPI) to the TCP of the robot "
            "file. U, V, W are rotations about the moving axes x, y, z in this order."
        ),
        load=(
            "Write the columns into the wave tables 1 to 6 (WAV n X PNT 1 ROWS …) and connect "
            "them to the axes {axes}. A row lasts the wave table rate times the servo cycle: set "
            "the rate, without interpolation, so that this is exactly {step}; a cycle of which "
            "{step} is no multiple cannot run this table.\n\n"
            "    WSL 1 1 2 2 3 3 4 4 5 5 6 6"
        ),
        run=(
            "Move the hexapod to the start, which is the first row. Then set one cycle and start "
            "all generators together:\n\n"
            "    MOV {start}\n"
            "    WGC 1 1 2 1 3 1 4 1 5 1 6 1\n"
            "    WGO 1 1 2 1 3 1 4 1 5 1 6 1\n\n"
            "`STP` stops at once. More cycles repeat the whole table, from rest to rest."
        ),
        record="Tie an output to the points of the window with TWS: a point is a row.",
    ),
    clock="rate × servo cycle, the same for all rows",
    capacity="points of the wave tables, by controller",
    executed="a model of the interpolation",
    axes={"pose": POSE_AXES},
    repeats=True,
    uniform=True,
)
