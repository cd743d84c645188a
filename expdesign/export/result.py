"""The result of an export, `exports.json`: the motion, and every controller table that holds it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator, Field, PlainSerializer

from constraints.arrays import Array
from expdesign.export.certification import LIMIT_SHARE
from expdesign.export.definition import Task
from expdesign.export.execution import InformationChange
from expdesign.export.exporting import Export
from expdesign.export.read_back import (
    LOG_DET_CHANGE,
    STD_SHARE,
    ControllerCheck,
    ReadBack,
    limits_in_words,
)
from expdesign.export.row_times import SHARE
from expdesign.mechanism.hexapod import COORDINATE_NAMES, actuator_names
from expdesign.motion.executable import ExecutableMotion, LeadRamps, lead_ramps
from expdesign.recheck.limit_check import TOLERANCE, LimitCheck, Unlimited, unlimited
from expdesign.runfolder import JsonFile, OpenNumber, described
from expdesign.templates import text_templates
from expdesign.trajectory import FourierTrajectory

FOLDER, RECORD, README = "exports", "exports.json", "README.txt"

_POINTS = 4001
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


def _limit_keys(tolerance: float) -> Callable[[Iterable[LimitCheck]], dict[str, Any]]:
    def write(checks: Iterable[LimitCheck]) -> dict[str, Any]:
        found = {}
        for check in checks:
            columns = asdict(check)
            for name in ("key", "title", "origin"):
                del columns[name]
            judged = {"tolerance": tolerance, "kept": check.kept, "certified": check.certified}
            found[check.key] = columns | judged
        return found

    return write


def _limit_rows(limits: object) -> object:
    if not isinstance(limits, dict):
        return limits
    return [
        {"key": key, "title": key, "origin": "", **value} if isinstance(value, dict) else value
        for key, value in limits.items()
    ]


# In the file the limits are keys, each with its tolerance and verdict.
_LimitsOfMotion = Annotated[
    tuple[LimitCheck, ...], BeforeValidator(_limit_rows), PlainSerializer(_limit_keys(TOLERANCE))
]
_LimitsOfTable = Annotated[
    tuple[LimitCheck, ...], BeforeValidator(_limit_rows), PlainSerializer(_limit_keys(LIMIT_SHARE))
]


@dataclass(frozen=True)
class ExportedMotion:
    """The motion of all tables, from rest to rest; SI and radians."""

    name: Annotated[str, described("", "name of the run")]
    robot: Annotated[str, described("", "name of the robot")]
    units: Annotated[str, described("", "of all values")]
    duration: Annotated[float, described("s", "from rest to rest")]
    window: Annotated[
        tuple[float, float], described("s", "beginning and end of the measurement window")
    ]
    periods: Annotated[int, described("1", "number of periods")]
    period: Annotated[float, described("s", "duration of a period")]
    sampling: Annotated[_Positive, described("Hz", "rate of the recording")]
    controller_period: Annotated[_Positive, described("s", "step of the controller")]
    home: Annotated[tuple[float, ...], described("m, rad", "pose of the TCP at rest")]
    made_from: Annotated[str, described("", "hash of configuration, design and versions")]
    leads: Annotated[
        LeadRamps | None,
        described(
            "",
            "lead-in and lead-out: `phase` on the orbit [s], `periods`, `ramps` as control points "
            "of quintic B-splines, `before`: number of ramps before the periods; null for ramps "
            "of another kind",
        ),
    ]
    unlimited: Annotated[
        tuple[Unlimited, ...],
        described("", "extreme values of quantities without a limit; `from_home`: counted from it"),
    ] = field(compare=False)
    certified: Annotated[
        bool | None,
        described("", "every limit is proved for every instant; null: not checked"),
    ] = field(compare=False)
    limits: Annotated[
        _LimitsOfMotion | None,
        described("", "by limit the columns of tables/limits.csv, tolerance, kept and certified"),
    ] = field(compare=False)

    def executable(self, trajectory: FourierTrajectory, home: Array) -> ExecutableMotion | None:
        """Return the motion of a design; None if its ramps are unknown, or those of another one."""
        try:
            return None if self.leads is None else self.leads.motion(trajectory, home)
        except ValueError:
            return None


def exported_motion(task: Task) -> ExportedMotion:
    """Describe the motion of a task."""
    motion, check = task.motion, task.check
    times = np.linspace(0.0, motion.duration, _POINTS)
    return ExportedMotion(
        name=task.name,
        robot=task.robot.name,
        units="SI and radians, unless stated",
        duration=motion.duration,
        window=motion.window,
        periods=motion.periods,
        period=motion.trajectory.period,
        sampling=task.sampling,
        controller_period=task.controller_period,
        home=tuple(task.robot.home.tolist()),
        made_from=task.made_from,
        leads=lead_ramps(motion),
        unlimited=unlimited(task.robot, motion, times),
        certified=None if check is None else check.certified,
        limits=None if check is None else check.limits,
    )


@dataclass(frozen=True)
class TableAxis:
    """An axis of a table."""

    name: Annotated[str, described("", "name of the axis")]
    unit: Annotated[str, described("", "unit of its values")]
    moves: Annotated[str, described("", "coordinate or strut that it moves")]
    start: Annotated[float, described("see unit", "position at home")]


@dataclass(frozen=True)
class TableTolerances:
    """Tolerances of the check of a table."""

    position: Annotated[float, described("m", "of a strut's length")]
    acceleration_and_force_share: Annotated[float, described("1", "of the limits' range")] = SHARE
    limit_share: Annotated[float, described("1", "of a limit's range")] = LIMIT_SHARE
    log_det: Annotated[float, described("1", "of log det F")] = LOG_DET_CHANGE
    std_share: Annotated[float, described("1", "of a predicted standard deviation")] = STD_SHARE


@dataclass(frozen=True)
class TableCheck:
    """Deviations of a table, executed as its controller does, from the design, and its limits."""

    points: Annotated[int, described("1", "points of the grid in time")]
    row_error: Annotated[float, described("1", "largest error of a row, half units of last digit")]
    position_error: Annotated[float, described("m", "largest deviation of a strut's length")]
    velocity_error: Annotated[float, described("m/s", "largest deviation of a strut's speed")]
    acceleration_error_share: Annotated[
        OpenNumber, described("1", "of the limit's range; null without the limit")
    ]
    force_error_share: Annotated[
        OpenNumber, described("1", "of the limit's range; null without the limit")
    ]
    limits: Annotated[
        _LimitsOfTable,
        described("", "by limit the columns of tables/limits.csv, tolerance, kept and certified"),
    ]
    information: Annotated[
        InformationChange | None,
        described(
            "",
            "`samples`, `log_det_design`, `log_det_change`, `std_change` as a share, and the "
            "`parameter` with it; null without noise",
        ),
    ]
    controller: Annotated[
        ControllerCheck | None,
        described("", "commanded motion of a controller that plans between the rows; else null"),
    ]
    tolerances: Annotated[TableTolerances, described("", "the tolerances of the check")]
    limits_in_words: Annotated[str, described("", "the verdict on the limits")]
    broken: Annotated[
        tuple[str, ...], described("", "limits that the machine breaks with this table, in words")
    ]
    certified: Annotated[
        bool, described("", "all limits but the `sampled` are proved for every instant")
    ]
    sampled: Annotated[
        tuple[str, ...], described("", "limits that straight lines leave undefined between rows")
    ]


@dataclass(frozen=True)
class ExportedTable:
    """A controller table. Its motion is home + F (λ(F t) − home) of the design's motion λ."""

    sha256: Annotated[str, described("", "digest of the file")]
    format: Annotated[str, described("", "key of the format")]
    title: Annotated[str, described("", "name of the format")]
    guide: Annotated[str, described("", "how to run the file")]
    axes: Annotated[tuple[TableAxis, ...], described("", "the axes")]
    options: Annotated[dict[str, Any], described("", "options of the export")]
    digits: Annotated[int | None, described("1", "after the decimal point; null: all")]
    rows: Annotated[int, described("1", "number of rows")]
    shortest_step: Annotated[float, described("s", "shortest time between two rows")]
    longest_step: Annotated[float, described("s", "longest time between two rows")]
    duration: Annotated[float, described("s", "time of the last row")]
    interpolation: Annotated[str, described("", "path between the rows")]
    read_back: Annotated[TableCheck, described("", "result of executing the table")]
    scale: Annotated[float, described("1", "F; 1: as designed")]
    companions: Annotated[tuple[str, ...], described("", "further files of the table")]
    trigger: Annotated[
        tuple[float, float] | None, described("s", "when an output is switched on and off")
    ]

    def window(self, motion: ExportedMotion) -> tuple[float, float]:
        """Return the beginning and end of the measurement window in this table, s."""
        begin, end = motion.window
        return begin / self.scale, end / self.scale


def exported_table(export: Export) -> ExportedTable:
    """Describe a file that was written and checked."""
    settings, check = export.settings, export.check
    form, axes = settings.form, settings.axes
    moved = COORDINATE_NAMES if axes.space == "pose" else actuator_names("q")
    entries = zip(axes.names, axes.units, axes.source, settings.start, strict=True)
    return ExportedTable(
        sha256=export.digest,
        format=settings.section.format,
        title=form.title,
        guide=_guide(export),
        axes=tuple(
            TableAxis(name, unit, moved[source], float(start))
            for name, unit, source, start in entries
        ),
        options=settings.section.model_dump(exclude_none=True),
        digits=settings.digits,
        rows=check.rows,
        shortest_step=check.shortest_step,
        longest_step=check.longest_step,
        duration=check.duration,
        interpolation=form.interpolation.value,
        read_back=_table_check(check, settings.tolerance),
        scale=settings.section.factor,
        companions=tuple(path.name for path in export.companions),
        trigger=check.trigger,
    )


def _guide(export: Export) -> str:
    """Return the instructions for running the file: headings, paragraphs and commands.

    Every format has the same headings in the same order.
    """
    settings, check = export.settings, export.check
    start = [settings.number(value) for value in settings.start]
    on, off = (f"{time:.6f}" for time in check.trigger) if check.trigger else ("", "")
    text = (
        text_templates("expdesign.export")
        .from_string(settings.form.guide)
        .render(
            settings=settings,
            periods=settings.task.motion.periods,
            window=settings.window if check.controller is None else check.controller.window,
            axes=", ".join(settings.axes.names),
            reversed=[k for k, factor in enumerate(settings.axes.factor, 1) if factor < 0],
            step=f"{1e3 * check.longest_step:.6g} ms",
            start=" ".join(f"{n} {v}" for n, v in zip(settings.axes.names, start, strict=True)),
            positions=", ".join(start),
            file=export.path.name,
            stem=export.path.stem,
            companions=", ".join(path.name for path in export.companions),
            number=settings.section.trigger,
            on=on,
            off=off,
            **settings.form.guide_values(settings),
        )
    )
    parts = (part.strip("\n") for part in text.split("\n\n"))
    return "\n\n".join(
        part if part.startswith("    ") or part.endswith("~") else join_words(part)
        for part in parts
        if part.strip()
    )


def join_words(text: str) -> str:
    """Return a paragraph of a template as one line."""
    return " ".join(text.split()).replace(" ;", ";").replace(" .", ".")


def _table_check(check: ReadBack, tolerance: float) -> TableCheck:
    off, certificate = check.deviation, check.certificate
    return TableCheck(
        points=check.points,
        row_error=check.row_error,
        position_error=off.position,
        velocity_error=off.velocity,
        acceleration_error_share=off.acceleration,
        force_error_share=off.force,
        limits=check.limits,
        information=check.information,
        controller=check.controller,
        tolerances=TableTolerances(tolerance),
        limits_in_words=limits_in_words(certificate),
        broken=check.broken,
        certified=certificate.certified,
        sampled=certificate.sampled,
    )


@dataclass(frozen=True, eq=False)
class ExportResult(JsonFile):
    """The controller tables of a folder."""

    FILE: ClassVar[str] = f"{FOLDER}/{RECORD}"
    WRITTEN_BY: ClassVar[str] = "`expdesign export`"
    motion: Annotated[ExportedMotion, described("", "the motion of all tables")]
    files: Annotated[Mapping[str, ExportedTable], described("", "the tables by their names")]


def result_file(table: Path) -> Path:
    """Return the path of the result of a single table in a folder of the user's."""
    return table.with_name(f"{table.name}.json")
