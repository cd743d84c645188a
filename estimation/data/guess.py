"""Guess of a run's section `data` from a recording: columns, units, separators and time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from constraints.arrays import Array
from estimation.data.measurement import find_gaps, fit_grid
from estimation.data.reading import LengthRange, format_of
from estimation.data.stamps import epoch_unit, median_step
from estimation.data.table import FileContent, RawTable, RecordedColumn, label
from expdesign.configuration import (
    FORCE_CHANNELS,
    LENGTH_CHANNELS,
    DataSection,
    InputError,
    ResolvedRobot,
    quote,
)
from expdesign.configuration.actuator_units import (
    FORCE_KINDS,
    LENGTH_KINDS,
    VOLTAGE_KINDS,
    ActuatorUnits,
)
from expdesign.configuration.estimate import SUPPLY
from expdesign.configuration.quantity import (
    ANGLE,
    CURRENT,
    DURATION,
    DUTY,
    TORQUE,
    VOLTAGE,
    Quantity,
    quantity_of_unit,
)
from expdesign.mechanism.hexapod import ACTUATORS


@dataclass(frozen=True)
class DataGuess:
    """Guessed section `data` with everything that has to be checked."""

    section: dict[str, Any] = field(default_factory=dict)
    """Keys and values in the notation of a run file."""
    facts: list[str] = field(default_factory=list)
    """Findings about the file."""
    questions: list[str] = field(default_factory=list)
    """Values that the file does not determine, with advice."""


def guess_files(
    lengths: Path, forces: Path | None = None, robot: ResolvedRobot | None = None
) -> DataGuess:
    """Guess the section `data` for a recording in one file, or in two; as `guess_data`.

    Raises
    ------
    InputError
        As `guess_data`, or the names of the columns say that the forces are in the first file.
    """
    if forces is None:
        return guess_data(lengths, robot)
    if _has_rather(lengths, "Q") and _has_rather(forces, "q"):
        message = f"its columns are forces by their names, and those of {forces.name} are lengths"
        raise InputError(message, lengths, allowed="the file of the lengths first")
    one, two = guess_data(lengths, robot, "q"), guess_data(forces, robot, "Q")
    section: dict[str, Any] = {}
    for key in dict.fromkeys((*one.section, *two.section)):
        own, other = one.section.get(key), two.section.get(key)
        if key not in ("columns", "units"):
            section[key] = other if own is None else own
            if own != other and key not in ("time", "offset"):
                one.questions.append(f"{key}: not the same in both files: save one like the other")
            continue
        merged = {**(own or {}), **{k: value for k, value in (other or {}).items() if k != "t"}}
        if (own or {}).get("t", "t") != (other or {}).get("t", "t"):
            merged["tQ"] = (other or {}).get("t", "t" if key == "columns" else "s")
        section[key] = merged
    facts = [
        f"{file.name}: {one}"
        for file, found in ((lengths, one), (forces, two))
        for one in found.facts
    ]
    return DataGuess(section, facts, list(dict.fromkeys((*one.questions, *two.questions))))


def _has_rather(path: Path, group: Literal["q", "Q"]) -> bool:
    """Return whether six columns of a file are better channels of a group than of the other one."""
    families = _families(format_of(path).columns_of(path).columns)
    own, other = (
        max((one.score(each) for one in families), default=0.0)
        for each in (group, "q" if group == "Q" else "Q")
    )
    return own > other


def guess_data(
    path: Path, robot: ResolvedRobot | None = None, groups: Literal["q", "Q", "qQ"] = "qQ"
) -> DataGuess:
    """Guess the section `data` for a recording, or for a file with some groups of its channels.

    Names and units of the columns decide: six columns that differ by a number are the channels of a
    group. The robot's lengths decide on a unit of the lengths that the file does not state, and on
    their zero.

    Raises
    ------
    InputError
        The file cannot be read, or is of a format whose columns cannot be listed.
    """
    file_format = format_of(path)
    content = file_format.columns_of(path)
    guess = DataGuess(dict(content.settings), [], list(content.questions))
    units: dict[str, str] = {}
    chosen = _choose_columns(content, guess, units, groups)
    timed = "t" in chosen or content.has_time
    assumed = {} if timed else {"sampling": 1.0}  # the lengths are read without it
    names = {channel: column.text for channel, column in chosen.items()}
    guess.section["columns"] = {channel: name for channel, name in names.items() if name != channel}
    needed = {f"{group}{j}" for group in groups for j in range(1, ACTUATORS + 1)}
    if set(chosen) >= needed:
        keys = ("columns", "delimiter", "decimal", "header")
        section = DataSection.model_validate(
            {key: guess.section[key] for key in keys if key in guess.section} | assumed
        )
        try:
            table = file_format.load(path, section if groups == "qQ" else section.of_group(groups))
        except InputError as error:
            guess.questions.extend(str(replace(one, file=None)) for one in error.problems)
        else:
            if timed:
                _check_time(table, guess, units)
            else:
                guess.facts.append(f"{len(table)} rows")
            if "q" in groups:
                _check_lengths(table, guess, units, robot)
    force = chosen.get(FORCE_CHANNELS[0])
    if force is not None and "Q" not in units and _DUTY.search(force.name):
        units["Q"] = "duty"
        guess.questions.append(
            "units: {Q: duty}: guessed from the name, −1 to 1; '%', or scale: {Q: …} for PWM steps"
        )
    if quantity_of_unit(units.get("Q", "")) is DUTY:
        _choose_supply([one for one in content.columns if one not in chosen.values()], guess, units)
    _check_scales(guess, units, robot)
    if force is not None and "Q" not in units and force.unit is None:
        torque = "; a torque by its name: N m" if _TORQUE.search(force.name) else ""
        guess.questions.append(f"units: {{Q: …}}: not stated, N is assumed{torque}")
    guess.section["units"] = {key: units[key] for key in ("t", "q", "Q", SUPPLY) if key in units}
    for key in ("columns", "units"):
        if not guess.section[key]:
            del guess.section[key]
    return guess


_MOST_LISTED = 40


def _choose_columns(
    content: FileContent, guess: DataGuess, units: dict[str, str], groups: str
) -> dict[str, RecordedColumn]:
    """Return the column of every channel that is found; add units and questions."""
    families, chosen = _families(content.columns), dict[str, RecordedColumn]()
    listed = ", ".join(column.label for column in content.columns[:_MOST_LISTED])
    for group, channels, what in (
        ("q", LENGTH_CHANNELS, "strut lengths"),
        ("Q", FORCE_CHANNELS, "actuator forces"),
    ):
        if group not in groups:
            continue
        ranked = sorted(families, key=lambda family: -family.score(group))
        # The only one of a file that has no other channels needs no name.
        alone = len(groups) == len(ranked) == 1
        if not ranked or ((best := ranked[0]).score(group) == 0 and not alone):
            guess.questions.append(
                f"no six columns are the {what}: state columns: {{{group}1: …}}, out of {listed}"
            )
            continue
        families.remove(best)
        equal = [one.named for one in ranked[1:] if one.score(group) == best.score(group)]
        if equal:
            guess.questions.append(f"{what}: {best.named}, or {' or '.join(equal)}?")
        if best.surplus:
            guess.questions.append(f"{best.named}: the first six of {ACTUATORS + best.surplus}")
        chosen |= zip(channels, best.columns, strict=True)
        unknown = best.columns[0].unit
        if best.unit:
            units[group] = best.unit
        elif unknown and quantity_of_unit(unknown) is None:
            guess.questions.append(f"units: {{{group}: …}}: {quote(unknown)} is not known")
    taken = list(chosen.values())
    times = _time_columns([column for column in content.columns if column not in taken])
    if not times:
        if not content.has_time:
            guess.questions.append(
                f"no column is the time: state columns: {{t: …}}, out of {listed}, or sampling: …"
            )
        return chosen
    time, *others = times
    if others:
        names = ", ".join(column.label for column in others)
        guess.questions.append(
            f"the time is {time.label}; {names} too? Lengths and forces of different times are "
            "files: {lengths: FILE, forces: FILE}, with columns: {t: …, tQ: …}, also of one file"
        )
    if unit := _unit_in(time, (DURATION,)):
        units["t"] = unit
    return {"t": time} | chosen


def _choose_supply(
    columns: Sequence[RecordedColumn], guess: DataGuess, units: dict[str, str]
) -> None:
    """Add the column of the motors' supply: the only voltage that is not one of six, or ask."""
    six = [column for family in _families(columns) for column in family.columns]
    found = {
        column.text: _unit_in(column, (VOLTAGE,))
        for column in columns
        if column not in six
        and (_unit_in(column, (VOLTAGE,)) or (column.unit is None and _SUPPLY.search(column.name)))
    }
    (name, unit), *others = found.items() or [("", None)]
    if unit and not others:
        guess.section["columns"][SUPPLY], units[SUPPLY] = name, unit
    elif name:
        listed = " or ".join(map(label, found))
        guess.questions.append(f"columns: {{{SUPPLY}: …}}: is {listed} the motors' supply?")


# --- columns --------------------------------------------------------------------------------------

_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-zäöü]+|[^\W\d_]+")
_COMPOUND = re.compile(r"(ist|soll|act|cmd|ref)(\w{2,})")
_NUMBER = re.compile(r"\d+")
_DUTY = re.compile(r"pwm|duty", re.IGNORECASE)
_SUPPLY = re.compile(r"batter|supply|volt|bus", re.IGNORECASE)
_TORQUE = re.compile(r"torque|trq|tau|moment", re.IGNORECASE)
_AXIS = re.compile(r"(?<![^\W_])[^\W\d_](?=\d)")
"""A letter with a number, the name of an axis: A1 is no current."""
_LETTER = re.compile(r"(?:.*[./_])?([qQ])(?:\(:,#\)|#)")
"""Names of the channels themselves, also in structs and as columns of matrices."""


def _word_set(text: str) -> frozenset[str]:
    return frozenset(text.split())


_LENGTH_WORDS = _word_set(
    "q l s pos position length len strut leg slider enc encoder geber angle ang winkel weg lange "
    "länge laenge hub stroke joint axis motor counts"
)
_FORCE_WORDS = _word_set(
    "f force kraft torque trq tau tq moment drehmoment effort current cur curr i iq strom tension "
    "voltage volt volts pwm duty"
)
_ELECTRIC_WORDS = _word_set("i iq current cur curr strom voltage volt volts pwm duty")
_OTHER_WORDS = _word_set(
    "v vel velocity speed geschwindigkeit qd dq qdd ddq acc accel acceleration beschleunigung jerk "
    "temp temperature temperatur status state err error follow lag model "
    "enable limit time stamp"
)
_COMMAND_WORDS = _word_set(
    "cmd command commanded ref reference des desired soll set setpoint target demand nominal"
)
_MEASURED_WORDS = _word_set("act actual ist meas measured fb feedback")
_TIME_WORDS = _word_set(
    "t time zeit uhrzeit zeitstempel datum date datetime heure timestamp stamp times sec seconds "
    "clock"
)


@dataclass(frozen=True)
class _Family:
    """Six columns whose names differ by a number."""

    stem: str
    """Name with # for the number."""
    columns: tuple[RecordedColumn, ...]
    surplus: int
    """Number of further columns of the family."""

    @property
    def named(self) -> str:
        """The names for messages."""
        return quote(self.stem)

    @property
    def words(self) -> frozenset[str]:
        """Words of the name in small letters."""
        found = {word.lower() for word in _WORDS.findall(self.stem)}
        compounds = (_COMPOUND.fullmatch(word) for word in found)
        return frozenset(found.union(*(match.groups() for match in compounds if match)))

    @property
    def unit(self) -> str | None:
        """Unit of a length or force that all columns state, if any."""
        found = {_unit_in(column, (*LENGTH_KINDS, *FORCE_KINDS)) for column in self.columns}
        return found.pop() if len(found) == 1 else None

    def score(self, group: str) -> float:
        """Return how well the columns fit as lengths, ``q``, or forces, ``Q``; 0: not at all."""
        kinds = LENGTH_KINDS if group == "q" else FORCE_KINDS
        wanted = _LENGTH_WORDS if group == "q" else _FORCE_WORDS
        unwanted = _FORCE_WORDS if group == "q" else frozenset()
        if (letter := _LETTER.fullmatch(self.stem)) and letter.group(1) != group:
            return 0.0
        stated = next((column.unit for column in self.columns if column.unit), "")
        kind = quantity_of_unit(self.unit or stated)
        named = bool(letter) or (bool(self.words & wanted) and not self.words & unwanted)
        if self.words & _OTHER_WORDS or (kind not in kinds if kind else not named):
            return 0.0
        score = 4.0 * (kind is not None) + named + 0.5 * bool(self.words & _MEASURED_WORDS)
        # Commands, and the currents or voltages of torques in the file, are the second choice.
        second = (self.words & _COMMAND_WORDS) or (group == "Q" and self.words & _ELECTRIC_WORDS)
        return score - 0.75 * bool(second)


def _families(columns: Sequence[RecordedColumn]) -> list[_Family]:
    """Return all sets of at least six columns that differ by a number, from 0 or 1 on."""
    found: dict[str, dict[int, RecordedColumn]] = {}
    for column in columns:
        for match in _NUMBER.finditer(column.name):
            stem = f"{column.name[: match.start()]}#{column.name[match.end() :]}"
            found.setdefault(stem, {}).setdefault(int(match.group()), column)
    families = []
    for stem, numbered in found.items():
        first = next((n for n in (1, 0) if n in numbered and n + ACTUATORS - 1 in numbered), None)
        if 0 in numbered and ACTUATORS not in numbered:
            first = 0
        run = [] if first is None else range(first, first + ACTUATORS)
        if run and all(number in numbered for number in run):
            six = tuple(numbered[number] for number in run)
            families.append(_Family(stem, six, len(numbered) - ACTUATORS))
    return families


def _unit_in(column: RecordedColumn, kinds: Sequence[Quantity]) -> str | None:
    """Return the unit of one of the kinds in a column's brackets, or as a word of its name."""
    words = re.split(r"[\s_.,:/#-]+|\d+", _AXIS.sub("", column.name))
    candidates = [column.unit or "", *(words[1:] if column.unit is None else [])]
    return next(
        (unit for unit in reversed(candidates) if unit and quantity_of_unit(unit) in kinds), None
    )


def _time_columns(columns: Sequence[RecordedColumn]) -> list[RecordedColumn]:
    """Return the columns that may be the time, the likeliest first, by their names and units."""

    def score(column: RecordedColumn) -> int:
        words = {word.lower() for word in _WORDS.findall(column.short)}
        timed = _unit_in(column, (DURATION,)) is not None
        named = bool(words & _TIME_WORDS) and "log" not in words  # log_time of ROS
        return 4 * (column.short.lower() == "t") + 2 * named + timed

    scores = {column.text: score(column) for column in columns}
    best = max(scores.values(), default=0)
    return [column for column in columns if scores[column.text] == best > 0]


# --- values ---------------------------------------------------------------------------------------


_FEWEST = 3
_JITTER = 0.01
_SLOW = ((0.5, "s"), (50.0, "ms"), (5e4, "us"), (np.inf, "ns"))
"""Units of a time without one, by its steps: no machine is sampled once in half a second."""


def _check_time(table: RawTable, guess: DataGuess, units: dict[str, str]) -> None:
    """Add unit, sampling and jitter of the time."""
    time, unit = table.values["t"], units.get("t")
    steps = np.diff(time)
    if not np.all(np.isfinite(time)) or np.any(steps <= 0) or len(time) < _FEWEST:
        guess.questions.append("the time is no number, or does not increase, in some rows")
        return
    if unit is None and table.columns["t"].unit is None:
        step = median_step(time)
        dated = epoch_unit(table.origin, step) if table.origin else None
        unit = dated or next(u for end, u in _SLOW if step < end)
        if unit != "s":
            units["t"] = unit
        if unit != "s" and dated is None:
            guess.questions.append(f"units: {{t: {unit}}}: guessed from steps of {step:g}")
    seconds = time * DURATION.parse(f"1 {unit or 's'}")
    grid = fit_grid(seconds, find_gaps(seconds))
    lost = f", {grid.lost} samples missing" if grid.lost else ""
    guess.facts.append(f"{len(time)} rows, {1 / grid.step:.6g} Hz, {np.ptp(seconds):.4g} s{lost}")
    if grid.jitter > _JITTER:
        guess.section["time"] = "stamped"
        guess.facts.append(
            f"time: stamped, since it deviates by {grid.jitter:.2g} steps from a grid"
        )


_UNITS = ("m", "mm", "cm", "in", "µm", "rev", "rad", "deg")
"""Units of lengths that are tried, the most likely first."""
_FINEST = 1e-6
"""Length, m, of a unit that is never logged: its whole numbers are counts."""
_ENDS = (0.05, 0.95)
"""Quantiles of the lengths that must be possible in a unit."""
_NO_OFFSET = (
    "no offset: readings are taken for lengths from joint to joint. Of a logger with another zero "
    "state the length of each strut at reading 0, offset: [L1, …, L6], or offset: home"
)
_CROSSES = (
    "offset: home: readings cross zero, so that they are no lengths from joint to joint. The zero "
    "is assumed at the robot's home; otherwise state the length of each strut at reading 0, "
    "offset: [L1, …, L6]"
)
_MOVES = 0.02
"""Largest motion, as a share of the stroke, that does not confirm a unit."""


def _check_lengths(
    table: RawTable, guess: DataGuess, units: dict[str, str], robot: ResolvedRobot | None
) -> None:
    """Add the unit of the lengths, and their zero, with which they fit the robot."""
    values = np.array([table.values[channel] for channel in LENGTH_CHANNELS])
    middle = np.nanmedian(values, axis=1)
    ends = np.nanquantile(values, _ENDS, axis=1)
    stated = units.get("q") or table.columns[LENGTH_CHANNELS[0]].unit
    shown = " ".join(f"{one:.4g}" for one in middle)
    if robot is None:
        _leave_zero_open(ends, guess)
        if stated is None:
            guess.questions.append(f"units: {{q: …}}: not stated, m is assumed; around {shown}")
        return
    allowed, conversion = LengthRange.of(robot), ActuatorUnits(robot)
    if stated and conversion.missing(stated):
        _leave_zero_open(ends, guess)
        return  # `_check_scales` asks for the scale
    home = robot.struts_at(robot.home).lengths
    scales = {
        unit: np.array(conversion.si_values(unit))
        for unit in ((stated,) if stated else _UNITS)
        if not conversion.missing(unit)
    }
    absolute = [unit for unit, scale in scales.items() if np.all(allowed.fits(ends * scale))]
    from_home = [u for u, scale in scales.items() if np.all(allowed.fits(home + ends * scale))]
    if absolute:
        unit = absolute[0]
        guess.facts.append("no offset: the lengths fit the robot's as they are")
    elif from_home:
        # Every smaller unit fits as well.
        unit = max(from_home, key=lambda each: (each != "in", np.max(scales[each])))
        guess.section["offset"] = "home"
        guess.questions.append("offset: home: the axes seem to read zero at the robot's home")
    else:
        guess.questions.append(
            f"offset: …: lengths around {shown} {stated or ''} fit the robot neither from zero nor "
            "from home on: state what each axis reads there, or its unit"
        )
        return
    if stated is not None:
        return
    if scales[unit][0] <= _FINEST and np.array_equal(values, np.round(values), equal_nan=True):
        units["q"] = "counts"
        guess.questions.append(
            f"units: {{q: counts}}: whole numbers without a unit; {unit} would fit the robot, too"
        )
        return
    if unit != "m":
        units["q"] = unit
    others = [one for one in (absolute or from_home) if one != unit]
    moves = np.ptp(ends, axis=0) * scales[unit] > _MOVES * (allowed.upper - allowed.lower)
    if unit != "m" or (others and not np.any(moves)):
        also = f", as {', '.join(others)} would" if others else ""
        guess.questions.append(f"units: {{q: {unit}}}: not stated, fits the robot{also}")


def _leave_zero_open(ends: Array, guess: DataGuess) -> None:
    """Add the zero that is assumed for readings without a known scale."""
    if np.any((ends[0] < 0) & (ends[1] > 0)):
        guess.section["offset"] = "home"
        guess.questions.append(_CROSSES)
    else:
        guess.facts.append(_NO_OFFSET)


_NEEDS: dict[Quantity | None, str] = {
    ANGLE: "the robot file has to state the lead",
    TORQUE: "the robot file has to state the lead",
    CURRENT: "force_constants: one value or six, in N/A, or the motor in the robot file's drive",
    **dict.fromkeys(VOLTAGE_KINDS, "the robot file has to state the motor of the drive"),
}
"""Conversions that need the robot, which is not given."""


def _check_scales(guess: DataGuess, units: dict[str, str], robot: ResolvedRobot | None) -> None:
    """Add the conversions of units that the section or the robot file lacks."""
    for group in ("q", "Q"):
        unit = units.get(group, "")
        conversion = ActuatorUnits(robot, supply_recorded=SUPPLY in units)
        if unit and (missing := conversion.missing(unit)):
            guess.questions.append(f"{group} in {unit}: {missing[1]}")
        elif robot is None and (needed := _NEEDS.get(quantity_of_unit(unit))):
            guess.questions.append(f"{group} in {unit}: {needed}")
