"""Reading of recordings: from a file in any known format to a checked measurement in SI units."""

from __future__ import annotations

import importlib.util
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cache
from hashlib import sha256
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from constraints.plugins import declarations
from estimation.data import readers
from estimation.data.formats import FileFormat
from estimation.data.measurement import Measurement, time_base
from estimation.data.sensors import SensorResponse
from estimation.data.stamps import EARLIEST, epoch_unit, median_step
from estimation.data.streams import join_tables
from estimation.data.table import (
    MOST_PROBLEMS,
    RawTable,
    RecordedColumn,
    refuse,
    refuse_cells,
    refuse_empty_rows,
    refuse_periods,
    trim,
)
from expdesign.configuration import (
    FORCE_CHANNELS,
    LENGTH_CHANNELS,
    DataSection,
    InputError,
    Problem,
    ResolvedRobot,
    quantity,
    quote,
)
from expdesign.configuration.actuator_units import VOLTAGE_KINDS, ActuatorUnits
from expdesign.configuration.document import refuse_special
from expdesign.configuration.estimate import CHANNEL_UNITS, SUPPLY
from expdesign.robot.robot import Robot
from expdesign.runfolder.manifest import Manifest


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
    _refuse_results(path)
    found = next((each for each in file_formats() if each.claims(path)), None)
    if found is None:
        known = ", ".join(sorted({suffix for each in file_formats() for suffix in each.extensions}))
        message = f"this file has no known extension: '{path.suffix}'"
        if path.is_dir():
            message = "this folder is not a rosbag2 recording"
        allowed = f"{known}, or the folder of a rosbag2 recording"
        raise InputError(message, path, allowed=allowed)
    try:
        missing = found.library is not None and importlib.util.find_spec(found.library) is None
    except ValueError:  # a module without a specification, such as a blocked one
        missing = True
    if missing:
        message = f"{found.title} is read with {found.library}, which is not installed"
        install = f"after: pip install expdesign[{found.extra}]"
        raise InputError(message, path, allowed=install)
    return found


_RECORDINGS = "experiment"
"""Stage of a run folder that writes recordings."""


def _refuse_results(path: Path) -> None:
    """Refuse a file that a stage wrote into a run folder and that is not a recording."""
    place = path.resolve()
    folder = next((one for one in place.parents if (one / Manifest.FILE).is_file()), place.parent)
    name = str(place.relative_to(folder))
    try:
        known = Manifest.read(folder)
    except InputError:  # none, or that of another program or version
        return
    if name not in known.files:
        return
    stage = next((each for each, entry in known.stages.items() if name in entry.files), "export")
    if stage == _RECORDINGS:
        return
    result = f"a result of `{stage}`"
    if place.name == "trajectory.csv":
        result = "a designed motion, whose forces are computed"
    elif stage == "export":
        result = "a controller table, which has no measured forces"
    allowed = "the file that the machine has logged, or measurement.csv of `expdesign simulate`"
    raise InputError(f"this file is {result}, and not a recording", path, allowed=allowed)


def read_measurement(
    path: str | PathLike[str],
    section: DataSection,
    robot: ResolvedRobot | Robot,
    *,
    plausible: bool = True,
) -> Measurement:
    """Read a recording.

    Parameters
    ----------
    path : path
        A file in one of the formats of :mod:`estimation.data.readers`, or a rosbag2 folder.
    section : DataSection
        Columns, units, signs and time; the defaults are those of ``measurement.csv``.
    robot : ResolvedRobot or Robot
        The measured robot: its parameters need as many rows, its limits show implausible lengths.
    plausible : bool
        Refuse implausible lengths; otherwise only those that are far out of range with stated
        zeros, unless another unit or sign explains them.

    Raises
    ------
    InputError
        The file cannot be read, or its content cannot be used: every defect with column and row.
    """
    file, files = Path(path), section.files
    if files is None or file.resolve() != Path(files.lengths).resolve():
        table = format_of(file).load(file, section)
        return measurement_of(table, section, robot, plausible=plausible)
    lengths = _timed_table(file, section.of_group("q"))
    forces = _timed_table(Path(files.forces), section.of_group("Q"))
    table, remark = join_tables(lengths, forces, section)
    units = {key: unit for key, unit in section.units.items() if key[0] != "t"}
    joint = section.model_copy(update={"units": units, "start": None, "end": None})
    found = measurement_of(table, joint, robot, plausible=plausible)
    return replace(found, warnings=(remark, *found.warnings))


def _timed_table(file: Path, section: DataSection) -> tuple[RawTable, float]:
    """Return one of two files with its time in s, and the time that was subtracted from it, s."""
    table = format_of(file).load(file, section)
    time, begin, _ = seconds_of(table, section)
    return replace(table, values={**table.values, "t": time}), begin


def measurement_of(
    table: RawTable,
    section: DataSection,
    robot: ResolvedRobot | Robot,
    *,
    plausible: bool = True,
) -> Measurement:
    """Return the measurement in a table; arguments and exceptions as of `read_measurement`."""
    machine = robot if isinstance(robot, Robot) else Robot(robot)
    description, recorded = machine.description, table
    table, notes, voltages = convert_to_si(table, section, machine)
    table = trim(table, section)
    begin = table.first_row - recorded.first_row
    content = _content_hash(recorded.part(begin, begin + len(table)))
    parameters = len(description.parameter_names)
    if len(table) < parameters:
        rows = f"{len(table)} row{'' if len(table) == 1 else 's'}"
        message = f"{rows} of data, but the robot has {parameters} parameters"
        raise InputError(message, table.file, allowed=f"at least {parameters} rows")
    refuse_cells(table, tuple(table.values), section.decimal)
    refuse_periods(table)
    refuse_empty_rows(table, FORCE_CHANNELS)
    base = time_base(table, section)
    lengths = np.column_stack([table.values[channel] for channel in LENGTH_CHANNELS])
    refuse_implausible_lengths(table, lengths, description, section, explained=not plausible)
    period = table.values.get("period")
    return Measurement(
        time=base.time,
        lengths=lengths,
        forces=np.column_stack([table.values[channel] for channel in FORCE_CHANNELS]),
        step=base.step,
        stamped=section.time == "stamped",
        has_units=frozenset(channel[0] for channel, column in table.columns.items() if column.unit),
        period=None if period is None else period.astype(np.int64),
        length_delay=float(np.mean(section.delay.lengths)),
        force_delay=float(np.mean(section.delay.forces)),
        back_emf=description.drive.back_emf if voltages else None,
        length_sensors=SensorResponse.of(section, "q"),
        force_sensors=SensorResponse.of(section, "Q"),
        jitter=base.jitter,
        lost=base.lost,
        source=str(table.file),
        content=content,
        warnings=(*notes, *base.warnings),
    )


def _content_hash(table: RawTable) -> str:
    """Return the hash of what was measured, the same for other units, signs, names and orders.

    Windows of one file with other rows are recordings of their own.
    """
    measured = (*LENGTH_CHANNELS, *FORCE_CHANNELS)
    channels = (sha256(table.values[name].tobytes()).digest() for name in measured)
    return sha256(b"".join(sorted(channels))).hexdigest()


def convert_to_si(
    table: RawTable, section: DataSection, machine: Robot
) -> tuple[RawTable, tuple[str, ...], bool]:
    """Convert a table to the struts' channels in s, m and N.

    The unit of a column comes from the file, from `section.units` for the channel or its group, or
    is SI. Angles, counts, torques, currents and voltages become lengths and forces along the struts
    through the machine's units. Duty cycles are multiplied by a recorded supply voltage, which is
    left out. Then a length or force is sign · scale · channel + offset, and q1 of the file is the
    length of the first strut of `section.order`.

    Returns
    -------
    RawTable, warnings, bool
        True if the forces are those of the motors' voltages at rest.

    Raises
    ------
    InputError
        A unit in the file is unknown, of another quantity, or contradicts `section.units`; or the
        conversion needs a drive, counts or force constants that are not stated; or counts or force
        constants are stated that no channel needs; or only some forces are voltages.
    """
    values, units = dict(table.values), section.actuator_units(machine.description)
    problems: list[Problem] = []
    warnings: list[str] = []
    kinds = dict[str, quantity.Quantity | None]()
    for channel in (name for name in table.values if name != "period"):
        try:
            if channel == "t":
                values["t"], _, found = seconds_of(table, section)
                warnings += found
                continue
            factor, kinds[channel], found = _factor(channel, channel, table, section, units)
        except InputError as error:
            problems += error.problems
            continue
        warnings += found
        if factor != 1:
            values[channel] = values[channel] * factor
    if problems:
        raise InputError(problems)
    _refuse_unused_scales(table, section, kinds.values())
    supply = values.pop(SUPPLY, None)
    for channel, kind in kinds.items():
        if supply is not None and kind is quantity.DUTY:
            values[channel] = values[channel] * supply
    voltages = {kinds[channel] in VOLTAGE_KINDS for channel in FORCE_CHANNELS}
    if len(voltages) > 1:
        message = "some forces are voltages or duty cycles, others not"
        raise InputError(table.header_problem(message, FORCE_CHANNELS[0], "one kind for all six"))
    table = _apply_signs(replace(table, values=values), section, machine)
    return _sort_by_strut(table, section), tuple(warnings), voltages == {True}


def file_channels(
    data: Measurement, section: DataSection, robot: ResolvedRobot
) -> dict[str, NDArray[Any]]:
    """Return the channels of a measurement as in a file of the section, whose reader inverts this.

    Duty cycles are shares of the stated supply, or of 1 V.
    """
    units = section.actuator_units(robot)
    found: dict[str, NDArray[Any]] = {"t": data.time}
    if unit := section.units.get("t"):
        found["t"] = data.time / quantity.DURATION.parse(f"1 {unit}")
    offsets = _offsets(section, Robot(robot))
    supply = robot.drive.supply if np.isfinite(robot.drive.supply) else 1.0
    for channel in (*LENGTH_CHANNELS, *FORCE_CHANNELS):
        strut, group = _strut(channel, section), channel[0]
        values = (data.lengths if group == "q" else data.forces)[:, strut]
        if offset := float(offsets[group][strut]):
            values = values - offset
        factor = section.channel_signs(group)[strut] * section.channel_scales(group)[strut]
        if unit := section.unit_of(channel):
            factor *= units.si_values(unit)[strut]
            if SUPPLY in section.columns and quantity.quantity_of_unit(unit) is quantity.DUTY:
                factor *= supply
        found[channel] = values / factor
    if SUPPLY in section.columns:
        volts = quantity.VOLTAGE.parse(f"1 {section.unit_of(SUPPLY) or 'V'}")
        found[SUPPLY] = np.full(len(data), supply / volts)
    return found if data.period is None else found | {"period": data.period}


def seconds_of(table: RawTable, section: DataSection) -> tuple[Array, float, list[str]]:
    """Return the time (T,), s, from the first row on if it counts from a date.

    The others are the time that was subtracted, s, of a date since 1970, and warnings. Times of day
    and messages of ROS count from the first row, too.

    Raises
    ------
    InputError
        The unit in the file is unknown, of another quantity, or contradicts `section.units`; or no
        unit of a time since 1970 fits both its first value and its step.
    """
    factor, kind, warnings = _factor("t", "t", table, section, ActuatorUnits(None))
    if kind is None and (unit := _epoch_unit(table)) != "s":
        factor = quantity.DURATION.parse(f"1 {unit}")
        warnings.append(
            f"{table.column_name('t')} begins with {table.origin:.0f}: read as {unit} "
            f"since 1970; data.units: {{t: {unit}}} states it"
        )
    begin = table.origin * factor
    if begin < EARLIEST <= table.origin:  # a counter of a small unit
        return (table.values["t"] + table.origin) * factor, 0.0, warnings
    return table.values["t"] * factor, begin, warnings


def _epoch_unit(table: RawTable) -> str:
    """Return the unit of the time by its first value and its step; refuse other counters."""
    if not table.origin:
        return "s"
    step = median_step(table.values["t"])
    if unit := epoch_unit(table.origin, step):
        return unit
    message = (
        f"times from {table.origin:g} on in steps of {step:g} are neither s, ms, us nor ns since "
        "1970: a counter of an unknown unit"
    )
    raise InputError(table.header_problem(message, "t", "data.units: {t: us}, or its other unit"))


def _refuse_unused_scales(
    table: RawTable, section: DataSection, kinds: Collection[quantity.Quantity | None]
) -> None:
    """Refuse counts and force constants if no channel has the quantity that they are for."""
    for key, kind, channel, unit in (
        ("force_constants", quantity.CURRENT, FORCE_CHANNELS[0], "{Q: A}"),
        ("counts_per_metre", quantity.COUNT, LENGTH_CHANNELS[0], "{q: counts}"),
        ("counts_per_revolution", quantity.COUNT, LENGTH_CHANNELS[0], "{q: counts}"),
    ):
        if getattr(section, key) is not None and kind not in kinds:
            message = f"data.{key} are given, but no channel is {kind.name}"
            allowed = f"data.units: {unit} if the file holds {kind.name.split()[1]}s"
            raise InputError(table.header_problem(message, channel, f"{allowed}, or no data.{key}"))
    if SUPPLY in table.values and quantity.DUTY not in kinds:
        message = "a supply voltage is given, but no channel is a duty cycle"
        allowed = f"data.units: {{Q: '%'}}, or no data.columns: {{{SUPPLY}: …}}"
        raise InputError(table.header_problem(message, SUPPLY, allowed))


def _offsets(section: DataSection, machine: Robot) -> dict[str, Array]:
    """Return the offsets of lengths, m, and forces, N, of the struts.

    Those at home are lengths of the actuators: on a thread they are not the distances of joints.
    """
    lengths = section.length_offsets
    home = machine.inverse_kinematics(machine.home) if lengths == "home" else np.array(lengths)
    return {"q": home, "Q": np.array(section.force_offsets)}


def _apply_signs(table: RawTable, section: DataSection, machine: Robot) -> RawTable:
    """Return sign · scale · channel + offset for lengths and forces."""
    offsets, values = _offsets(section, machine), dict(table.values)
    for channel in (*LENGTH_CHANNELS, *FORCE_CHANNELS):
        strut, group = _strut(channel, section), channel[0]
        sign, offset = section.channel_signs(group)[strut], float(offsets[group][strut])
        scale = section.channel_scales(group)[strut]
        if sign * scale != 1:
            values[channel] = sign * scale * values[channel]
        if offset != 0:
            values[channel] = values[channel] + offset
    return replace(table, values=values)


def _sort_by_strut(table: RawTable, section: DataSection) -> RawTable:
    """Rename the channels of the file to those of the struts."""
    in_file = _names_in_file(section)
    if all(channel == name for name, channel in in_file.items()):
        return table
    names = {channel: name for name, channel in in_file.items()}
    # The order of the columns stays the usual one.
    read = {name: in_file.get(name, name) for name in table.values}
    return replace(
        table,
        values={name: table.values[own] for name, own in read.items()},
        columns={name: table.columns.get(own, RecordedColumn(own)) for name, own in read.items()},
        texts={(names.get(name, name), row): text for (name, row), text in table.texts.items()},
    )


def _strut(channel: str, section: DataSection) -> int:
    """Return the strut, from zero, of a length or force of the file."""
    return section.channel_order(channel[0])[int(channel[1]) - 1] - 1


def _names_in_file(section: DataSection) -> dict[str, str]:
    """Return the file's name for each length and force of a strut."""
    channels = (*LENGTH_CHANNELS, *FORCE_CHANNELS)
    return {f"{channel[0]}{_strut(channel, section) + 1}": channel for channel in channels}


def _factor(
    channel: str, place: str, table: RawTable, section: DataSection, units: ActuatorUnits
) -> tuple[float, quantity.Quantity | None, list[str]]:
    """Return the SI value and quantity of a column's unit (None without one), and warnings.

    `channel` is its name in the file, `place` its key in the table.
    """

    def refused(message: str, allowed: str) -> InputError:
        return InputError(table.header_problem(message, place, allowed))

    unit, warnings = section.units.get(channel, section.units.get(channel[0])), list[str]()
    given = table.columns[place].unit if place in table.columns else None
    if given is not None and (found := quantity.quantity_of_unit(given)) is None:
        message = f"the file's unit {quote(given)} is not known"
        if unit is None:
            raise refused(message, f"a known unit, or data.units: {{{channel}: …}}")
        warnings.append(f"{channel}: {message}, '{unit}' used")
    elif given is not None and found is not None:
        _, admitted = CHANNEL_UNITS[channel[0]]
        if found not in admitted:
            message = f"the file's unit {quote(given)} is that of {found.name}"
            raise refused(message, " or ".join(dimension.name for dimension in admitted))
        if unit is not None and not quantity.same_unit(unit, given):
            message = f"the file says that {channel} is in {quote(given)}, data.units says '{unit}'"
            raise refused(message, "the same unit, or none in data.units")
        unit = given
    if unit is None or (kind := quantity.quantity_of_unit(unit)) is None:
        return 1.0, None, warnings
    if channel in ("t", SUPPLY):
        return kind.parse(f"1 {unit}"), kind, warnings
    if missing := units.missing(unit):
        raise refused(f"{channel} is {kind.name}, but {missing[0]}", missing[1])
    return units.si_values(unit)[_strut(channel, section)], kind, warnings


_UNITS = ("m", "mm", "cm", "in", "ft", "µm", "dm", "km")
"""Units that are tried if the lengths are implausible, the most likely first."""
_ZERO_UNITS = ("mm", "cm", "in")
"""Units of zeros that may have been written as plain numbers."""
_ZERO_AT_HOME = "; it would fit if the channel read zero at home: data.offset: home"
_NEAR_HOME = 0.25
"""Largest distance of a motion's middle from home, as a share of the stroke."""
_MARGIN = 0.1
"""Distance, relative to the longest length, by which the median may be out of range: limits may
hold for the design only, and a wrong unit is a factor of at least 2.5."""


@dataclass(frozen=True, eq=False)
class LengthRange:
    """Possible lengths of a robot's struts, (6,) each, m, and their origin."""

    lower: Array
    upper: Array
    origin: str

    @classmethod
    def of(cls, robot: ResolvedRobot) -> LengthRange:
        """Return the limits on the strut lengths; without limits, half to twice those at home.

        No telescope has a larger range.
        """
        home = robot.struts_at(robot.home).lengths
        limit = robot.limits.get("strut_length")
        if limit is None:
            return cls(home / 2, home * 2, "half to twice the lengths at home")
        # The reserve is for designs: a recording may use it.
        low, high = limit.stated_bounds
        lower = np.where(np.isfinite(low) & (low > 0), low, home / 2)
        return cls(lower, np.where(np.isfinite(high), high, home * 2), limit.origin)

    def fits(self, middle: Array) -> NDArray[np.bool_]:
        """Return for which struts a median length, (6,), m, is plausible."""
        margin = _MARGIN * self.upper
        return (middle >= self.lower - margin) & (middle <= self.upper + margin)

    def problem(self, table: RawTable, strut: int, row: int, message: str) -> Problem:
        """Describe an impossible length of a strut."""
        span = f"{self.lower[strut]:.4g} to {self.upper[strut]:.4g} m, {self.origin}"
        return table.problem(f"strut {strut + 1} is {message}", LENGTH_CHANNELS[strut], row, span)


def refuse_implausible_lengths(
    table: RawTable,
    lengths: Array,
    robot: ResolvedRobot,
    section: DataSection,
    *,
    explained: bool = False,
) -> None:
    """Refuse impossible strut lengths, (T, 6), m: wrong units, outlying values.

    `explained` ones, with other channels, are left to the search for these.
    """
    allowed = LengthRange.of(robot)
    middle = np.median(lengths, axis=0)
    stroke = allowed.upper - allowed.lower
    outside = (lengths < allowed.lower) | (lengths > allowed.upper)
    stated = section.length_offsets != "home" and any(section.length_offsets)
    far = stated & ((middle < allowed.lower - stroke) | (middle > allowed.upper + stroke))
    readings = _Readings.of(middle, table, section, robot)
    unit, problems, unexplained = readings.unit_of_zeros(allowed), [], False
    fits = allowed.fits(middle)
    for strut in np.flatnonzero(~fits).tolist():
        message = f"around {middle[strut]:.4g} m long, out of this robot's range"
        row = int(np.argmax(outside[:, strut]))
        if unit:
            zero = f"{readings.offsets[strut]:.4g}"
            hint = f"; data.offset is {zero} m, and the length would fit with {zero} {unit}"
        else:
            hint = readings.hint(allowed, strut)
        unexplained |= bool(unit) or not explained or bool(far[strut] and not hint)
        problems.append(allowed.problem(table, strut, row, message + hint))
    if unexplained:
        if stated and np.any(fits):
            others = ", ".join(f"strut {each + 1}" for each in np.flatnonzero(fits).tolist())
            text = f"; zeros of possible lengths may be wrong as well: {others}"
            problems[-1] = replace(problems[-1], message=problems[-1].message + text)
        raise InputError(problems)
    if explained:
        return
    wild = (lengths <= np.maximum(allowed.lower - stroke, 0)) | (lengths > allowed.upper + stroke)
    places = np.argwhere(wild)
    for row, strut in places[:MOST_PROBLEMS].tolist():
        message = f"{lengths[row, strut]:.4g} m long, far out of this robot's range"
        problems.append(allowed.problem(table, strut, row, message))
    refuse(problems, table.file, "lengths are like that", len(places))


@dataclass(frozen=True)
class _Readings:
    """Median readings of the six lengths and the zeros that were added to them."""

    home: Array
    """(6,), lengths at home, m."""
    signs: Array
    offsets: Array
    """(6,), m."""
    positions: Array
    """(6,), readings in m, with their signs."""
    in_file: Array
    """(6,), the same numbers as in the file."""
    stated: bool
    """Whether `data.offset` has numbers."""

    @classmethod
    def of(
        cls, middle: Array, table: RawTable, section: DataSection, robot: ResolvedRobot
    ) -> _Readings:
        """Return the readings of lengths, (6,), m."""
        home, at_home = robot.struts_at(robot.home).lengths, section.length_offsets == "home"
        signs = np.array(section.channel_signs("q"))
        offsets = home if at_home else np.array(section.length_offsets)
        own, names = section.actuator_units(robot), _names_in_file(section)
        factors = [_factor(names[c], c, table, section, own)[0] for c in LENGTH_CHANNELS]
        positions = signs * (middle - offsets)
        stated = not at_home and bool(np.any(offsets))
        return cls(home, signs, offsets, positions, positions / factors, stated)

    def fitting_units(self, allowed: LengthRange) -> dict[str, NDArray[np.bool_]]:
        """Return for each unit which lengths fit if the file is in it."""
        return {
            unit: allowed.fits(
                self.offsets + self.signs * self.in_file * quantity.LENGTH.parse(f"1 {unit}")
            )
            for unit in _UNITS
        }

    def unit_of_zeros(self, allowed: LengthRange) -> str:
        """Return the unit of the stated numbers in which all lengths fit, or nothing."""
        if not self.stated or any(map(np.all, self.fitting_units(allowed).values())):
            return ""
        lengths = {
            unit: self.offsets * quantity.LENGTH.parse(f"1 {unit}") + self.signs * self.positions
            for unit in _ZERO_UNITS
        }
        fitting = (unit for unit, found in lengths.items() if np.all(allowed.fits(found)))
        return next(fitting, "")

    def hint(self, allowed: LengthRange, strut: int) -> str:
        """Suggest a unit, sign or offset with which a strut's median length is plausible."""
        positions, units = self.positions, self.fitting_units(allowed)
        from_home = not np.any(self.offsets)
        stroke = allowed.upper - allowed.lower
        if (
            from_home
            and abs(np.mean(positions)) < _NEAR_HOME * np.min(stroke)
            and np.all(allowed.fits(self.home + self.signs * positions))
            and not any(map(np.all, units.values()))
        ):
            # A common cause for all six precedes units that fit single struts by chance.
            return _ZERO_AT_HOME
        for unit, fits in units.items():
            if fits[strut]:
                return f"; it would fit if the file were in {unit}: data.units: {{q: {unit}}}"
        if allowed.fits(self.offsets - self.signs * positions)[strut]:
            hint = f"data.sign: {{q: {-self.signs[strut]}}}"
            return f"; it would fit if the channel counted the other way: {hint}"
        if from_home and np.abs(positions)[strut] < _NEAR_HOME * stroke[strut]:
            return _ZERO_AT_HOME
        return ""
