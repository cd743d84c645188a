"""What a format is, and what one export in it has been asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import ExportSection
from expdesign.export.axes import Axes
from expdesign.export.execution import Interpolation
from expdesign.export.rows import Rows
from expdesign.motion import ExecutableMotion
from expdesign.robot import Robot

POSE_AXES = ("X", "Y", "Z", "U", "V", "W")


@dataclass(frozen=True, eq=False)
class Task:
    """The motion to be exported, and what is measured while a machine executes it.

    Attributes
    ----------
    name : str
        Of the run.
    controller_period : float
        s.
    sampling : float
        Of the measurement, Hz.
    parameters : tuple of str
        Names of those that the design judges.
    force_covariance : (6, 6) or None
        Σ, N²; without it nothing is said about information.
    made_from : str
        Hash of what the motion was made from; empty where nobody asks.
    """

    name: str
    robot: Robot
    motion: ExecutableMotion
    controller_period: float
    sampling: float
    parameters: tuple[str, ...]
    force_covariance: Array | None = None
    made_from: str = ""


@dataclass(frozen=True, eq=False)
class Settings:
    """One export with every default filled in.

    Attributes
    ----------
    name : str
        Of the run.
    digits : int or None
        After the decimal point; None: all of a double.
    step : float or None
        Time between rows, s; None where each row has a time of its own.
    tolerance : float
        Largest deviation of a strut's length from the design, m.
    start : (6,)
        Position of the axes at home, as it is written.
    window : (2,)
        Beginning and end of the measurement window, s.
    duration : float
        Of the motion, s.
    sampling : float
        Of the measurement, Hz.
    """

    section: ExportSection
    form: TableFormat
    name: str
    axes: Axes
    digits: int | None
    step: float | None
    tolerance: float
    start: Array
    window: tuple[float, float]
    duration: float
    sampling: float

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
        return [self.number(value) for value in values]


def rounded_times(digits: int) -> Callable[[Array], Array]:
    """Return what rounds times to digits of a second after the decimal point."""
    return partial(_rounded, digits=digits)


def _rounded(times: Array, digits: int | None = None) -> Array:
    return times if digits is None else np.round(times, digits)


@dataclass(frozen=True)
class TableFormat:
    """A file format for controller tables.

    Attributes
    ----------
    name, title : str
        As in the YAML, and in words.
    suffix : str
        Ending of its files.
    interpolation : Interpolation
        What the controller does between rows.
    write : callable
        Write rows to a path.
    read : callable
        Read them back; raises `TableError` for what the controller would not read, or would read
        otherwise.
    guide : str
        How to run the file, in plain words; ``{first_axis}`` and the like are filled in.
    digits : int or None
        Default digits after the decimal point, for millimetres.
    units, angles : str
        Default units.
    axes : dict
        Default names of the axes by space.
    written_times : callable
        Times (N,) as the file can state them.
    uniform : bool
        Whether all rows have one distance in time.
    fixed_angles : bool
        Whether its rotations are roll, pitch and yaw about fixed axes.
    whole : bool
        Whether the table also holds pose, struts and forces in SI units.
    """

    name: str
    title: str
    suffix: str
    interpolation: Interpolation
    write: Callable[[Path, Rows, Settings], None]
    read: Callable[[Path, Settings], Rows]
    guide: str
    digits: int | None = 6
    units: str = "mm"
    angles: str = "deg"
    axes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    written_times: Callable[[Array], Array] = _rounded
    uniform: bool = False
    fixed_angles: bool = False
    whole: bool = False
