"""LinuxCNC: G-code in the pose of the platform, for machines with genhexkins."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache, partial
from itertools import chain, islice
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
from pydantic import model_validator

from constraints.arrays import Array
from expdesign.configuration import InputError
from expdesign.configuration.errors import refusal
from expdesign.configuration.export import ExportSection
from expdesign.configuration.quantity import (
    Acceleration,
    Duration,
    Length,
    Positive,
    Speed,
    quantity_in,
)
from expdesign.configuration.schema import MOST_ROWS, repeated, require_at_most
from expdesign.export.definition import (
    LENGTH_UNITS,
    ControllerModel,
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
    Task,
    in_window,
    round_up,
    switched_at,
    switching,
)
from expdesign.export.execution import LONGER, ExecutedTable
from expdesign.export.linuxcnc_planner import PlannerLimits, plan_motion
from expdesign.export.repetition import collect, shorten_task, split_rows
from expdesign.export.rotation import roll_pitch_yaw
from expdesign.export.row_times import ideal_rows
from expdesign.export.text_table import Loop, every_line, lines, mark_window, number, write_lines
from expdesign.machines.genhexkins import setp_lines, turn_errors
from expdesign.motion.executable import ExecutableMotion
from expdesign.progress import track
from expdesign.templates import text_templates

AXES = ("X", "Y", "Z", "A", "B", "C")
START_FEED = 6.0
"""1/min: the move to the start takes 10 s; a machine at the start does not move."""
_FEED_DIGITS = 6
_MORE = 0.002
"""Of a servo cycle, that F makes a row longer: the planner drops it. In rows of whole cycles
rounding would decide in which of two cycles they end."""
_SAME_FEED = 1e-7
_SLOWEST = 1e-9
"""1/min; F of a row is above."""
_LONGER = 2.0
_BLEND_DIGITS = 8
_COMMENT = re.compile(r"\([^()]*\)")
_WORD = re.compile(r"([A-Z])([^A-Z\s]*)")
_UNIT_CODES = {"mm": "G21", "in": "G20"}
_LOOP = Loop("o100 repeat [{}]", "o100 endrepeat", "({})")


def _feeds(times: Array, settings: Settings) -> Array:
    """Return F of each row but the first, 1/min, of times in whole servo cycles."""
    period = _servo_period(settings)
    cycles = np.rint(np.diff(times) / period)
    return np.round(60 / (period * (cycles + _MORE)), _FEED_DIGITS)


def _on_cycles(times: Array, settings: Settings) -> Array:
    """Return times, s, rounded to servo cycles."""
    period = _servo_period(settings)
    return period * np.rint(times / period)


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    def lines_of(part: Rows) -> Iterator[str]:
        feeds = [START_FEED, *_feeds(part.times, settings)]
        for row, feed in zip(part.position, feeds, strict=True):
            words = map("".join, zip(AXES, settings.numbers(row), strict=True))
            yield f"G1 {' '.join(words)} F{feed:.{_FEED_DIGITS}f}"

    title = f"{settings.title}: {settings.axes.units[0]} and degrees"
    head = [
        f"({title}, A B C are roll, pitch and yaw about fixed axes)",
        _modes(settings),
        "(start)",
    ]
    behind = switching(rows, settings, _commands(settings))
    text: Iterator[str]
    if settings.section.looped:
        lead_in, *parts = (lines_of(part) for part in split_rows(rows))
        parts = [lead_in, *(islice(part, 1, None) for part in parts)]
        text = _LOOP.lines(parts, settings.task.motion.periods, [*behind.values()])
    else:
        moves = every_line(rows, lines_of)
        moves = (f"{move}\n{behind[k]}" if k in behind else move for k, move in enumerate(moves))
        text = mark_window(moves, rows, settings, "({})")
    write_lines(path, chain(head, text, ["M2"]))


def _modes(settings: Settings) -> str:
    """Return the line of codes before the moves."""
    unit = _UNIT_CODES[settings.axes.units[0]]
    return f"{unit} G90 G93 G64 P{_blend(settings):.{_BLEND_DIGITS}f} Q0"


def _blend(settings: Settings) -> float:
    """Return P of G64 in the table's unit of length."""
    blend = _options(settings).blend or settings.tolerance
    return round(LENGTH_UNITS[settings.axes.units[0]] * blend, _BLEND_DIGITS)


def _commands(settings: Settings) -> tuple[str, str]:
    """Return the codes that switch the output on and off when the next move begins."""
    return f"M62 P{settings.section.trigger}", f"M63 P{settings.section.trigger}"


def _read(path: Path, settings: Settings) -> Rows:
    switched: list[tuple[int, bool]] = []
    found = collect(_moves(path, settings, switched), settings)
    rows, duration = found.rows(found.values), settings.task.motion.duration
    if rows.duration > _LONGER * duration:
        raise TableError(f"the program lasts {rows.duration:.6g} s, the motion {duration:.6g} s")
    return switched_at(switched, rows)


def _moves(
    path: Path, settings: Settings, switched: list[tuple[int, bool]]
) -> Iterator[tuple[Array, Array]]:
    """Yield times, s, and positions, (N, 6), in blocks; the first is the start.

    Rows before which an output is switched are added to `switched`.
    """
    code, period = _code(path, settings), _servo_period(settings)
    read = partial(_read_move, period=period)
    commands = None if settings.section.trigger is None else _commands(settings)
    for k, line in islice(code, 1):
        yield np.zeros(1), np.array([read(line, k, start=True)[1:]])
    for cycles, position in _LOOP.moves(code, read, commands, switched):
        yield period * cycles, position


def _code(path: Path, settings: Settings) -> Iterator[tuple[int, str]]:
    """Yield the lines of the program behind the modes, with their numbers and without comments."""
    modes = _modes(settings)
    begun = ended = False
    for k, line in enumerate(lines(path), start=1):
        code = _COMMENT.sub("", line).strip()
        if not code:
            continue
        if ended:
            raise TableError(f"line {k}: there is code after M2")
        if not begun and code.split() != modes.split():
            raise TableError(f"line {k}: '{code[:60]}' where the program begins with '{modes}'")
        ended = code == "M2"
        if begun and not ended:
            yield k, code
        begun = True
    if not ended:
        raise TableError("the program has no M2 at its end")


def _read_move(code: str, line: int, period: float, *, start: bool = False) -> list[float]:
    """Return the servo cycles of a move, none of that to the start, and its six positions."""
    words = _WORD.findall(code)
    if "".join(map("".join, words)) != re.sub(r"\s", "", code) or words[0] != ("G", "1"):
        raise TableError(f"line {line}: '{code[:40]}' is none of our codes")
    letters = tuple(letter for letter, _ in words[1:])
    if letters != (*AXES, "F"):
        missing = "F word" if "F" not in letters else "axis"
        raise TableError(f"line {line}: {missing} missing, wrong or twice in a G93 G1 move")
    *position, feed = (number(value, line, f"word {letter}") for letter, value in words[1:])
    if start:
        if feed != START_FEED:
            raise TableError(f"F of the move to the start is {feed:g}, not {START_FEED:g}")
        return [0, *position]
    cycles = round(60 / (period * feed) - _MORE) if _SLOWEST < feed < 60 / period else 0
    if not cycles or abs(feed * period * (cycles + _MORE) / 60 - 1) > _SAME_FEED:
        raise TableError(f"line {line}: F {feed:.10g} is not that of whole servo cycles")
    return [cycles, *position]


ENDING = ".genhexkins.hal"


def geometry_lines(_rows: Rows, settings: Settings) -> list[str]:
    """Return the lines that give genhexkins the robot's joints, in the table's unit of length."""
    return setp_lines(settings.task.robot.description, settings.axes.units[0])


PLANNER_ENDING = ".planner.ini"
_PERIOD = 1e-3
"""s; servo period of LinuxCNC's configurations."""
_CYCLES = (10, 15, 20, 30, 50)
"""Servo cycles of a row that are tried."""
_WHOLE = 1e-9
_SETTLED = 1e-6
"""mm and degrees; largest difference between two periods of the commanded motion."""
_TOLERANCE = 0.02
"""Of the largest stroke of a strut."""
_LAG = 4.0
"""The planner lags by speed² / acceleration: a quarter of the tolerance by default."""
_SPEED = 2.0
_GRID = 4001
_POSES, _EXACT = 400, 1e-6
_FUZZ = 1e-8


def execute_moves(rows: Rows, settings: Settings) -> tuple[Rows, Array]:
    """Return the rows in every servo cycle, and when the planner reaches those of the table.

    The times are those of the design: the first is not 0, because the planner hastens through rows
    slower than 0.1 units per minute. Of a repeated period the planner has to repeat its motion.
    """
    limits, (first, last) = planner_limits(settings), rows.block
    feeds, position = _feeds(rows.times, settings), rows.position
    if rows.repeated:
        feeds = np.insert(feeds, last, feeds[first:last])
        position = np.insert(position, last + 1, position[first + 1 : last + 1], axis=0)
    poses, cycles = plan_motion(position, feeds, _blend(settings), limits)
    task = settings.task
    begin = end = 0
    if rows.repeated:
        third = 2 * last - first
        begin, end, again = (int(cycles[row]) for row in (first, last, third))
        apart = poses[begin:end] - poses[end:again] if again - end == end - begin else np.inf
        if end - begin != round(rows.period / limits.period) or np.abs(apart).max() > _SETTLED:
            raise TableError("the planner executes a repeated period otherwise than the one before")
        poses = np.delete(poses, slice(end, again), axis=0)
        cycles = np.concatenate([cycles[: last + 1], cycles[third + 1 :] - (again - end)])
        task = shorten_task(task)
    times = limits.period * cycles
    inside = in_window(rows.times, task.motion.window)
    late = float(np.median((rows.times - times)[inside])) if np.any(inside) else 0.0
    times = times + late
    at = late + limits.period * np.arange(len(poses), dtype=np.float64)
    found = Rows(at, poses, repeated=rows.repeated, block=(begin, end))
    if rows.trigger is not None:
        on, off = found.true_times(np.interp(rows.short_times(rows.trigger), rows.times, times))
        found = replace(found, trigger=(float(on), float(off)))
    return found, times


def choose_row_times(settings: Settings, place: str) -> Array:
    """Return times of rows, in whole servo cycles, with which the planner follows the motion.

    Of several the one with the smallest acceleration in a single cycle is taken. Where the planner
    follows none of them, the table with the smallest deviation is written, and refused.
    """
    motion, given = settings.task.motion, settings.section.segment
    period = _servo_period(settings)
    longest = _CYCLES[-1] * period if given is None else given
    made = f"{motion.duration:.4g} s in steps of {longest:g} s"
    key = f"{place}.segment" if place else "segment"
    require_at_most(motion.duration / longest, MOST_ROWS, made, key=key)
    _refuse_ambiguous_screws(settings, place)
    if given is not None:
        return _row_times(motion, period, max(1, int(given / period + _WHOLE)))
    tried = [n for n in _CYCLES if motion.duration <= MOST_ROWS * n * period]
    choices = [_row_times(motion, period, n) for n in tried]
    judged = [_judge(settings, times) for times in track("rows of the planner", choices)]
    return choices[min(range(len(choices)), key=judged.__getitem__)]


def _row_times(motion: ExecutableMotion, period: float, cycles: int) -> Array:
    """Return times of rows so many servo cycles apart, the same in all periods of whole cycles.

    There some rows are a cycle longer. The first and the last row, next to rest, are up to twice as
    long.
    """
    begin, behind = (round(edge / period) for edge in motion.window)
    end, one = math.ceil(motion.duration / period - _WHOLE), motion.trajectory.period / period
    inside = np.arange(begin, behind, cycles)
    if abs(one - round(one)) < _WHOLE * one:
        behind, count = begin + motion.periods * round(one), max(1, round(one) // cycles)
        inside = begin + np.arange(motion.periods * count) * round(one) // count
    before = np.arange(begin % cycles, begin, cycles)
    after = np.arange(behind, end - cycles + 1, cycles)
    return period * np.concatenate([[0], before[before >= cycles], inside, after, [end]])


def _judge(settings: Settings, times: Array) -> tuple[float, float]:
    """Return what is smaller for better rows: excess over the tolerance, and acceleration.

    Several periods have to last as long as designed: the controller may repeat them.
    """
    rows = ideal_rows(settings, times)
    if settings.digits is not None:
        rows = replace(rows, position=np.round(rows.position, settings.digits))
    table = ExecutedTable.of(settings, rows)
    at, motion, robot = table.rows.times, table.motion, settings.task.robot
    lengths = table.lengths(at)
    off = np.abs(lengths - robot.inverse_kinematics(motion.sample(at).pose)).max()
    longer = LONGER if motion.periods == 1 else _WHOLE
    excess = max(0.0, abs(table.stretch) / longer - 1, off / settings.tolerance - 1)
    return float(excess), float(np.abs(np.diff(lengths, 2, axis=0)).max())


def _refuse_ambiguous_screws(settings: Settings, place: str) -> None:
    """Refuse axes with which genhexkins takes another turn of the screws than the robot."""
    robot, motion = settings.task.robot.description, shorten_task(settings.task).motion
    if robot.platform_cardan_axes is None:
        return
    poses = motion.sample(np.linspace(0.0, motion.duration, _POSES)).pose
    joints = robot.base_joints, robot.platform_joints
    axes = robot.alpha_axes, -robot.platform_cardan_axes
    off = float(
        np.max(turn_errors(robot.thread_lead, *axes, settings.task.robot.home, poses, *joints))
    )
    if off > _EXACT:
        raise InputError(
            "genhexkins takes the turn of the struts on their screws from an arc sine, which is "
            f"ambiguous with these joint axes: its lengths are off by up to {1e3 * off:.3g} mm",
            key=f"{place}.format" if place else "format",
            allowed="linuxcnc-strut",
        )


def planner_limits(settings: Settings) -> PlannerLimits:
    """Return the limits of the planner in the table's units; the section may leave some open.

    By default the axes may be twice as fast as in the motion, and accelerate so that the planner
    lags by a quarter of the tolerance.
    """
    options = _options(settings)
    metre = LENGTH_UNITS[settings.axes.units[0]]
    speeds = _axis_speeds(settings.task)
    linear, angular = (max(float(part.max()), _FUZZ) for part in (speeds[:3], speeds[3:]))
    acceleration = _LAG * _speed_and_stroke(settings.task)[0] ** 2 / settings.tolerance
    values = (
        (options.linear_speed, _SPEED * linear, metre),
        (options.angular_speed, _SPEED * angular, _DEGREE),
        (options.linear_acceleration, acceleration, metre),
        (options.angular_acceleration, acceleration * angular / linear, _DEGREE),
    )
    found = [
        np.full(3, round_up(unit * default)) if given is None else unit * np.array(given)
        for given, default, unit in values
    ]
    return PlannerLimits(
        _servo_period(settings),
        np.concatenate(found[:2]),
        np.concatenate(found[2:]),
        np.inf if options.path_speed is None else metre * options.path_speed,
    )


_DEGREE = 180 / np.pi


def _servo_period(settings: Settings) -> float:
    """Return the servo period, s: whole nanoseconds, as the INI file states it."""
    period = _options(settings).servo_period or min(settings.task.controller_period, _PERIOD)
    return max(1, round(1e9 * period)) / 1e9


@lru_cache(maxsize=4)
def _axis_speeds(task: Task) -> Array:
    """Return the largest speeds of the six axes, m/s and rad/s."""
    times, pose = _sample(task)
    values = np.hstack([pose[:, :3], roll_pitch_yaw(pose[:, 3:])])
    return np.asarray(np.abs(np.diff(values, axis=0)).max(axis=0) / times[1])


@lru_cache(maxsize=4)
def _speed_and_stroke(task: Task) -> tuple[float, float]:
    """Return the largest speed, m/s, and the largest stroke of a strut, m."""
    times, pose = _sample(task)
    lengths = task.robot.inverse_kinematics(pose)
    speed = np.abs(np.diff(lengths, axis=0)).max() / times[1]
    return float(speed), float(np.ptp(lengths, axis=0).max())


def _sample(task: Task) -> tuple[Array, Array]:
    """Return times (N,), s, and poses (N, 6) of the motion with at most two periods."""
    motion = shorten_task(task).motion
    times = np.linspace(0.0, motion.duration, _GRID)
    return times, motion.sample(times).pose


def tolerance(task: Task) -> float:
    """Return the largest deviation of a strut from the design: a share of the largest stroke, m."""
    return _TOLERANCE * _speed_and_stroke(task)[1]


def condition(settings: Settings) -> str:
    """Say with which rows and limits the planner follows the motion."""
    limits = planner_limits(settings)
    unit = settings.axes.units[0]
    row = settings.section.segment or 10 * limits.period
    speeds = _axis_speeds(settings.task)
    needed = LENGTH_UNITS[unit] * speeds[:3].max() / row, _DEGREE * speeds[3:].max() / row
    return (
        "LinuxCNC's planner ramps up and down in each row: it follows rows of at least ten servo "
        f"cycles ({1e3 * 10 * limits.period:g} ms), whole cycles long, with accelerations of the "
        f"axes of at least speed / row time, here {needed[0]:.3g} {unit}/s^2 and "
        f"{needed[1]:.3g} deg/s^2. Raise them, use a smaller --scale, or take linuxcnc-strut: it "
        "needs no planner"
    )


def planner_lines(_rows: Rows, settings: Settings) -> list[str]:
    """Return the lines of the INI file with which the table was checked."""
    limits = planner_limits(settings)
    unit = settings.axes.units[0]
    template = text_templates("expdesign.export").get_template("planner.ini.j2")
    axes = zip(AXES, limits.velocity, limits.acceleration, strict=True)
    text = template.render(unit=unit, limits=limits, axes=axes, inf=np.inf)
    return text.splitlines()


def _options(settings: Settings) -> GcodeOptions:
    section = settings.section
    return section if isinstance(section, GcodeOptions) else GcodeOptions(format=section.format)


AngularSpeed = Annotated[float, quantity_in("rad/s")]
AngularAcceleration = Annotated[float, quantity_in("rad/s^2")]
_One = TypeVar("_One")
_PerAxis = (
    Annotated[
        tuple[Annotated[_One, Positive], ...], repeated(3, "values", "one value for three axes")
    ]
    | None
)


class GcodeOptions(ExportSection):
    """Options of G-code for LinuxCNC."""

    spaces = ("pose",)
    shared = ("digits", "units", "trigger", "repeat")
    outputs = (0, 63)
    """P of M62 and M63."""

    blend: Annotated[Length, Positive] | None = None
    """Path tolerance of LinuxCNC's G64, m; by default `tolerance`."""
    servo_period: Annotated[Duration, Positive] | None = None
    """`[EMCMOT]SERVO_PERIOD`, s; by default the controller's period, 1 ms at most."""
    linear_speed: _PerAxis[Speed] = None
    """MAX_VELOCITY of the axes X, Y, Z, m/s."""
    angular_speed: _PerAxis[AngularSpeed] = None
    """MAX_VELOCITY of the axes A, B, C, rad/s."""
    linear_acceleration: _PerAxis[Acceleration] = None
    """MAX_ACCELERATION of the axes X, Y, Z, m/s²."""
    angular_acceleration: _PerAxis[AngularAcceleration] = None
    """MAX_ACCELERATION of the axes A, B, C, rad/s²."""
    path_speed: Annotated[Speed, Positive] | None = None
    """`[TRAJ]MAX_LINEAR_VELOCITY`, m/s; by default none."""

    @model_validator(mode="after")
    def _check_units(self) -> GcodeOptions:
        if self.units not in (None, "mm", "in"):
            raise refusal(f"G-code has no lengths in {self.units}", "mm or in", key="units")
        return self


FORMAT = TableFormat(
    name="linuxcnc-gcode",
    title="LinuxCNC, G-code for genhexkins",
    suffix=".ngc",
    interpolation=Interpolation.LINEAR,
    write=_write,
    read=_read,
    options=GcodeOptions,
    guide='{% extends "guides/linuxcnc-gcode.txt.j2" %}',
    clock="F of G93 with 6 decimals; the planner works in whole servo cycles",
    executed="LinuxCNC 2.9 ran it: its commands agree with a model of the planner to some nm",
    axes={"pose": AXES},
    written_times=_on_cycles,
    repeats=True,
    controller=ControllerModel(execute_moves, choose_row_times, tolerance, condition),
    fixed_angles=True,
    companions={ENDING: geometry_lines, PLANNER_ENDING: planner_lines},
)
