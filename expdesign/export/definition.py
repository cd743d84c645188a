"""Controller tables: rows of axes, their format, and the settings of an export."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.configuration import ExportSection
from expdesign.configuration.export import Space
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
    """Values of a table at each of its times."""

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


def edge_rows(times: Array, window: tuple[float, float]) -> tuple[int, int]:
    """Return the rows whose times (N,) are closest to the window's beginning and end, s.

    Both have a row behind them.
    """
    first, last = (int(np.argmin(np.abs(times[:-1] - edge))) for edge in window)
    return first, last


def scaled_in_words(factor: float) -> str:
    """Say what a table holds whose motion is scaled by F, 0 < F < 1, as any comment can hold it."""
    return (
        f"scaled by {factor:g} for a first run: the way from home times {factor:g}, speeds times "
        f"{factor**2:.3g}, accelerations times {factor**3:.3g}"
    )


LENGTH_UNITS = {"m": 1.0, "mm": 1e3, "um": 1e6, "in": 1 / 0.0254}
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


def on_grid(ticks: int) -> Callable[[Array, Settings], Array]:
    """Return the function that rounds times (N,), s, to a clock of so many ticks per second.

    The times count from the beginning of the table, so that rounding errors do not accumulate.
    """
    return lambda times, _settings: np.rint(times * ticks) / ticks


@dataclass(frozen=True)
class Guide:
    """Instructions for a table, in the order in which they are followed.

    Each is a text of paragraphs with blank lines between them; a paragraph with an indent of four
    spaces is a command. ``{axes}``, ``{step}``, ``{file}``, ``{stem}``, ``{start}``,
    ``{positions}`` (of the start) and ``{beside}`` (the companion files) are filled in.
    """

    before: str
    load: str
    run: str
    slow: str = ""
    record: str = ""
    afterwards: str = ""


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
    guide: Guide
    """How to run the file."""
    clock: str
    """Resolution of the controller's row times."""
    guide_values: Callable[[Settings], Mapping[str, str]] = lambda _settings: {}
    """Further values for the guide by their names in it."""
    capacity: str = "not known"
    """The controller's limits of rows, times and numbers."""
    executed: str = "a model of the interpolation"
    """What has executed tables of this format: the program, or a model of the controller."""
    digits: int | None = 6
    """After the decimal point, for millimetres."""
    units: str = "mm"
    angles: str = "deg"
    axes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Names of the axes by space."""
    written_times: Callable[[Array, Settings], Array] = lambda times, _settings: times
    """Times (N,), s, as the file states them and the controller keeps them."""
    may_crash: str = ""
    """Program that reads a file, ``sys.argv[1]``, as `read` does, for libraries that may end the
    process on damaged ones: what others may have changed is given to it first."""
    uniform: bool = False
    """Whether all rows have one distance in time."""
    fixed_angles: bool = False
    """Whether its rotations are roll, pitch and yaw about fixed axes."""
    whole: bool = False
    """Whether the table also holds pose, struts and forces in SI units."""
    trigger: str = ""
    """How the output is switched, in plain words, for `guide`; ``{number}``, ``{on}``, ``{off}``
    and ``{beside}`` are filled in."""
    beside: Mapping[str, Callable[[Rows, Settings], list[str]]] = field(default_factory=dict)
    """Lines of further files by their ending, which stands behind the table's name without its
    own; a file without lines is not written."""


def switching(rows: Rows, settings: Settings, commands: tuple[str, str]) -> dict[int, str]:
    """Return the commands that switch the output on and off, by the row behind which they stand.

    Without a trigger there are none.
    """
    if settings.section.trigger is None:
        return {}
    return dict(zip(edge_rows(rows.times, settings.window), commands, strict=True))


def switched_at(found: Sequence[tuple[int, bool]], times: Array) -> tuple[float, float] | None:
    """Return when the output is on, s; None where it is never switched.

    Parameters
    ----------
    found : sequence of (int, bool)
        The row behind which each command stands, and whether it switches the output on.
    times : (N,)
        Of the rows, s.
    """
    if not found:
        return None
    rows = [row for row, _ in found]
    if [on for _, on in found] != [True, False] or not 0 <= rows[0] < rows[1] < len(times) - 1:
        raise TableError("the output is not switched on once and off once, each before a move")
    return float(times[rows[0]]), float(times[rows[1]])
