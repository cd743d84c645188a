"""Controller tables: rows of axes, their format, and the settings of an export."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from constraints.arrays import Array
from expdesign.configuration import ExportSection
from expdesign.configuration.export import Space
from expdesign.configuration.quantity import LENGTH
from expdesign.export.rotation import from_roll_pitch_yaw, roll_pitch_yaw
from expdesign.motion.executable import ExecutableMotion
from expdesign.recheck.limit_check import Recheck
from expdesign.robot import Robot

POSE_AXES = ("X", "Y", "Z", "U", "V", "W")
ON_THE_EDGE = 1e-9
"""s; how close to the measurement window's edge a row still belongs to it."""

_MINUS_ZERO = re.compile(r"-(?=0\.?0* )")


class TableError(ValueError):
    """A controller table is not what its controller reads."""


@dataclass(frozen=True, eq=False)
class Rows:
    """Values of a table at each of its times.

    Of a table that repeats a period, only two of the periods are here: `repeated` further ones
    follow the second, with the same values. The times are those without them.
    """

    times: Array
    """(N,), s from the start of the motion."""
    position: Array
    """(N, 6), in the units of the controller's axes."""
    rate: Array | None = None
    acceleration: Array | None = None
    """Rate and acceleration (N, 6), per s and per s²; None when the table has none."""
    columns: Mapping[str, Array] = field(default_factory=dict)
    """Further columns by name, SI, of tables that hold the whole motion."""
    trigger: tuple[float, float] | None = None
    """When the table switches an output on and off again, s; None when it switches none."""
    repeated: int = 0
    """Number of the periods that are left out."""
    block: tuple[int, int] = (0, 0)
    """The row before those that are repeated, and the last of them."""

    @property
    def period(self) -> float:
        """Duration of a repeated period, s."""
        first, last = self.block
        return float(self.times[last] - self.times[first])

    @property
    def left_out(self) -> tuple[int, float]:
        """Number of the rows that are left out, and their duration, s."""
        first, last = self.block
        return self.repeated * (last - first), self.repeated * self.period

    @property
    def count(self) -> int:
        """Number of all rows of the table."""
        return len(self.times) + self.left_out[0]

    @property
    def duration(self) -> float:
        """Time of the last row, s."""
        return float(self.times[-1]) + self.left_out[1]

    def true_times(self, times: ArrayLike) -> Array:
        """Return the times in the table, s, of times without the periods that are left out."""
        given = np.asarray(times, dtype=float)
        return np.where(given > self.times[self.block[1]], given + self.left_out[1], given)

    def short_times(self, times: ArrayLike) -> Array:
        """Return the times without the periods that are left out, s, of times in the table."""
        given = np.asarray(times, dtype=float)
        end = float(self.times[self.block[1]])
        if not self.repeated:
            return given
        inside = end - self.period + np.mod(given - end, self.period)
        moved = np.where(given < end + self.left_out[1], inside, given - self.left_out[1])
        return np.where(given <= end, given, moved)

    def time_of(self, number: int) -> float:
        """Return the time in the table, s, of the row with this number, from 0."""
        _, last = self.block
        left_out, duration = self.left_out
        if number <= last or number >= last + left_out:
            index = number if number <= last else number - left_out
            return float(self.times[index]) + (0.0 if number <= last else duration)
        periods, place = divmod(number - last, left_out // self.repeated)
        return float(self.times[self.block[0] + place]) + (1 + periods) * self.period

    def short_window(self, window: tuple[float, float]) -> tuple[float, float]:
        """Return a measurement window without the periods that are left out, s."""
        first, last = window
        return first, last - self.left_out[1]

    def parts(self) -> Iterator[Rows]:
        """Yield all rows of the table in parts; each begins with the last row of the one before.

        The parts are the beginning with two periods, each further period, and the end.
        """
        first, last = self.block
        if not self.repeated:
            yield self
            return
        yield self.part(0, last)
        for k in range(1, self.repeated + 1):
            yield self.part(first, last, k * self.period)
        yield self.part(last, len(self.times), self.left_out[1])

    def part(self, first: int, last: int, delay: float = 0.0) -> Rows:
        """Return rows from the first to the last, delayed by a time, s."""
        numbers = np.arange(first, min(last + 1, len(self.times)))
        return self._select(numbers, self.times[numbers] + delay)

    def _select(self, numbers: NDArray[np.intp], times: Array) -> Rows:
        columns = {name: values[numbers] for name, values in self.columns.items()}
        return Rows(
            times,
            self.position[numbers],
            None if self.rate is None else self.rate[numbers],
            None if self.acceleration is None else self.acceleration[numbers],
            columns | ({"t": times} if "t" in columns else {}),
        )

    def every_time(self) -> Iterator[float]:
        """Yield the times of all rows of the table, s."""
        for number, part in enumerate(self.parts()):
            yield from part.times[1 if number else 0 :].tolist()

    def expanded(self) -> Rows:
        """Return the rows with all periods."""
        first, last = self.block
        count, behind = last - first, len(self.times) - last - 1
        numbers = np.arange(len(self.times))
        again = np.tile(numbers[first + 1 : last + 1], self.repeated)
        numbers = np.concatenate([numbers[: last + 1], again, numbers[last + 1 :]])
        delays = np.repeat(
            self.period * np.array([0, *range(1, self.repeated + 1), self.repeated]),
            [last + 1, *[count] * self.repeated, behind],
        )
        return self._select(numbers, self.times[numbers] + delays)

    @property
    def velocities(self) -> Array:
        """The rates of a table that has to have them."""
        if self.rate is None:
            raise ValueError("the table needs velocities")
        return self.rate

    @property
    def accelerations(self) -> Array:
        """The accelerations of a table that has to have them."""
        if self.acceleration is None:
            raise ValueError("the table needs accelerations")
        return self.acceleration

    def checked(self) -> Rows:
        """Return the rows; a `TableError` names the first that is not complete, finite or later."""
        count = len(self.times)
        if count < 2:  # noqa: PLR2004 - a start and an end
            raise TableError(f"the table has {count} row(s)")
        columns = {
            "time": self.times[:, None],
            "position": self.position,
            "velocity": self.rate,
            "acceleration": self.acceleration,
            **{name: values[:, None] for name, values in self.columns.items()},
        }
        for name, values in columns.items():
            if values is None:
                continue
            if len(values) != count:
                raise TableError(f"{name}: {len(values)} rows where there are {count} times")
            wrong = np.flatnonzero(~np.all(np.isfinite(values), axis=1))
            if wrong.size:
                raise TableError(f"row {wrong[0] + 1}: the {name} is not a finite number")
        late = np.flatnonzero(np.diff(self.times) <= 0)
        if late.size:
            raise TableError(f"row {late[0] + 2}: its time is not after that of the row before")
        return self


def in_window(times: Array, window: tuple[float, float]) -> NDArray[np.bool_]:
    """Return which times are in the measurement window, its end excluded."""
    first, last = window
    return (times >= first - ON_THE_EDGE) & (times < last - ON_THE_EDGE)


def edge_rows(rows: Rows, window: tuple[float, float]) -> tuple[int, int]:
    """Return the numbers of the rows that are closest to the window's beginning and end, s.

    Both have a row behind them.
    """
    edges = rows.short_window(window)
    first, last = (int(np.argmin(np.abs(rows.times[:-1] - edge))) for edge in edges)
    return first, last + rows.left_out[0]


def round_up(value: float) -> float:
    """Return a positive number, rounded up to two digits.

    >>> round_up(0.0857), round_up(12.01)
    (0.086, 13.0)
    """
    unit = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{unit * np.ceil(value / unit * (1 - 1e-9)):.2g}")


def scaled_in_words(factor: float) -> str:
    """Describe a table whose motion is scaled by F, 0 < F < 1, in the characters of any comment."""
    return (
        f"scaled by {factor:g} for a first run: distances from home times {factor:g}, speeds times "
        f"{factor**2:.3g}, accelerations times {factor**3:.3g}"
    )


LENGTH_UNITS = {unit: 1 / LENGTH.parse(f"1 {unit}") for unit in ("m", "mm", "um", "in")}
ANGLE_UNITS = {"rad": 1.0, "deg": 180 / np.pi}


@dataclass(frozen=True, eq=False)
class Axes:
    """Six axes of a controller.

    position of axis k = sign · (coordinate − zero) · scale, of the coordinate that it moves.
    """

    space: Space
    names: tuple[str, ...]
    units: tuple[str, ...]
    source: NDArray[np.intp]
    """(6,), index of the strut, or of the pose's coordinate, that each axis moves."""
    factor: Array
    """(6,), units of the axis for 1 m or 1 rad of its coordinate, with the sign."""
    zero: Array
    """(6,), coordinate at which the axis reads zero, m or rad."""
    fixed: bool = False
    """Whether the rotations are roll, pitch and yaw about fixed axes; such a table holds positions
    only."""

    def rows(
        self,
        times: Array,
        coordinates: Array,
        rates: Array | None = None,
        accelerations: Array | None = None,
    ) -> Rows:
        """Return what the axes do for coordinates (N, 6) and their derivatives, SI."""
        if self.fixed:
            rates = accelerations = None
            angles = roll_pitch_yaw(coordinates[:, 3:])
            coordinates = np.concatenate([coordinates[:, :3], angles], axis=1)
        return Rows(
            times,
            (coordinates - self.zero)[:, self.source] * self.factor,
            None if rates is None else rates[:, self.source] * self.factor,
            None if accelerations is None else accelerations[:, self.source] * self.factor,
        )

    def coordinates(self, position: Array) -> Array:
        """Return the coordinates (N, 6), SI, of the axes' positions."""
        values = self.derivatives(position) + self.zero
        if self.fixed:
            values[:, 3:] = from_roll_pitch_yaw(values[:, 3:])
        return values

    def derivatives(self, values: Array) -> Array:
        """Return the coordinates' derivatives (N, 6), SI, of those of the axes."""
        found = np.empty_like(values)
        found[:, self.source] = values / self.factor
        return found


class Interpolation(Enum):
    """The path between two rows; its value is the word for it."""

    LINEAR = "straight lines between the rows"
    CUBIC = "cubic Hermite polynomials of position and velocity"
    QUINTIC = "quintic Hermite polynomials of position, velocity and acceleration"


@dataclass(frozen=True, eq=False)
class Task:
    """The motion to be exported, and what is measured while a machine executes it."""

    name: str
    robot: Robot
    motion: ExecutableMotion
    controller_period: float
    """Of the controller, s."""
    sampling: float
    """Of the measurement, Hz."""
    parameters: tuple[str, ...]
    """Those that the design judges."""
    force_covariance: Array | None = None
    """(6, 6), Σ, N²; without it nothing is said about information."""
    made_from: str = ""
    """Hash of the inputs of the motion; empty if not needed."""
    check: Recheck | None = None
    """Proved limits of the motion from rest to rest; None if not needed."""


@dataclass(frozen=True, eq=False)
class Settings:
    """One export with every default filled in."""

    section: ExportSection
    form: TableFormat
    task: Task
    axes: Axes
    digits: int | None
    """After the decimal point; None: all of a double."""
    step: float | None
    """Time between rows, s; None for rows at individual times."""
    tolerance: float
    """Largest deviation of a strut's length from the design, m."""
    start: Array
    """(6,), position of the axes at home, as it is written."""

    @property
    def window(self) -> tuple[float, float]:
        """Beginning and end of the measurement window, s."""
        return self.task.motion.window

    @property
    def title(self) -> str:
        """Title of the table for its first line: the run's name, and a scale other than 1."""
        factor = self.section.factor
        scaled = "" if factor == 1 else f", {scaled_in_words(factor)}"
        return f"{self.task.name}{scaled}"

    @property
    def half_unit(self) -> float:
        """Half a unit of the last digit; 0 where all digits are written."""
        return 0.0 if self.digits is None else 0.5 * 10.0**-self.digits

    def number(self, value: float) -> str:
        """Return a number with its digits; never "-0"."""
        if self.digits is None:
            return repr(float(value))
        text = f"{value:.{self.digits}f}"
        return text.removeprefix("-") if not text.strip("-0.") else text

    def numbers(self, values: Array) -> list[str]:
        """Return the numbers of a row, (k,), each as `number`."""
        if self.digits is None:
            return [self.number(value) for value in values]
        row = f"%.{self.digits}f " * len(values) % tuple(values)
        return _MINUS_ZERO.sub("", row).split()


def round_to_clock(times: Array, _settings: Settings, *, ticks: int) -> Array:
    """Return times (N,), s, rounded to a clock of so many ticks per second.

    The times count from the beginning of the table, so that rounding errors do not accumulate.
    """
    return np.rint(times * ticks) / ticks


# Formats are pickled with the tables of worker processes: their functions have names.
def _keep_times(times: Array, _settings: Settings) -> Array:
    return times


def _no_values(_settings: Settings) -> Mapping[str, str]:
    return {}


@dataclass(frozen=True)
class ControllerModel:
    """Execution of a table by a controller that plans between the rows itself."""

    execute: Callable[[Rows, Settings], tuple[Rows, Array]]
    """Rows in every cycle of the controller, and the times (N,), s, of the table's rows in it."""
    choose_times: Callable[[Settings, str], Array]
    """Times of the rows with which the controller follows; the place of the section in the run file
    is for messages."""
    tolerance: Callable[[Task], float]
    """Largest deviation of a strut's length unless one is given, m."""
    condition: Callable[[Settings], str]
    """Advice for a motion that the controller does not follow."""


@dataclass(frozen=True)
class TableFormat:
    """A file format for controller tables, with the model of the controller that executes it.

    Digits, units and names of axes are defaults.
    """

    name: str
    """Value of `export.format` in the run file."""
    title: str
    suffix: str
    interpolation: Interpolation
    write: Callable[[Path, Rows, Settings], None]
    read: Callable[[Path, Settings], Rows]
    """Read rows back; raises `TableError` for what the controller would not read, or would read
    otherwise."""
    options: type[ExportSection]
    """Options of the format in the run file."""
    guide: str
    """How to run the file, as a template with the blocks of `templates/guide.txt.j2`."""
    clock: str
    """Resolution of the controller's row times."""
    guide_values: Callable[[Settings], Mapping[str, str]] = _no_values
    """Further values for the guide."""
    capacity: str = "not known"
    """The controller's limits of rows, times and numbers."""
    executed: str = "a model of the interpolation"
    """What has executed tables of this format: the program, or a model of the controller."""
    digits: int | None = 6
    """After the decimal point, for millimetres."""
    count_digits: int = 3
    """The same for counts."""
    units: str = "mm"
    angles: str = "deg"
    axes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Names of the axes by space."""
    written_times: Callable[[Array, Settings], Array] = _keep_times
    """Times (N,), s, as the file states them and the controller keeps them."""
    may_crash: str = ""
    """Program that reads a file, ``sys.argv[1]``, as `read` does, for libraries that may end the
    process on damaged ones: what others may have changed is given to it first."""
    repeats: bool = False
    """Whether `write` and `read` know rows that leave out repeated periods."""
    uniform: bool = False
    """Whether all rows have one distance in time."""
    fixed_angles: bool = False
    """Whether its rotations are roll, pitch and yaw about fixed axes."""
    whole: bool = False
    """Whether the table also holds pose, struts and forces in SI units."""
    controller: ControllerModel | None = None
    """None: the controller moves on `interpolation`."""
    companions: Mapping[str, Callable[[Rows, Settings], list[str]]] = field(default_factory=dict)
    """Lines of further files by their ending, which stands behind the table's name without its
    own; a file without lines is not written."""


def switching(rows: Rows, settings: Settings, commands: tuple[str, str]) -> dict[int, str]:
    """Return the commands that switch the output on and off, by the row behind which they stand.

    Without a trigger there are none.
    """
    if settings.section.trigger is None:
        return {}
    return dict(zip(edge_rows(rows, settings.window), commands, strict=True))


def switched_at(found: Sequence[tuple[int, bool]], rows: Rows) -> Rows:
    """Return the rows with the times at which the output is switched; unchanged without commands.

    `found` has the number of the row before each command, and whether it switches the output on.
    """
    if not found:
        return rows
    numbers = [row for row, _ in found]
    if [on for _, on in found] != [True, False] or not 0 <= numbers[0] < numbers[
        1
    ] < rows.count - 1:
        raise TableError("the output is not switched on once and off once, each before a move")
    on, off = (rows.time_of(number) for number in numbers)
    return replace(rows, trigger=(on, off))
