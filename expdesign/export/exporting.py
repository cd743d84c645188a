"""One export: rows, file, check, and only then its final name."""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from expdesign.configuration import ComputationError, ExportSection, InputError
from expdesign.configuration.export import COUNTS
from expdesign.export.certification import LIMIT_SHARE
from expdesign.export.definition import (
    ANGLE_UNITS,
    LENGTH_UNITS,
    Axes,
    Interpolation,
    Rows,
    Settings,
    TableFormat,
    Task,
)
from expdesign.export.formats import table_formats
from expdesign.export.read_back import LOG_DET_CHANGE, STD_SHARE, ReadBack, read_back
from expdesign.export.row_times import designed_rows, sufficient_step
from expdesign.export.text_table import write_lines
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES, POSE
from expdesign.progress import listen_to_progress, progress_prefix, report_progress
from expdesign.robot import Robot
from expdesign.runfolder.files import TEMPORARY, errors_naming, remove_leftovers
from expdesign.runfolder.manifest import file_hash
from expdesign.workers import Monitor

TOLERANCES = {
    Interpolation.LINEAR: 10e-6,
    Interpolation.CUBIC: 1e-6,
    Interpolation.QUINTIC: 1e-6,
}
"""Largest deviation of a strut's length from the design unless one is given, m.

Straight lines between rows 1 ms apart leave a motion of 30 m/s² by 4 µm.
"""

LONGEST = 3600.0
"""Longest scaled motion, s."""

_MORE_DIGITS = {"m": 3, "mm": 0, "um": -3, "in": 2, "rad": 2, "deg": 0, "rev": 3}

BAG = ".mcap"
_ROUNDED = 1e-4
"""Change of a table's accelerations by rounding, as a share of them, that matters near a limit."""


class ExportError(ComputationError):
    """A file does not do what the design asks for; it was not kept."""


@dataclass(frozen=True, eq=False)
class Export:
    """A file that was written and checked; `digest` is its SHA-256 then.

    `companions` are further files of the table; `note` is for the user, or empty.
    """

    path: Path
    digest: str
    settings: Settings
    check: ReadBack
    companions: tuple[Path, ...] = ()
    note: str = ""


def _remedy(check: ReadBack, settings: Settings) -> str:
    """Return which options are worth trying, by what is beyond its tolerance."""
    if not check.row_error <= 1:
        # Also NaN: the file does not hold the rows that were to be written, whatever they are.
        return ""
    section = settings.section
    short = "a shorter segment"
    if settings.form.controller is not None:
        return settings.form.controller.condition(settings)
    if settings.digits == settings.form.count_digits == 0:
        return _remedy_of_counts(check, settings)
    ways = [short if section.segment is None else f"no segment, or {short}"]
    if settings.digits is not None and (section.digits is not None or section.segment is None):
        ways.append("more digits")
    if len(check.failures) == 1 and not check.position_error <= settings.tolerance:
        # What else is beyond, a limit of the robot or the information, it does not change.
        ways.append("a larger tolerance")
    return f"{', or '.join(ways)} may help"


def _remedy_of_counts(check: ReadBack, settings: Settings) -> str:
    """Return what helps a table of whole counts, by the cause of its failure.

    Straight lines leave the distance a h²/8 between rows h apart, and rounding by e changes the
    accelerations a at the rows by up to 4 e/h².
    """
    off, step = check.position_error, settings.step or 0.0
    rounding = settings.half_unit / float(np.min(np.abs(settings.axes.factor)))
    if not off <= settings.tolerance and rounding > settings.tolerance:
        return "finer counts may help: their rounding is beyond the tolerance"
    if not off <= settings.tolerance or rounding < _ROUNDED * 2 * off:
        ways = ["a shorter segment"]
        if len(check.failures) == 1 and not off <= settings.tolerance:
            ways.append(f"a tolerance of {np.ceil(1e6 * off):g} µm or more")
        return f"straight lines between rows {1e3 * step:g} ms apart: {', or '.join(ways)} may help"
    limits = max((one.violation / LIMIT_SHARE for one in check.limits), default=0.0)
    lost = 0.0
    if (change := check.information) is not None:
        lost = max(abs(change.log_det_change) / LOG_DET_CHANGE, abs(change.std_change) / STD_SHARE)
    # A slower motion has room within the limits, but its accelerations are smaller.
    slower = "" if lost > 1 else ", or a scale below 1"
    return (
        "rounding to whole counts weighs most at short steps: finer counts "
        f"({np.ceil(max(limits, lost)):g} times as many), or a longer segment with a larger "
        f"tolerance ({2e3 * step:g} ms leave about {4e6 * off:.2g} µm){slower} may help"
    )


def file_name(section: ExportSection) -> str:
    """Return the name that a table gets in ``exports/``."""
    return section.stem + section.suffix


def refuse_unreadable_name(section: ExportSection, path: Path, key: str) -> None:
    """Refuse a name that makes the file unreadable: a bag is recognised by its ending."""
    if section.binary_suffix not in ("", path.suffix):
        raise InputError(
            f"'{path.name}' does not end in {BAG}: ROS 2 would not know it for an MCAP bag",
            key=key,
            allowed=f"a file with the ending {BAG}",
        )


def refuse_missing_library(section: ExportSection, place: str = "") -> None:
    """Refuse a table whose library is not installed; the message says how to install it."""
    if section.binary_suffix == BAG and find_spec("rosbags") is None:
        raise InputError(
            "MCAP bags are written with the library rosbags, which is not installed",
            key=f"{place}.encoding" if place else "encoding",
            allowed="pip install expdesign[ros], or encoding: yaml",
        )


def export_table(section: ExportSection, task: Task, path: Path, place: str = "") -> Export:
    """Write a controller table and check it; a file that fails leaves nothing behind.

    The path is the final name of the file; the place of the section in the run file is for
    messages.

    Raises
    ------
    InputError
        An option cannot be kept, or a library is missing.
    ExportError
        The file is beyond a tolerance.
    """
    refuse_missing_library(section, place)
    settings = resolve_settings(section, task, place)
    step, note = sufficient_step(settings), ""
    if step is not None and step != settings.step:
        note = (
            f"{path.name}: rows {1e3 * step:g} ms apart, since straight lines between rows "
            f"{1e3 * (settings.step or 0):g} ms apart would leave the tolerance of "
            f"{1e6 * settings.tolerance:g} µm"
        )
        settings = resolve_settings(section.model_copy(update={"segment": step}), task, place)
    rows = designed_rows(settings, place)
    if section.looped and not rows.repeated:
        raise InputError(
            "the controller cannot repeat a period: there are fewer than three, or a period is no "
            "whole number of steps of time",
            key=f"{place}.repeat" if place else "repeat",
            allowed="repeat: file",
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    remove_leftovers(path.parent)
    # A folder in the same place: some libraries go by the file's name.
    with (
        errors_naming(path),
        TemporaryDirectory(prefix=TEMPORARY, dir=path.parent) as folder,
    ):
        draft = Path(folder) / file_name(section)
        report_progress(f"writing {rows.count} rows")
        settings.form.write(draft, rows, settings)
        more = _write_companions(draft, rows, settings)
        check = read_back(draft, settings)
        if check.failures:
            remedy = _remedy(check, settings)
            kept = f"The file was not kept{remedy and f'; {remedy}'}."
            message = f"{path.name}: {'; '.join(check.failures)}. {kept}"
            raise ExportError(message, {"failures": list(check.failures)})
        digest = file_hash(draft)
        draft.replace(path)
        places = tuple(path.with_name(f"{path.stem}{ending}") for ending in more)
        for file, final in zip(more.values(), places, strict=True):
            file.replace(final)
        for ending in settings.form.companions.keys() - more.keys():
            # Of the table that stood here before.
            path.with_name(f"{path.stem}{ending}").unlink(missing_ok=True)
    return Export(path, digest, settings, check, places, note)


def export_job(
    task: Task, monitor: Monitor, section: ExportSection, path: Path, place: str, name: str
) -> Export | InputError | ComputationError:
    """Run `export_table` in a worker process and report its progress under a name.

    An error is returned instead of raised: the tables of other jobs are still written.
    """
    with listen_to_progress(lambda *report: monitor.report(report)), progress_prefix(name):
        try:
            return export_table(section, task, path, place)
        except (InputError, ComputationError) as error:
            return error


def _write_companions(path: Path, rows: Rows, settings: Settings) -> dict[str, Path]:
    """Write what belongs to a table; return the files by their ending."""
    made = {}
    for ending, lines in settings.form.companions.items():
        if text := lines(rows, settings):
            made[ending] = path.with_name(f"{path.stem}{ending}")
            write_lines(made[ending], text)
    return made


def resolve_settings(section: ExportSection, task: Task, place: str = "") -> Settings:
    """Fill in the defaults of a format, and scale the motion as the section asks for."""
    form = table_formats()[section.format]
    task = _scale_task(section, task, place)
    axes = _axes(section, form, task.robot, place)
    digits = section.digits
    if digits is None and form.digits is not None and not section.binary_suffix:
        unit = section.length_unit or form.units
        counted = unit == COUNTS
        digits = form.count_digits if counted else max(0, form.digits + _MORE_DIGITS[unit])
    planned = form.controller and form.controller.tolerance(task)
    home = task.motion.sample(0.0).pose
    # What the axes move: the pose itself or the struts' lengths.
    moved = home if axes.space == "pose" else task.robot.inverse_kinematics(home)
    start = axes.rows(np.zeros(1), moved).position[0]
    return Settings(
        section=section,
        form=form,
        task=task,
        axes=axes,
        digits=digits,
        step=(section.segment or task.controller_period) if form.uniform else None,
        tolerance=section.tolerance or planned or TOLERANCES[form.interpolation],
        start=(start if digits is None else np.round(start, digits)) + 0.0,
    )


def _scale_task(section: ExportSection, task: Task, place: str) -> Task:
    factor, motion = section.factor, task.motion
    if factor == 1:
        return task
    if motion.duration / factor > LONGEST:
        raise InputError(
            f"scaled by {factor:g} the motion of {motion.duration:.4g} s takes "
            f"{motion.duration / factor:.4g} s",
            key=f"{place}.scale" if place else "scale",
            allowed=f"at least {motion.duration / LONGEST:.2g}: {LONGEST:g} s at most",
        )
    return replace(task, motion=motion.scaled(factor, task.robot.home))


def _axes(section: ExportSection, form: TableFormat, robot: Robot, place: str) -> Axes:
    space = section.coordinates
    names = section.axes or form.axes[space]
    length, angle = section.length_unit or form.units, section.angles or form.angles
    if space == "pose":
        units = [length if one.unit == "m" else angle for one in POSE]
        factor = np.array([(LENGTH_UNITS | ANGLE_UNITS)[unit] for unit in units])
        places, nowhere = np.arange(COORDINATES), np.zeros(COORDINATES)
        return Axes(space, names, tuple(units), places, factor, nowhere, form.fixed_angles)
    source = np.array(section.order or range(1, ACTUATORS + 1), dtype=np.intp) - 1
    conversion = section.actuator_units(robot.description)
    if missing := conversion.missing(length):
        message = f"lengths in {length} cannot be computed: {missing[0]}"
        raise InputError(message, robot.description.source, key=place, allowed=missing[1])
    # Counts as given, to the last digit.
    scale = np.array(
        section.counts_per_metre or [1 / each for each in conversion.si_values(length)]
    )
    if section.offset == "home":
        zero = robot.inverse_kinematics(robot.home)
    else:
        zero = np.zeros(ACTUATORS) if section.offset is None else np.array(section.offset)
    factor = scale * np.array(section.sign or (1,) * ACTUATORS, dtype=float)
    return Axes(space, names, (length,) * ACTUATORS, source, factor[source], zero)
