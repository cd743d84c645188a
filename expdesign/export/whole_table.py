"""A table as one whole motion: its ends, times, jumps of speed, columns and companion files."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.export.certification import AT_HOME, LIMIT_SHARE
from expdesign.export.definition import Interpolation, Rows, Settings, TableError
from expdesign.export.execution import LONGER, ExecutedTable
from expdesign.export.row_times import ideal_rows, uniform_times, whole_motion
from expdesign.export.text_table import lines

AT_REST = 1e-6
"""Largest difference of their rates from the stated ones, m/s and rad/s, beyond rounding."""
COLUMN = 1e-6
"""Largest difference of a further column from the design, as a share of its size (at least 1)."""
JUMP = 2.0
"""Largest corner of straight lines, as a multiple of the design's largest, without a limit."""

_DURATION = 1e-6
_GRID = 1e-3
"""s; the coarsest grid of row times of a controller, by which a table may last longer."""
_STEP = 1e-9
_STEP_SHARE = 1e-6
_COMPUTED = 1e-9
_PROGRAMS = (".py",)
"""Companions that read the table itself: users may use others in their stead."""
_DIGITS = 9


def find_faults(
    settings: Settings, table: ExecutedTable, longest_step: float = np.inf, *, piece: bool = False
) -> list[str]:
    """Return the reasons against a table as the whole motion of its settings, in words.

    A whole motion begins and ends as `Settings.task` states, usually at rest at home, takes its
    time, has no hole and no jump of speed, and switches the output with the measurement window.

    Rows at individual times are at most the longest step of the export apart, s. A piece may have
    any begin, end and duration.
    """
    table = table.as_written
    settings = executed_settings(settings, table)
    rows = table.rows
    faults = _wrong_steps(rows, settings, longest_step) + _speed_jumps(table, settings, piece=piece)
    if piece:
        return faults
    return [
        *_wrong_duration(rows, settings),
        *_wrong_ends(rows, settings),
        *faults,
        *_wrong_trigger(rows, settings),
    ]


def executed_settings(settings: Settings, table: ExecutedTable) -> Settings:
    """Return the settings with the motion that the rows in memory hold."""
    return replace(settings, task=replace(settings.task, motion=table.motion))


def _wrong_duration(rows: Rows, settings: Settings) -> list[str]:
    motion, begin, end = settings.task.motion, rows.times[0], rows.times[-1]
    wanted, longer = motion.duration, _GRID
    if settings.step is not None:
        wanted, longer = float(uniform_times(motion, settings.step)[-1]), 0.0
    elif settings.form.controller is not None:
        longer = float(np.max(np.diff(rows.times)))
    late = [f"the first row is at {begin:.6f} s"] if abs(begin) > _DURATION else []
    if not wanted - _DURATION <= end <= wanted + longer + _DURATION:
        late.append(f"the table lasts {end:.6f} s, the motion {wanted:.6f} s")
    return late


def _wrong_steps(rows: Rows, settings: Settings, longest: float) -> list[str]:
    """Return the first row with another distance than stated, or a hole."""
    steps, step = np.diff(rows.times), settings.step
    allowed = longest if step is None else step
    wrong = steps > allowed * (1 + _STEP_SHARE) + _STEP
    if step is not None:
        wrong |= steps < step * (1 - _STEP_SHARE) - _STEP
    if not np.any(wrong):
        return []
    row = int(np.argmax(wrong))
    apart = f"{allowed:g} s apart" if step is not None else f"at most {allowed:g} s apart"
    return [f"row {row + 2} follows after {steps[row]:.9g} s where rows are {apart}"]


def _wrong_ends(rows: Rows, settings: Settings) -> list[str]:
    """Return the ends of the table that differ from those of the motion."""
    ideal = ideal_rows(settings, np.array([0.0, settings.task.motion.duration]))
    found = []
    for k, verb, row in ((0, "begins", 0), (1, "ends", -1)):
        pairs = [("at", rows.position, ideal.position, AT_HOME, "")]
        if rows.rate is not None and ideal.rate is not None:
            pairs.append(("with the velocity", rows.rate, ideal.rate, AT_REST, "/s"))
        for what, written, wanted, allowed, per_second in pairs:
            share = np.abs(written[row] - wanted[k]) / (
                allowed * np.abs(settings.axes.factor) + settings.half_unit + _COMPUTED
            )
            if np.max(share) > 1:
                axis = int(np.argmax(share))
                name, unit = settings.axes.names[axis], settings.axes.units[axis] + per_second
                found.append(
                    f"the table {verb} {what} {written[row, axis]:.6g} {unit} of {name}, the "
                    f"motion {what} {np.round(wanted[k, axis], _DIGITS) + 0.0:.6g} {unit}"
                )
    return found


def _speed_jumps(table: ExecutedTable, settings: Settings, *, piece: bool) -> list[str]:
    """Return the largest jump of a strut's speed beyond the acceleration of the actuators.

    At a corner of straight lines the speed changes at once; the drives have the time of a row. The
    first and last row are corners as well, except of a piece.
    """
    if table.interpolation is not Interpolation.LINEAR:
        return []
    times = table.rows.times
    found, jumps = _corners(times, table.lengths(times), piece=piece)
    limit = settings.task.robot.limit("strut_acceleration")
    if limit is None:
        design = settings.task.motion.sample(times).pose
        _, wanted = _corners(times, settings.task.robot.inverse_kinematics(design), piece=True)
        allowed = np.full(jumps.shape[1], JUMP * np.max(wanted, initial=0.0))
    else:
        allowed = np.maximum(np.abs(limit.lower), np.abs(limit.upper)) + LIMIT_SHARE * limit.range
    # A rounded row is half a unit off, the difference of two slopes four of them.
    lengths = settings.half_unit / np.min(np.abs(settings.axes.factor))
    allowed = allowed + 4 * (lengths + _STEP * AT_HOME) / np.min(np.diff(times)) ** 2
    share = jumps / allowed
    if not np.max(share, initial=0.0) > 1:
        return []
    corner, strut = np.unravel_index(int(np.argmax(share)), share.shape)
    row = int(found[corner])
    return [
        f"row {row + 1}: the speed of strut {strut + 1} jumps, which takes "
        f"{jumps[corner, strut]:.4g} m/s² within a row where {allowed[strut]:.4g} m/s² are possible"
    ]


def _corners(times: Array, lengths: Array, *, piece: bool) -> tuple[NDArray[np.intp], Array]:
    """Return rows (K,) with a corner and the accelerations (K, 6) that they take, m/s²."""
    steps = np.diff(times)
    slopes = np.diff(lengths, axis=0) / steps[:, None]
    if not piece:
        rest = np.zeros((1, lengths.shape[1]))
        slopes, steps = np.vstack([rest, slopes, rest]), np.pad(steps, 1, mode="edge")
    mean = (steps[:-1] + steps[1:]) / 2
    rows: NDArray[np.intp] = np.arange(len(mean), dtype=np.intp) + (1 if piece else 0)
    return rows, np.abs(np.diff(slopes, axis=0)) / mean[:, None]


def _wrong_trigger(rows: Rows, settings: Settings) -> list[str]:
    """Return the switching times that are more than half a row from the measurement window."""
    if settings.section.trigger is None:
        return []
    if rows.trigger is None:
        return ["the output is not switched"]
    half_row = float(np.diff(rows.times).max()) / 2 + _DURATION
    edges = rows.true_times(settings.window)
    return [
        f"the output is switched {what} at {time:.6f} s, where the measurement window {ends} at "
        f"{edge:.6f} s"
        for what, ends, time, edge in zip(
            ("on", "off"), ("begins", "ends"), rows.trigger, edges, strict=True
        )
        if abs(time - edge) > half_row
    ]


def controller_faults(table: ExecutedTable, *, piece: bool = False) -> list[str]:
    """Return the reason against a controller that plans between the rows and takes longer.

    Of a `piece`, which has no measurement window, the whole duration counts; to start and to stop
    amid the motion it takes a row longer at most.
    """
    if table.row_times is None:
        return []
    times, written = table.rows.times, table.as_written.rows
    stretch, allowed = table.stretch, LONGER
    if piece:
        duration = np.ptp(written.times)
        stretch = float(np.ptp(table.row_times) / duration) - 1
        allowed += float(np.max(np.diff(written.times)) / duration)
    if abs(stretch) <= allowed:
        return []
    return [
        f"the controller takes {1 + stretch:.4g} times as long: {times[-1] - times[0]:.4g} s "
        f"for {written.duration:.4g} s"
    ]


def wrong_columns(settings: Settings, rows: Rows) -> list[str]:
    """Return the further columns of a table that are not those of the design."""
    found = []
    expected = whole_motion(settings.task, rows.times) if rows.columns else {}
    for name, wanted in expected.items():
        if name not in rows.columns:
            continue  # not chosen
        off = np.abs(rows.columns[name] - wanted)
        row = int(np.argmax(off))
        if not off[row] <= COLUMN * max(1.0, np.max(np.abs(wanted))):
            value = f"{rows.columns[name][row]:.6g} in row {row + 1}, design {wanted[row]:.6g}"
            found.append(f"column {name} is not that of the design ({value})")
    return found


def wrong_companions(settings: Settings, rows: Rows, path: Path) -> list[str]:
    """Return the files of a table that are missing or differ from those of the export."""
    found = []
    for ending, expected in settings.form.companions.items():
        wanted = expected(rows, settings)
        file = path.with_name(f"{path.stem}{ending}")
        if not wanted:
            continue
        if file.suffix in _PROGRAMS:
            text = "".join(f"{line}\n" for line in wanted)
            if file.is_file() and file.read_bytes() != text.encode():
                found.append(f"{file.name} is not that of the export, and was not examined")
            continue
        if not file.is_file():
            found.append(f"{file.name} is missing")
            continue
        try:
            same = list(_code(lines(file))) == list(_code(wanted))
        except TableError:
            same = False
        if not same:
            found.append(f"{file.name} is not that of the export")
    return found


def _code(text: Iterable[str]) -> Iterator[list[str]]:
    """Yield the words of each line without comments."""
    for line in text:
        if words := line.partition("#")[0].split():
            yield words


def departure(settings: Settings, table: ExecutedTable) -> tuple[float, float]:
    """Return the largest distance of a strut's length at a row from the design, m, and its time."""
    times = table.rows.times
    design = table.motion.sample(times).pose
    off = np.abs(table.lengths(times) - settings.task.robot.inverse_kinematics(design)).max(axis=1)
    row = int(np.argmax(off))
    return float(off[row]), float(table.rows.true_times(times[row]))


def piece_in_words(table: ExecutedTable) -> str:
    """Say where the struts of a piece of a motion are, and how fast, when it begins and ends."""
    times, home = table.rows.times, table.robot.inverse_kinematics(table.robot.home)
    ends = np.array([times[0], times[-1]])
    away = np.max(np.abs(table.lengths(ends) - home), axis=1)
    steps = np.diff(times)
    first, last = (table.lengths(times[part]) for part in (slice(2), slice(-2, None)))
    speeds = [
        np.max(np.abs(np.diff(part, axis=0))) / step
        for part, step in ((first, steps[0]), (last, steps[-1]))
    ]
    begin, end = (
        f"{np.round(1e3 * off, 3):.6g} mm from home at {np.round(speed, 4):.4g} m/s"
        for off, speed in zip(away, speeds, strict=True)
    )
    return f"a piece of a motion, which begins {begin} and ends {end} (mean of a row)"
