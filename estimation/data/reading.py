"""From a file in any known format to a checked measurement in SI units."""

from __future__ import annotations

import importlib.util
from functools import cache
from os import PathLike
from pathlib import Path

import numpy as np

from constraints.plugins import declarations
from estimation.data import readers
from estimation.data.channels import (
    in_si,
    refuse_cells,
    refuse_few_rows,
    refuse_implausible_lengths,
    refuse_periods,
)
from estimation.data.formats import FileFormat
from estimation.data.measurement import Measurement
from estimation.data.table import RawTable
from estimation.data.timebase import lost_samples, time_base
from expdesign.configuration import (
    FORCE_CHANNELS,
    LENGTH_CHANNELS,
    DataSection,
    InputError,
    ResolvedRobot,
)
from expdesign.configuration.document import refuse_special
from expdesign.robot.robot import Robot


@cache
def file_formats() -> tuple[FileFormat, ...]:
    """Return every format; a new one is one file in ``estimation/data/readers``, or a plug-in."""
    return declarations(FileFormat, readers, "FORMATS")


def format_of(path: Path) -> FileFormat:
    """Return the format of a file or folder.

    Raises
    ------
    InputError
        The file does not exist, no format claims it, or its library is not installed.
    """
    if not path.exists():
        raise InputError("there is no such file", path)
    refuse_special(path)
    found = next((each for each in file_formats() if each.claims(path)), None)
    if found is None:
        known = ", ".join(sorted({suffix for each in file_formats() for suffix in each.extensions}))
        message = f"this file has no known extension: '{path.suffix}'"
        if path.is_dir():
            message = "this folder is no rosbag2 recording"
        allowed = f"{known}, or the folder of a rosbag2 recording"
        raise InputError(message, path, allowed=allowed)
    if found.library is not None and not _require_library(found.library):
        message = f"{found.title} is read with {found.library}, which is not installed"
        install = f"after: pip install expdesign[{found.extra}]"
        raise InputError(message, path, allowed=install)
    return found


def _require_library(library: str) -> bool:
    try:
        return importlib.util.find_spec(library) is not None
    except ValueError:  # a module without a specification, such as one that was blocked
        return False


def read_measurement(
    path: str | PathLike[str], section: DataSection, robot: ResolvedRobot | Robot
) -> Measurement:
    """Read a recording.

    Parameters
    ----------
    path : path
        A file in one of the formats of :mod:`estimation.data.readers`, or a rosbag2 folder.
    section : DataSection
        How its columns map to channels; the defaults are those of ``measurement.csv``.
    robot : ResolvedRobot or Robot
        Whose lengths they are: for the number of rows needed and for plausibility.

    Raises
    ------
    InputError
        The file cannot be read, or its content cannot be used: every defect with column and row.
    """
    file = Path(path)
    return measurement_of(format_of(file).load(file, section), section, robot)


def measurement_of(
    table: RawTable, section: DataSection, robot: ResolvedRobot | Robot
) -> Measurement:
    """Return the measurement in a table, wherever it comes from; arguments as `read_measurement`.

    Raises
    ------
    InputError
        Its content cannot be used: every defect with column and row.
    """
    machine = robot if isinstance(robot, Robot) else Robot(robot)
    description, home = machine.description, None
    if section.length_offsets == "home":
        # Those of the actuators: on a thread they are not the distances of the joints.
        home = machine.inverse_kinematics(machine.home)
    table, notes = in_si(table, section, home)
    table = _within(table, section)
    refuse_few_rows(table, len(description.parameter_names))
    refuse_cells(table, tuple(table.values), section.decimal)
    refuse_periods(table)
    base = time_base(table, section)
    lengths = np.column_stack([table.values[channel] for channel in LENGTH_CHANNELS])
    refuse_implausible_lengths(table, lengths, description, section)
    period = table.values.get("period")
    return Measurement(
        time=base.time,
        lengths=lengths,
        forces=np.column_stack([table.values[channel] for channel in FORCE_CHANNELS]),
        step=base.step,
        stamped=section.time == "stamped",
        period=None if period is None else period.astype(np.int64),
        length_delay=section.delay.lengths,
        force_delay=section.delay.forces,
        jitter=base.jitter,
        lost=base.lost,
        source=str(table.file),
        warnings=(*notes, *lost_samples(table, base)),
    )


def _within(table: RawTable, section: DataSection) -> RawTable:
    """Return the table without the rows before the trigger and from the end on.

    In these anything may stand.
    """
    time = table.values["t"]
    finite = time[np.isfinite(time)]
    if (section.start is None and section.end is None) or len(finite) == 0:
        return table
    # A stamp that jitters just below a limit is the first one after it.
    slack = section.time_tolerance * float(np.median(np.diff(finite))) if len(finite) > 1 else 0.0
    first, end = 0, len(table)
    if section.start is not None:
        first = int(np.argmax(np.append(time >= section.start - slack, True)))
    if section.end is not None:
        end = first + int(np.argmax(np.append(time[first:] >= section.end - slack, True)))
    if first >= end:
        late = first == len(table)
        key, limit = ("start", section.start) if late else ("end", section.end)
        message = f"no rows {'at or after' if late else 'before'} data.{key}, {limit:g} s"
        span = f"the file has {finite.min():g} to {finite.max():g} s"
        raise InputError(table.problem(message, "t", allowed=span))
    return table.part(first, end)
