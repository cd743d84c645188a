"""The result of an export: the motion, and every controller table that holds it.

`exports.json` has it for programs, `README.txt` for people.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from constraints.arrays import Array
from expdesign.export.definition import Task, scaled_in_words
from expdesign.export.exporting import Export
from expdesign.export.read_back import LimitsOfMotion, TableCheck
from expdesign.mechanism.hexapod import COORDINATE_NAMES, actuator_names
from expdesign.motion.executable import ExecutableMotion, LeadRamps, lead_ramps
from expdesign.recheck.limit_check import Unlimited, in_words, unlimited
from expdesign.runfolder import JsonFile, described
from expdesign.templates import text_templates
from expdesign.trajectory import FourierTrajectory

FOLDER, RECORD, README = "exports", "exports.json", "README.txt"

_POINTS = 4001
_Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


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
        LimitsOfMotion | None,
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
        # Without what the check knows of the file alone.
        read_back=TableCheck(**{one.name: getattr(check, one.name) for one in fields(TableCheck)}),
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


_WIDTH = 96


def readme(result: ExportResult) -> str:
    """Return the instructions for every file of an export."""
    motion = result.motion
    environment = text_templates("expdesign.export")
    environment.filters |= {
        "heading": lambda text, line: f"{text}\n{line * len(text)}\n",
        "paragraph": _paragraph,
        "scaled_in_words": scaled_in_words,
    }
    text = environment.get_template("readme.txt.j2").render(
        motion=motion,
        files=result.files,
        scaled=[name for name, file in result.files.items() if file.scale != 1],
        place=", ".join(f"{1e3 * value:.6g}" for value in motion.home[:3]),
        turn=", ".join(f"{math.degrees(value):.6g}" for value in motion.home[3:]),
        unlimited=in_words(motion.unlimited),
        isfinite=math.isfinite,
    )
    return text.rstrip("\n") + "\n"


def _paragraph(text: str) -> str:
    filled = textwrap.fill(join_words(text), _WIDTH, break_long_words=False, break_on_hyphens=False)
    return f"{filled}\n\n"
