"""LinuxCNC: strut lengths for `halstreamer`, one line per cycle of the servo thread."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import chain, islice
from pathlib import Path

from constraints.arrays import Array
from expdesign.configuration.export import STRUT_ONLY, ExportSection
from expdesign.export.definition import (
    Guide,
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
)
from expdesign.export.repetition import LEAD_IN, LEAD_OUT, lead_files, read_looped, split_rows
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


def _feed(settings: Settings) -> dict[str, str]:
    """Return the command that feeds the streamer."""
    if not settings.section.looped:
        return {"feed": "halstreamer {file}"}
    files = f"cat {{stem}}{LEAD_IN}.txt; for k in $(seq {settings.task.motion.periods}); "
    files += f"do cat {{file}}; done; cat {{stem}}{LEAD_OUT}.txt"
    return {"feed": f"({files}) | halstreamer"}


FORMAT = TableFormat(
    name="linuxcnc-strut",
    title="LinuxCNC, strut lengths for halstreamer",
    suffix=".txt",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    options=HalstreamerOptions,
    guide=Guide(
        before=(
            "The period of the servo thread has to be {step}; no kinematics is needed. The HAL "
            "file {stem}.streamer.hal adds the rows to the motor commands of joints 0 to 5, in the "
            "units of the joints: {axes} have to be joints 0 to 5 with the sign and the unit of "
            "the table. LinuxCNC keeps the command of the joints, with its own moves to the start "
            "and its emergency stop, which stops the table, too. It does not see the table as a "
            "following error, and its limits of the joints do not hold for the rows.\n\n"
            "In a copy of the machine's HAL files, remove the connections of "
            "joint.N.motor-pos-cmd, joint.N.motor-pos-fb and motion.motion-enabled, load the file "
            "after motmod and before the functions of the drives are added, as one of the HALFILEs "
            "of the INI file or with\n\n"
            "    halcmd -f {stem}.streamer.hal\n\n"
            "and connect table-cmd-N.out to the command of drive N, and its measured position to "
            "table-fb-N.in0. Until the first row the drives get what LinuxCNC commands."
        ),
        load=(
            "Home the machine and move it to the start above by jogging or MDI, and leave it "
            "there. Fill the streamer; the table does not begin yet:\n\n"
            "    {feed} &\n\n"
            "    halcmd getp streamer.0.curr-depth\n\n"
            "The depth has to be 3999 or, of a shorter table, the number of rows."
        ),
        run=(
            "Start the table:\n\n"
            "    halcmd sets table-run 1\n\n"
            "One row is played in every period of the servo thread. Watch how many were, which "
            "has to be the number of rows at the end:\n\n"
            "    halcmd getp table-rows.out\n\n"
            "streamer.0.underruns counts every cycle without a row, after the last one too: it "
            "proves nothing. To stop in between, press the emergency stop; the next command stops "
            "the struts where they are, in one cycle:\n\n"
            "    halcmd sets table-run 0\n\n"
            "A table that was stopped does not go on, whatever is switched on afterwards: move the "
            "machine to the start and load the HAL file anew."
        ),
        afterwards=(
            "The table ends where it began. Give the joints back to LinuxCNC there:\n\n"
            "    halcmd sets table-run 0\n\n"
            "    halcmd setp table-begun.reset 1\n\n"
            "    halcmd setp table-begun.reset 0\n\n"
            "    halcmd setp table-rows.reset 1\n\n"
            "    halcmd setp table-rows.reset 0\n\n"
            "Away from the start the reset makes the struts jump: stop the machine instead."
        ),
    ),
    executed="halrun of LinuxCNC 2.9 ran these commands: every row in its cycle",
    companions={STREAMER_ENDING: hal_lines, **lead_files(".txt", _lines)},
    clock="one row every servo cycle",
    capacity="none: rows are streamed",
    axes={"strut": actuator_names("S")},
    repeats=True,
    guide_values=_feed,
    uniform=True,
)
