"""LinuxCNC: G-code in the pose of the platform, for machines with genhexkins."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Annotated, TypeVar

import numpy as np
from pydantic import model_validator

from constraints.arrays import Array
from expdesign.configuration import InputError, ResolvedRobot
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
    Guide,
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
    Task,
    in_window,
    switched_at,
    switching,
)
from expdesign.export.execution import LONGER, ExecutedTable
from expdesign.export.linuxcnc_planner import PlannerLimits, plan_motion
from expdesign.export.rotation import roll_pitch_yaw
from expdesign.export.row_times import ideal_rows, uniform_times
from expdesign.export.text_table import every_line, lines, mark_window, number, write_lines
from expdesign.machines.readers.linuxcnc import turn_errors
from expdesign.motion.executable import ExecutableMotion
from expdesign.progress import track

AXES = ("X", "Y", "Z", "A", "B", "C")
START_FEED = 6.0
"""1/min: the move to the start takes 10 s; a machine at the start does not move."""
_FEED_DIGITS = 6
_LONGER = 2.0
_BLEND_DIGITS = 8
_COMMENT = re.compile(r"\([^()]*\)")
_WORD = re.compile(r"([A-Z])([^A-Z\s]*)")
_UNIT_CODES = {"mm": "G21", "in": "G20"}


def _feeds(times: Array) -> Array:
    return np.round(60 / np.diff(times), _FEED_DIGITS)


def _written_times(times: Array, _settings: Settings) -> Array:
    return np.concatenate([[0.0], np.cumsum(60 / _feeds(times))])


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    unit = settings.axes.units[0]
    head = [
        f"({settings.title}: {unit} and degrees, A B C are roll, pitch and yaw about fixed axes)",
        f"{_UNIT_CODES[unit]} G90 G93 G64 P{_blend(settings):.{_BLEND_DIGITS}f} Q0",
        "(start)",
    ]

    def lines_of(part: Rows) -> Iterator[str]:
        feeds = [START_FEED, *_feeds(part.times)]
        return (
            f"G1 {_move(row, settings)} F{feed:.{_FEED_DIGITS}f}"
            for row, feed in zip(part.position, feeds, strict=True)
        )

    moves = every_line(rows, lines_of)
    behind = switching(rows, settings, _commands(settings))
    moves = (f"{move}\n{behind[k]}" if k in behind else move for k, move in enumerate(moves))
    write_lines(path, chain(head, mark_window(moves, rows, settings, "({})"), ["M2"]))


def _blend(settings: Settings) -> float:
    """Return P of G64 in the table's unit of length."""
    blend = _options(settings).blend or settings.tolerance
    return round(LENGTH_UNITS[settings.axes.units[0]] * blend, _BLEND_DIGITS)


def _commands(settings: Settings) -> tuple[str, str]:
    """Return the codes that switch the output on and off when the next move begins."""
    return f"M62 P{settings.section.trigger}", f"M63 P{settings.section.trigger}"


def _move(row: Array, settings: Settings) -> str:
    return " ".join(f"{a}{text}" for a, text in zip(AXES, settings.numbers(row), strict=True))


def _read(path: Path, settings: Settings) -> Rows:
    positions: list[list[float]] = []
    feeds: list[float] = []
    switched: list[tuple[int, bool]] = []
    header = {_UNIT_CODES[settings.axes.units[0]], "G90", "G93", "G64"}
    modes: set[str] = set()
    ended = False
    for k, line in enumerate(lines(path), start=1):
        code = _COMMENT.sub("", line).strip()
        if not code:
            continue
        if ended:
            raise TableError(f"line {k}: there is code after M2")
        if code == "M2":
            ended = True
            continue
        if settings.section.trigger is not None and code in _commands(settings):
            switched.append((len(positions) - 1, code == _commands(settings)[0]))
            continue
        words = _words(code, k)
        if words[0] == ("G", "1"):
            if modes < header:
                raise TableError(f"line {k}: a move before {' '.join(sorted(header))}")
            letters = tuple(letter for letter, _ in words[1:])
            if letters != (*AXES, "F"):
                missing = "F word" if "F" not in letters else "axis"
                raise TableError(f"line {k}: {missing} missing, wrong or twice in a G93 G1 move")
            values = [number(value, k, f"word {letter}") for letter, value in words[1:]]
            positions.append(values[:-1])
            feeds.append(values[-1])
        else:
            modes |= _modes(words, k, settings)
            if modes - header:
                raise TableError(f"line {k}: '{code[:40]}' is none of our codes")
    if not ended:
        raise TableError("the program has no M2 at its end")
    _check_feeds(feeds)
    times = np.concatenate([[0.0], np.cumsum(60 / np.array(feeds[1:]))])
    duration = settings.task.motion.duration
    if times[-1] > _LONGER * duration:
        raise TableError(f"the program lasts {times[-1]:.6g} s, the motion {duration:.6g} s")
    rows = Rows(times, np.array(positions).reshape(-1, len(AXES))).checked()
    return switched_at(switched, rows)


def _check_feeds(feeds: list[float]) -> None:
    if any(feed <= 0 for feed in feeds):
        raise TableError("a feed is not positive")
    if feeds and feeds[0] != START_FEED:
        raise TableError(f"F of the move to the start is {feeds[0]:g}, not {START_FEED:g}")


def _modes(words: list[tuple[str, str]], line: int, settings: Settings) -> set[str]:
    """Return the codes of a line that moves nothing; P and Q of G64 are those of the export."""
    blending = {"P": _blend(settings), "Q": 0.0}
    for letter, value in words:
        if letter in blending and number(value, line, f"word {letter}") != blending[letter]:
            raise TableError(f"line {line}: {letter} is {value}, not {blending[letter]:g}")
    return {f"{letter}{value}" for letter, value in words if letter not in blending}


def _words(code: str, line: int) -> list[tuple[str, str]]:
    found = _WORD.findall(code)
    if "".join(letter + value for letter, value in found) != re.sub(r"\s", "", code):
        raise TableError(f"line {line}: '{code[:40]}' is no G-code")
    return found


ENDING = ".genhexkins.hal"
_LETTERS = "xyz"
_INI_UNITS = {"mm": "mm", "in": "inch"}


def geometry_lines(_rows: Rows, settings: Settings) -> list[str]:
    """Return the lines that give genhexkins the robot's joints, in the table's unit of length."""
    return setp_lines(settings.task.robot.description, settings.axes.units[0])


def setp_lines(robot: ResolvedRobot, unit: str) -> list[str]:
    """Return the lines for a robot, with lengths in mm or in."""
    return [
        f"# {robot.name} for genhexkins, where [TRAJ]LINEAR_UNITS = {_INI_UNITS[unit]}.",
        "# spindle-offset and tool-offset stay zero: the controlled point is the robot file's.",
        *_points("base", robot.base_joints * LENGTH_UNITS[unit]),
        *_points("platform", robot.platform_joints * LENGTH_UNITS[unit]),
        *_thread(robot, unit),
    ]


def _thread(robot: ResolvedRobot, unit: str) -> Iterator[str]:
    """Yield the axes and the lead for the turn of the struts on their screws."""
    if robot.platform_cardan_axes is None:
        yield "setp genhexkins.screw-lead 0"
        return
    # With axes against each other a lead above zero is right-handed.
    yield from _points("base-n", robot.alpha_axes)
    yield from _points("platform-n", -robot.platform_cardan_axes)
    yield f"setp genhexkins.screw-lead {robot.thread_lead * LENGTH_UNITS[unit]:.12g}"


def _points(kind: str, joints: Array) -> Iterator[str]:
    for index, joint in enumerate(joints):
        for letter, value in zip(_LETTERS, joint, strict=True):
            yield f"setp genhexkins.{kind}.{index}.{letter} {value + 0.0:.12g}"


PLANNER_ENDING = ".planner.ini"
_PERIOD = 1e-3
"""s; servo period of LinuxCNC's configurations."""
_CYCLES = (10, 15, 20, 30, 50)
"""Servo cycles of a row that are tried."""
_MORE = 0.002
"""Of a cycle, that a row is longer: the planner drops it. In rows of whole cycles rounding would
decide in which of two cycles they end."""
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
    slower than 0.1 units per minute.
    """
    limits = planner_limits(settings)
    feeds = 60 / np.diff(rows.times)
    planned = plan_motion(rows.position, feeds, _blend(settings), limits)
    times = limits.period * planned.cycles
    inside = in_window(rows.times, settings.window)
    late = float(np.median((rows.times - times)[inside])) if np.any(inside) else 0.0
    times = times + late
    trigger = None
    if rows.trigger is not None:
        on, off = np.interp(rows.trigger, rows.times, times)
        trigger = float(on), float(off)
    cycles = late + limits.period * np.arange(len(planned.poses), dtype=np.float64)
    return Rows(cycles, planned.poses, trigger=trigger), times


def choose_row_times(settings: Settings, place: str) -> Array:
    """Return times of rows, whole servo cycles apart, with which the planner follows the motion.

    Of several the one with the smallest acceleration in a single cycle is taken. Where the planner
    follows none of them, the table with the smallest deviation is written, and refused.
    """
    motion, period = settings.task.motion, planner_limits(settings).period
    given = settings.section.segment
    steps = [period * (cycles + _MORE) for cycles in _CYCLES]
    if given is not None:
        whole = abs(given / period - round(given / period)) < _MORE / 2
        steps = [given + _MORE * period if whole else given]
    made = f"{motion.duration:.4g} s in steps of {steps[-1]:g} s"
    key = f"{place}.segment" if place else "segment"
    require_at_most(motion.duration / steps[-1], MOST_ROWS, made, key=key)
    most = MOST_ROWS / motion.duration
    choices = [
        _written_times(uniform_times(motion, step), settings) for step in steps if step * most >= 1
    ]
    _refuse_ambiguous_screws(settings, place)
    if given is not None:
        return choices[0]
    judged = [_judge(settings, times) for times in track("rows of the planner", choices)]
    return choices[min(range(len(choices)), key=judged.__getitem__)]


def _judge(settings: Settings, times: Array) -> tuple[float, float]:
    """Return what is smaller for better rows: excess over the tolerance, and acceleration."""
    rows = ideal_rows(settings, times)
    if settings.digits is not None:
        rows = replace(rows, position=np.round(rows.position, settings.digits))
    table = ExecutedTable.of(settings, rows)
    at, motion, robot = table.rows.times, table.motion, settings.task.robot
    lengths = table.lengths(at)
    off = np.abs(lengths - robot.inverse_kinematics(motion.sample(at).pose)).max()
    excess = max(0.0, abs(table.stretch) / LONGER - 1, off / settings.tolerance - 1)
    return float(excess), float(np.abs(np.diff(lengths, 2, axis=0)).max())


def _refuse_ambiguous_screws(settings: Settings, place: str) -> None:
    """Refuse axes with which genhexkins takes another turn of the screws than the robot."""
    robot, motion = settings.task.robot.description, settings.task.motion
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
    speeds = _axis_speeds(settings.task.motion)
    linear, angular = (max(float(part.max()), _FUZZ) for part in (speeds[:3], speeds[3:]))
    acceleration = _LAG * _strut_speed(settings.task) ** 2 / settings.tolerance
    values = (
        (options.linear_speed, _SPEED * linear, metre),
        (options.angular_speed, _SPEED * angular, _DEGREE),
        (options.linear_acceleration, acceleration, metre),
        (options.angular_acceleration, acceleration * angular / linear, _DEGREE),
    )
    found = [
        np.full(3, _round_up(unit * default)) if given is None else unit * np.array(given)
        for given, default, unit in values
    ]
    return PlannerLimits(
        options.servo_period or min(settings.task.controller_period, _PERIOD),
        np.concatenate(found[:2]),
        np.concatenate(found[2:]),
        np.inf if options.path_speed is None else metre * options.path_speed,
    )


_DEGREE = 180 / np.pi


def _round_up(value: float) -> float:
    """Return a value with two digits, not below."""
    digits = 10.0 ** (np.floor(np.log10(value)) - 1)
    return float(f"{np.ceil(value / digits * (1 - 1e-9)) * digits:.3g}")


@lru_cache(maxsize=4)
def _axis_speeds(motion: ExecutableMotion) -> Array:
    """Return the largest speeds of the six axes, m/s and rad/s."""
    times = np.linspace(0.0, motion.duration, _GRID)
    pose = motion.sample(times).pose
    values = np.hstack([pose[:, :3], roll_pitch_yaw(pose[:, 3:])])
    return np.asarray(np.abs(np.diff(values, axis=0)).max(axis=0) / times[1])


@lru_cache(maxsize=4)
def _lengths(task: Task) -> Array:
    """Return the struts' lengths on a grid of the motion, m."""
    times = np.linspace(0.0, task.motion.duration, _GRID)
    return task.robot.inverse_kinematics(task.motion.sample(times).pose)


def _strut_speed(task: Task) -> float:
    steps = np.abs(np.diff(_lengths(task), axis=0)).max()
    return float(steps) * (_GRID - 1) / task.motion.duration


def tolerance(task: Task) -> float:
    """Return the largest deviation of a strut from the design: a share of the largest stroke, m."""
    return _TOLERANCE * float(np.ptp(_lengths(task), axis=0).max())


def condition(settings: Settings) -> str:
    """Say with which rows and limits the planner follows the motion."""
    limits = planner_limits(settings)
    unit = settings.axes.units[0]
    row = settings.section.segment or 10 * limits.period
    speeds = _axis_speeds(settings.task.motion)
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
    path = [f"MAX_LINEAR_VELOCITY = {limits.path_velocity:.12g}"]
    lines = [
        f"# Limits with which the table was executed, {unit} and degrees. With others LinuxCNC's",
        "# planner makes another motion of it. A copy of the machine's INI file is safest: the",
        "# accelerations count for every other move as well.",
        "[EMCMOT]",
        f"SERVO_PERIOD = {round(1e9 * limits.period)}",
        "[TRAJ]",
        "ARC_BLEND_ENABLE = 0",
        *(path if np.isfinite(limits.path_velocity) else []),
    ]
    for letter, speed, acceleration in zip(AXES, limits.velocity, limits.acceleration, strict=True):
        lines += [
            f"[AXIS_{letter}]",
            f"MAX_VELOCITY = {speed:.12g}",
            f"MAX_ACCELERATION = {acceleration:.12g}",
        ]
    return lines


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
    shared = ("digits", "units", "trigger")
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
    guide=Guide(
        before=(
            "For a LinuxCNC machine with the kinematics genhexkins. Two files have its settings: "
            "{beside}. Make a copy of the machine's INI file and HAL files for the experiment. In "
            "the HAL file, replace the setp lines of genhexkins: the geometry has to be that of "
            "the robot file. In the INI file, take over the limits of the axes and the servo "
            "period: with others the planner makes another motion of the table, and every other "
            "move obeys them too. Load no tool offset (G49), set the feed override to 100 % and "
            "the largest velocity to its end."
        ),
        load=(
            "Load the file. Every line is one move with its own duration (G93: F is 1/minutes). A, "
            "B and C are roll, pitch and yaw about the fixed axes x, y, z: R = Rz(C) Ry(B) Rx(A)."
        ),
        run=(
            "Home the machine, move it to the start above with a slow G1 in MDI, and run the file. "
            "Its first line goes to the start in 10 s; at the start it does not move. Abort stops "
            "the motion."
        ),
        record=(
            "These are times of the planner's motion: they differ by some cycles from the design's."
        ),
    ),
    clock="F of G93 with 6 decimals; the planner works in whole servo cycles",
    executed="LinuxCNC 2.9 ran it: its commands agree with a model of the planner to some nm",
    axes={"pose": AXES},
    written_times=_written_times,
    controller=ControllerModel(execute_moves, choose_row_times, tolerance, condition),
    fixed_angles=True,
    beside={ENDING: geometry_lines, PLANNER_ENDING: planner_lines},
    trigger=(
        "M62 P{number} and M63 P{number} switch the digital output motion.digital-out-{number:02} "
        "of HAL together with the motion: it is on from {on} s to {off} s after the start. Connect "
        "it to what records, and load motmod with num_dio above {number}."
    ),
)
