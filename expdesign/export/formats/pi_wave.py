"""Physik Instrumente C-887: points of a wave table, one row of X Y Z U V W each."""

from __future__ import annotations

from pathlib import Path

from expdesign.configuration.sections.export import ExportSection
from expdesign.export.definition import POSE_AXES, Interpolation, Rows, Settings, TableFormat
from expdesign.export.text_table import lines, numbers, uniform_rows, write_lines


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    write_lines(path, ("\t".join(settings.numbers(row)) for row in rows.position))


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
    guide=(
        "Load the columns into wave tables 1 to 6 (WAV … PNT) and connect them with WSL to the "
        "axes {axes}. Set the wave table rate (WTR) so that a row lasts {step}, which is the "
        "rate times the servo cycle. Move the hexapod to the start below, which is the first "
        "row, then start the generator once (WGO with one cycle, WGC 1). U, V, W are rotations "
        "about the moving axes x, y, z in this order; the pivot point is the TCP of the robot "
        "file."
    ),
    axes={"pose": POSE_AXES},
    uniform=True,
)
