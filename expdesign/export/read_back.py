"""The check of a file: read again, executed as its controller does, held against the design."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator, PlainSerializer

from expdesign.export.certification import (
    LIMIT_SHARE,
    PathCertificate,
    certify_table,
    excess_in_words,
    single_cycle_faults,
)
from expdesign.export.definition import Interpolation, Rows, Settings, TableError
from expdesign.export.execution import (
    ExecutedTable,
    InformationChange,
    TableDeviation,
    blocks,
    deviation,
    information_change,
    refine_times,
)
from expdesign.export.repetition import shorten
from expdesign.export.row_times import SHARE, ideal_rows, whole_motion
from expdesign.export.whole_table import controller_faults, find_faults
from expdesign.progress import track
from expdesign.recheck.limit_check import TOLERANCE, LimitCheck, range_share_in_words
from expdesign.robot import ForwardKinematicsError
from expdesign.runfolder import OpenNumber, described

STD_SHARE = 0.01
"""Largest change of a predicted standard deviation, as a share of it."""

LOG_DET_CHANGE = 0.05
"""Largest change of log det F."""

FINER = 10
_FINEST = 1e-3
_LAST_DIGIT = 1.01
_DOUBLE = 1e-12
_COMPUTED = 1e-9


_WIDER = 5.0
"""Tolerances of the information for such a controller, relative to those of other tables."""
_OF_RATES = frozenset({"strut_speed", "strut_acceleration", "actuator_force", "strut_jerk"})


@dataclass(frozen=True)
class ControllerCheck:
    """Motion that a controller commands when it plans between the rows itself."""

    cycle: Annotated[float, described("s", "cycle of the controller")]
    duration: Annotated[float, described("s", "duration of the commanded motion")]
    window: Annotated[
        tuple[float, float], described("s", "beginning and end of the measurement window in it")
    ]
    acceleration: Annotated[
        float, described("m/s^2", "largest acceleration of a strut in a single cycle")
    ]
    designed_acceleration: Annotated[
        float, described("m/s^2", "largest acceleration of a strut in the design")
    ]


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
LimitsOfMotion = Annotated[
    tuple[LimitCheck, ...], BeforeValidator(_limit_rows), PlainSerializer(_limit_keys(TOLERANCE))
]
_LimitsOfTable = Annotated[
    tuple[LimitCheck, ...], BeforeValidator(_limit_rows), PlainSerializer(_limit_keys(LIMIT_SHARE))
]


@dataclass(frozen=True)
class TableTolerances:
    """Tolerances of the check of a table."""

    position: Annotated[float, described("m", "of a strut's length")]
    acceleration_and_force_share: Annotated[float, described("1", "of the limits' range")] = SHARE
    limit_share: Annotated[float, described("1", "of a limit's range")] = LIMIT_SHARE
    log_det: Annotated[float, described("1", "of log det F")] = LOG_DET_CHANGE
    std_share: Annotated[float, described("1", "of a predicted standard deviation")] = STD_SHARE


@dataclass(frozen=True, kw_only=True)
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


@dataclass(frozen=True, kw_only=True)
class ReadBack(TableCheck):
    """A file that was read again and executed."""

    rows: int
    shortest_step: float
    longest_step: float
    """Shortest and longest time between two rows, s."""
    duration: float
    trigger: tuple[float, float] | None
    """When the output of a trigger is switched on and off, s."""
    position_time: float = 0.0
    """When the deviation of a length is largest, s."""
    failures: tuple[str, ...] = ()
    """Excesses over tolerances, in words; empty when the file is good."""


def read_back(path: Path, settings: Settings) -> ReadBack:
    """Read a file, execute it as its controller does, and hold it against design and limits."""
    task = settings.task
    found = ReadBack(
        rows=0,
        shortest_step=np.nan,
        longest_step=np.nan,
        duration=np.nan,
        trigger=None,
        points=0,
        row_error=np.nan,
        position_error=0.0,
        velocity_error=0.0,
        acceleration_error_share=np.nan,
        force_error_share=np.nan,
        limits=(),
        information=None,
        controller=None,
        tolerances=TableTolerances(settings.tolerance),
        limits_in_words="",
        broken=(),
        certified=False,
        sampled=(),
    )
    try:
        rows = settings.form.read(path, settings)
    except TableError as error:
        return replace(found, failures=(f"the file cannot be read: {error}",))
    steps = np.diff(rows.times)
    found = replace(
        found,
        rows=rows.count,
        shortest_step=float(steps.min()),
        longest_step=float(steps.max()),
        duration=rows.duration,
        trigger=rows.trigger,
    )
    if rows.repeated:
        settings = shorten(settings)
    apart, failures = _row_error(rows, settings)
    found = replace(found, row_error=apart)
    try:
        table = ExecutedTable.of(settings, rows)
    except TableError as error:
        return replace(found, failures=(*failures, f"the controller cannot execute it: {error}"))
    failures += find_faults(settings, table)
    if failures:
        # Rows of another motion: what a machine would do with them is not worth computing.
        return replace(found, failures=tuple(failures))
    if table.row_times is not None:
        check, trigger = check_controller(table), table.rows.trigger
        if trigger is not None:
            on, off = (time - table.rows.times[0] for time in trigger)
            trigger = float(on), float(off)
        broken = tuple(single_cycle_faults(table))
        found = replace(found, controller=check, trigger=trigger, broken=broken)
        failures += controller_faults(table)
    try:
        found = _add_execution(found, table)
        failures += _beyond(found, table, settings)
        found = replace(found, information=information_change(table, task))
    except (ForwardKinematicsError, np.linalg.LinAlgError) as trouble:
        failures.append(f"the file cannot be executed: {trouble}")
    if found.information is not None:
        wider = 1.0 if found.controller is None else _WIDER
        failures += _information_lost(found.information, wider)
    return replace(found, failures=tuple(failures))


def _row_error(rows: Rows, settings: Settings) -> tuple[float, list[str]]:
    """Return the largest error of the rows, relative to its tolerance, and its description."""
    ideal = ideal_rows(settings, rows.times)
    worst, failures = 0.0, []
    pairs = [("position", rows.position, ideal.position)]
    if rows.rate is not None and ideal.rate is not None:
        pairs.append(("velocity", rows.rate, ideal.rate))
    if rows.acceleration is not None and ideal.acceleration is not None:
        pairs.append(("acceleration", rows.acceleration, ideal.acceleration))
    if rows.columns:
        expected = whole_motion(settings.task, rows.times)
        pairs += [(name, v[:, None], expected[name][:, None]) for name, v in rows.columns.items()]
    for what, written, wanted in pairs:
        size = np.max(np.abs(wanted), axis=0, initial=1.0)
        rounding = size * (_DOUBLE if settings.digits is not None else _COMPUTED)
        share = np.abs(written - wanted) / (settings.half_unit * _LAST_DIGIT + rounding)
        worst = max(worst, float(share.max()))
        if share.max() > 1:
            row, column = np.unravel_index(int(np.argmax(share)), share.shape)
            unit = "half units of its last digit" if settings.digits is not None else "roundings"
            failures.append(
                f"row {row + 1}, {what} {column + 1}: {written[row, column]:.9g} in the file, "
                f"{wanted[row, column]:.9g} in the design, {share.max():.3g} {unit} apart"
            )
    return worst, failures


def _add_execution(found: ReadBack, table: ExecutedTable) -> ReadBack:
    """Add deviations on a grid finer than the rows, and limits."""
    linear = table.interpolation is Interpolation.LINEAR
    points = FINER if linear else max(FINER, int(np.ceil(found.longest_step / _FINEST)))
    if found.controller is not None:
        points = 1
    grid = refine_times(table.rows.times, points)
    worst = TableDeviation()
    for times in track("reading back", tuple(blocks(grid))):
        worst = worst.with_worse(deviation(table, times, table.between(times), forces=not linear))
    if linear:
        for times in track("reading back: accelerations", tuple(blocks(table.rows.times))):
            # Of the rows only what has no value between them: accelerations and forces.
            at_rows = deviation(table, times, table.smoothed(times), forces=True)
            worst = worst.with_worse(replace(at_rows, position=0.0, velocity=0.0))
    certificate = certify_table(table)
    return replace(
        found,
        points=len(grid),
        position_error=worst.position,
        position_time=float(table.rows.true_times(worst.position_time)),
        velocity_error=worst.velocity,
        acceleration_error_share=worst.acceleration,
        force_error_share=worst.force,
        limits=certificate.limits,
        limits_in_words=limits_in_words(certificate),
        broken=(*map(excess_in_words, certificate.broken), *found.broken),
        certified=certificate.certified,
        sampled=certificate.sampled,
    )


def check_controller(table: ExecutedTable) -> ControllerCheck:
    """Compare the largest acceleration of a strut with the design's."""
    times, motion = table.rows.times, table.motion
    cycle = float(times[1] - times[0])
    second = np.diff(table.lengths(times), 2, axis=0) / cycle**2
    designed = (
        np.abs(table.robot.strut_motion(*motion.sample(part)).length_acceleration).max()
        for part in blocks(times)
    )
    begin, end = table.rows.true_times(table.executed_window) - times[0]
    return ControllerCheck(
        cycle=cycle,
        duration=table.rows.duration - float(times[0]),
        window=(float(begin), float(end)),
        acceleration=float(np.abs(second).max()),
        designed_acceleration=float(max(designed)),
    )


def limits_in_words(certificate: PathCertificate) -> str:
    """Say that every limit is kept; if not, by how much each is exceeded and what is allowed.

    A table is executed by interpolation between rounded numbers: it may exceed a limit by
    `LIMIT_SHARE` of its range. A limit that it does exceed is never called kept. Limits with a
    reserve are kept with it.
    """
    checks = certificate.limits
    exceeded = [excess_in_words(check) for check in checks if not check.kept]
    if exceeded:
        return f"{'; '.join(exceeded)} (tolerance of a table: {range_share_in_words(LIMIT_SHARE)})"
    reserves = sorted({check.reserve for check in checks if check.reserve})
    span = " to ".join(f"{100 * r:.4g} %" for r in dict.fromkeys(reserves[:1] + reserves[-1:]))
    kept = f"every limit kept, with a reserve of {span}" if span else "every limit kept"
    return f"{kept}, {_proof_in_words(certificate)}" if checks else kept


def _proof_in_words(certificate: PathCertificate) -> str:
    if np.isfinite(certificate.unproved_from):
        return (
            f"not proved: the struts' lengths determine the pose up to "
            f"{certificate.unproved_from:.4f} s only"
        )
    if left := certificate.open:
        named = ", ".join(
            f"{check.title} (by {range_share_in_words(check.proved)})" for check in left
        )
        return f"but not proved that nothing exceeds: {named}"
    if not certificate.sampled:
        return "proved at every instant"
    titles = [check.title for check in certificate.limits if check.key in certificate.sampled]
    return (
        f"proved at every instant but for {' and '.join(titles)}, which straight lines leave "
        "undefined: judged at the rows only"
    )


def _beyond(found: ReadBack, table: ExecutedTable, settings: Settings) -> list[str]:
    failures = []
    if not found.position_error <= settings.tolerance:
        failures.append(
            f"a strut is {1e6 * found.position_error:.3g} µm from the design at "
            f"{found.position_time:.4f} s, more than the tolerance of "
            f"{1e6 * settings.tolerance:.3g} µm"
        )
    if table.interpolation is not Interpolation.LINEAR and settings.section.segment is None:
        # With a stated segment time only the limits count: a closer path is not possible.
        failures += [
            f"the {what} is {100 * share:.2g} % of its limit's range from the design, more than "
            f"{100 * SHARE:g} %"
            for what, share in (
                ("acceleration", found.acceleration_error_share),
                ("force", found.force_error_share),
            )
            if share > SHARE
        ]
    failures += [
        f"{excess_in_words(check)}, more than the tolerance of {range_share_in_words(LIMIT_SHARE)}"
        for check in found.limits
        if not check.violation <= LIMIT_SHARE
        and not (found.controller is not None and check.key in _OF_RATES)
    ]
    return failures


def _information_lost(change: InformationChange, wider: float) -> list[str]:
    """Describe changes beyond the tolerances, which are `wider` by a factor."""
    failures = []
    log_det, std = wider * LOG_DET_CHANGE, wider * STD_SHARE
    if not abs(change.log_det_change) <= log_det:
        failures.append(f"log det F changes by {change.log_det_change:.3g}, more than {log_det:g}")
    if not abs(change.std_change) <= std:
        failures.append(
            f"the predicted standard deviation of {change.parameter} changes by "
            f"{100 * change.std_change:.2g} %, more than {100 * std:g} %"
        )
    return failures
