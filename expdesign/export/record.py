"""`exports.json`, or ``<table>.json`` beside a table: what the tables are, for programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from expdesign.export.certification import LIMIT_SHARE
from expdesign.export.definition import Task
from expdesign.export.execution import InformationChange
from expdesign.export.exporting import Export
from expdesign.export.read_back import LOG_DET_CHANGE, STD_SHARE, limits_in_words
from expdesign.export.row_times import SHARE
from expdesign.mechanism.hexapod import COORDINATE_NAMES, numbered
from expdesign.motion.record import RecordedMotion
from expdesign.recheck.limit_check import TOLERANCE, Unlimited, unlimited
from expdesign.runfolder import JsonFile, OpenNumber, copied, described

FOLDER, RECORD = "exports", "exports.json"

_POINTS = 4001
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


@dataclass(frozen=True)
class MotionEntry:
    """The motion that all tables hold; SI and radians.

    It is measured in `window`, (begin, end), at the rate `sampling`, Hz; `home` is a pose, (6,).
    `made_from` is the hash of configuration, design and versions. There are no `ways`, from rest
    and back, for ramps of another kind. `unlimited` is what the motion, ways included, does where
    neither robot nor run limit it.
    """

    name: str
    robot: str
    units: str
    duration: float
    window: tuple[float, float]
    periods: int
    period: float
    sampling: _Positive
    controller_period: _Positive
    home: tuple[float, ...]
    made_from: str
    ways: RecordedMotion | None
    # What it reaches follows from the motion; earlier versions did not say it.
    unlimited: tuple[Unlimited, ...] | None = field(default=None, compare=False)
    # Whether every limit is proved to be kept at every instant from rest to rest, and by how much.
    certified: bool | None = field(default=None, compare=False)
    limits: dict[str, LimitEntry] | None = field(default=None, compare=False)

    @classmethod
    def of(cls, task: Task) -> MotionEntry:
        """Return the entry of a task's motion."""
        return copied(
            cls,
            task.motion,
            task,
            robot=task.robot.name,
            units="SI and radians, unless stated",
            period=task.motion.trajectory.period,
            home=tuple(task.robot.home.tolist()),
            certified=None if task.check is None else task.check.certified,
            limits=None
            if task.check is None
            else {
                one.key: copied(LimitEntry, one, tolerance=TOLERANCE) for one in task.check.limits
            },
            ways=RecordedMotion.of(task.motion),
            unlimited=unlimited(
                task.robot, task.motion, np.linspace(0.0, task.motion.duration, _POINTS)
            ),
        )


@dataclass(frozen=True)
class AxisEntry:
    """An axis of a table: what it moves, its unit, and where it stands at home."""

    name: str
    unit: str
    moves: str
    start: float


@dataclass(frozen=True)
class LimitEntry:
    """The worst moment of a limit, the table executed; `violation` is a share of its range.

    `proved` is the same of what no instant exceeds, over `cells` of time, of which `open_time`, s,
    was left undecided; NaN where nothing was to be proved.
    """

    value: OpenNumber
    bound: OpenNumber
    unit: str
    row: str
    time: OpenNumber
    violation: OpenNumber
    tolerance: float = LIMIT_SHARE
    kept: bool | None = None
    proved: OpenNumber = np.nan
    certified: bool | None = None
    cells: int = 0
    open_time: OpenNumber = 0.0
    stated: OpenNumber = np.nan
    reserve: float = 0.0


@dataclass(frozen=True)
class Tolerances:
    """What a table was held against."""

    position: float
    acceleration_and_force_share: float = SHARE
    limit_share: float = LIMIT_SHARE
    log_det: float = LOG_DET_CHANGE
    std_share: float = STD_SHARE


@dataclass(frozen=True)
class CheckEntry:
    """What a table does when it is executed: largest deviations from the design, and limits.

    The rows' error is in half units of the last digit, those of a strut are in m and m/s, or
    shares of their limits' range: NaN without such a limit.
    """

    points: int
    row_error: float
    position_error: float
    velocity_error: float
    acceleration_error_share: OpenNumber
    force_error_share: OpenNumber
    limits: dict[str, LimitEntry]
    information: InformationChange | None
    tolerances: Tolerances
    # A record of an earlier version does not say it.
    limits_in_words: str = "every limit kept within its tolerance"
    # Whether all limits but the `sampled` are proved to be kept at every instant
    certified: bool | None = None
    sampled: tuple[str, ...] = ()


@dataclass(frozen=True)
class FileEntry:
    """A table: its axes, rows and options, how to run it, and what reading it back showed.

    Its digits are those after the decimal point; None: all of a double. Its motion is home +
    F (λ(F t) − home) of the record's motion λ, with the `scale` F. Files that belong to it are
    `beside` it; its `trigger` is when an output is switched on and off, s from the start.
    """

    sha256: str
    format: str
    title: str
    guide: str
    axes: tuple[AxisEntry, ...]
    options: dict[str, Any]
    digits: int | None
    rows: int
    shortest_step: float
    longest_step: float
    duration: float
    interpolation: str
    read_back: CheckEntry
    # Tables of earlier versions are as fast as the design, and switch nothing.
    scale: float = 1.0
    beside: tuple[str, ...] = ()
    trigger: tuple[float, float] | None = None

    def window(self, motion: MotionEntry) -> tuple[float, float]:
        """Return when the measurement window begins and ends in this table, s."""
        begin, end = motion.window
        return begin / self.scale, end / self.scale

    @classmethod
    def of(cls, export: Export) -> FileEntry:
        """Return the entry of a file that was written and checked."""
        settings, check = export.settings, export.check
        form, axes, off = settings.form, settings.axes, check.deviation
        moved = COORDINATE_NAMES if axes.space == "pose" else numbered("q")
        step = f"{1e3 * check.longest_step:.6g} ms"
        entries = zip(axes.names, axes.units, axes.source, settings.start, strict=True)
        return copied(
            cls,
            check,
            sha256=export.digest,
            format=settings.section.format,
            title=form.title,
            guide=_guide(export, step),
            beside=tuple(path.name for path in export.beside),
            trigger=check.trigger,
            axes=tuple(
                AxisEntry(name, unit, moved[source], float(start))
                for name, unit, source, start in entries
            ),
            options=settings.section.model_dump(exclude_none=True),
            digits=settings.digits,
            interpolation=form.interpolation.value,
            scale=settings.section.factor,
            read_back=copied(
                CheckEntry,
                check,
                position_error=off.position,
                velocity_error=off.velocity,
                acceleration_error_share=off.acceleration,
                force_error_share=off.force,
                limits={
                    one.key: copied(LimitEntry, one, tolerance=LIMIT_SHARE) for one in check.limits
                },
                tolerances=Tolerances(settings.tolerance),
                limits_in_words=limits_in_words(check.certificate),
                certified=check.certificate.certified,
                sampled=check.certificate.sampled,
            ),
        )


def _guide(export: Export, step: str) -> str:
    """Return how to run the file, in plain words."""
    form, names = export.settings.form, export.settings.axes.names
    beside = ", ".join(path.name for path in export.beside)
    text = form.guide.format(axes=", ".join(names), step=step, file=export.path.name, beside=beside)
    if export.check.trigger is None:
        return text
    on, off = (f"{time:.6f}" for time in export.check.trigger)
    number = export.settings.section.trigger
    switched = form.trigger.format(number=number, on=on, off=off, beside=beside)
    return f"{text} {switched}"


@dataclass(frozen=True, eq=False)
class ExportsRecord(JsonFile):
    """What the tables of a folder are."""

    FILE: ClassVar[str] = f"{FOLDER}/{RECORD}"
    WRITTEN_BY: ClassVar[str] = "`expdesign export`"
    motion: Annotated[MotionEntry, described("", "the motion that all tables hold")]
    files: Annotated[Mapping[str, FileEntry], described("", "the tables by their names")]


def record_of_one(path: Path) -> Path:
    """Return where the record of a table stands that is in a folder of the user's."""
    return path.with_name(f"{path.name}.json")
