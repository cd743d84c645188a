"""LinuxCNC: strut lengths for `halstreamer`, one line per cycle of the servo thread."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from expdesign.export.definition import Settings, TableFormat
from expdesign.export.interpolation import Interpolation
from expdesign.export.rows import Rows, TableError, in_window
from expdesign.export.text_table import lines, numbers


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    if settings.step is None:
        raise ValueError("the table needs a step")
    inside = in_window(rows.times, settings.window)
    text = [
        f"# {settings.name}: {' '.join(settings.axes.names)} [{settings.axes.units[0]}]",
        f"# one line every {settings.step!r} s",
    ]
    for k, row in enumerate(rows.position):
        if inside[k] and (k == 0 or not inside[k - 1]):
            text.append("# measurement window begins")
        text.append(" ".join(settings.number(value) for value in row))
        if inside[k] and (k + 1 == len(inside) or not inside[k + 1]):
            text.append("# measurement window ends")
    path.write_text("\n".join(text) + "\n", encoding="ascii")


def _read(path: Path, settings: Settings) -> Rows:
    if settings.step is None:
        raise ValueError("the table needs a step")
    table = []
    for k, line in enumerate(lines(path), start=1):
        code = line.partition("#")[0].strip()
        if code:
            table.append(numbers(code.split(), 6, k, "lengths"))
    if not table:
        raise TableError("the table has no rows")
    return Rows(
        np.multiply(settings.step, range(len(table)), dtype=np.float64), np.array(table)
    ).checked()


FORMAT = TableFormat(
    name="linuxcnc-strut",
    title="LinuxCNC, strut lengths for halstreamer",
    suffix=".txt",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    guide=(
        "Load the streamer with `loadrt streamer cfg=ffffff`, add it to the servo thread, whose "
        "period has to be {step}, and connect its pins 0 to 5 to the position commands of "
        "{axes}. Move the struts to the start below and feed the file with "
        "`halstreamer {file}`. One line is taken every period of the servo thread; "
        "no kinematics is needed."
    ),
    axes={"strut": tuple(f"S{j}" for j in range(1, 7))},
    uniform=True,
)
