"""Physik Instrumente C-887: points of a wave table, one row of X Y Z U V W each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from expdesign.configuration.export import ExportSection
from expdesign.export.definition import (
    POSE_AXES,
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
    guide='{% extends "guides/pi-wave.txt.j2" %}',
    clock="rate × servo cycle, the same for all rows",
    capacity="points of the wave tables, by controller",
    executed="a model of the interpolation",
    axes={"pose": POSE_AXES},
    repeats=True,
    uniform=True,
)
