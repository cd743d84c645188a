"""The check of a file: read again, executed as its controller does, held against the design."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np

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
from expdesign.recheck.limit_check import LimitCheck, range_share_in_words
from expdesign.robot import ForwardKinematicsError
from expdesign.runfolder.fields import described

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


@dataclass(frozen=True)
class ReadBack:
    """Result of executing a file."""

    rows: int = 0
    points: int = 0
    """Number of points of the grid of the execution."""
    shortest_step: float = np.nan
    longest_step: float = np.nan
    """Shortest and longest time between two rows, s."""
    duration: float = np.nan
    trigger: tuple[float, float] | None = None
    """When the output of a trigger is switched on and off, s."""
    row_error: float = np.nan
    """Largest difference between a value in the file and the design at the time that the file
    states, in half units of the last digit (of a rounding error, where all are written)."""
    deviation: TableDeviation = field(default_factory=TableDeviation)
    certificate: PathCertificate = field(default_factory=lambda: PathCertificate(()))
    """The limits, and what is proved of them."""
    information: InformationChange | None = None
    """None without noise, or where the file could not be executed."""
    controller: ControllerCheck | None = None
    """None for a controller that moves on the format's interpolation."""
    single_cycles: tuple[str, ...] = ()
    """Limits that are exceeded in single cycles of such a controller, in words."""
    failures: tuple[str, ...] = ()
    """Excesses over tolerances, in words; empty when the file is good."""

    @property
    def limits(self) -> tuple[LimitCheck, ...]:
        """The worst moment of every limit."""
        return self.certificate.limits

    @property
    def broken(self) -> tuple[str, ...]:
        """The limits that the machine breaks if it executes the file, in words."""
        return (*map(excess_in_words, self.certificate.broken), *self.single_cycles)


def read_back(path: Path, settings: Settings) -> ReadBack:
    """Read a file, execute it as its controller does, and hold it against design and limits."""
    task = settings.task
    try:
        rows = settings.form.read(path, settings)
    except TableError as error:
        return ReadBack(failures=(f"the file cannot be read: {error}",))
    steps = np.diff(rows.times)
    found = ReadBack(
        rows=rows.count,
        shortest_step=float(steps.min()),
        longest_step=float(steps.max()),
        duration=rows.duration,
        trigger=rows.trigger,
    )
    if rows.repeated:
        settings = shorten(settings)
    apart, wrong_rows = _row_error(rows, settings)
    found = replace(found, row_error=apart)
    failures = wrong_rows
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
        single = tuple(single_cycle_faults(table))
        found = replace(found, controller=check, trigger=trigger, single_cycles=single)
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
    worst = replace(worst, position_time=float(table.rows.true_times(worst.position_time)))
    return replace(found, points=len(grid), deviation=worst, certificate=certify_table(table))


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
    off = found.deviation
    if not off.position <= settings.tolerance:
        failures.append(
            f"a strut is {1e6 * off.position:.3g} µm from the design at {off.position_time:.4f} s, "
            f"more than the tolerance of {1e6 * settings.tolerance:.3g} µm"
        )
    if table.interpolation is not Interpolation.LINEAR and settings.section.segment is None:
        # With a stated segment time only the limits count: a closer path is not possible.
        failures += [
            f"the {what} is {100 * share:.2g} % of its limit's range from the design, more than "
            f"{100 * SHARE:g} %"
            for what, share in (("acceleration", off.acceleration), ("force", off.force))
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
