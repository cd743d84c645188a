"""LinuxCNC: G-code in the pose of the platform, for machines with genhexkins."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import model_validator

from constraints.arrays import Array
from expdesign.configuration import ResolvedRobot
from expdesign.configuration.errors import refusal
from expdesign.configuration.export import ExportSection
from expdesign.configuration.quantity import Length, Positive
from expdesign.export.definition import (
    LENGTH_UNITS,
    Guide,
    Interpolation,
    Rows,
    Settings,
    TableError,
    TableFormat,
    switched_at,
    switching,
)
from expdesign.export.text_table import every_line, lines, mark_window, number, write_lines

AXES = ("X", "Y", "Z", "A", "B", "C")
START_FEED = 6.0
"""1/min: the move to the start takes 10 s; a machine at the start does not move."""
_FEED_DIGITS = 6
_BLEND = 1e-5
_COMMENT = re.compile(r"\([^()]*\)")
_WORD = re.compile(r"([A-Z])([^A-Z\s]*)")
_UNIT_CODES = {"mm": "G21", "in": "G20"}


def _feeds(times: Array) -> Array:
    return np.round(60 / np.diff(times), _FEED_DIGITS)


def _written_times(times: Array, _settings: Settings) -> Array:
    return np.concatenate([[0.0], np.cumsum(60 / _feeds(times))])


def _write(path: Path, rows: Rows, settings: Settings) -> None:
    unit = settings.axes.units[0]
    blend = LENGTH_UNITS[unit] * (getattr(settings.section, "blend", None) or _BLEND)
    head = [
        f"({settings.title}: {unit} and degrees, A B C are roll, pitch and yaw about fixed axes)",
        f"{_UNIT_CODES[unit]} G90 G93 G64 P{blend:.8f}",
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
            modes |= {f"{letter}{value}" for letter, value in words if letter != "P"}
            if modes - header:
                raise TableError(f"line {k}: '{code[:40]}' is none of our codes")
    if not ended:
        raise TableError("the program has no M2 at its end")
    if any(feed <= 0 for feed in feeds):
        raise TableError("a feed is not positive")
    times = np.concatenate([[0.0], np.cumsum(60 / np.array(feeds[1:]))])
    rows = Rows(times, np.array(positions).reshape(-1, len(AXES))).checked()
    return switched_at(switched, rows)


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


class GcodeOptions(ExportSection):
    """Options of G-code for LinuxCNC."""

    spaces = ("pose",)
    shared = ("digits", "units", "trigger")
    outputs = (0, 63)
    """P of M62 and M63."""

    blend: Annotated[Length, Positive] | None = None
    """Path tolerance of LinuxCNC's G64, m."""

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
            "For a LinuxCNC machine with the kinematics genhexkins. Its geometry has to be that of "
            "the robot file: replace the setp lines of the machine's HAL file by those of "
            "{beside}, and load no tool offset (G49). Check that the velocity and acceleration "
            "limits of joints and axes in the INI file are not below those of the design: the "
            "planner would stretch the motion in time."
        ),
        load=(
            "Load the file. Every line is one move with its own duration (G93: F is 1/minutes). A, "
            "B and C are roll, pitch and yaw about the fixed axes x, y, z: R = Rz(C) Ry(B) Rx(A)."
        ),
        run="Home the machine, move it to the start below, and run the file.",
    ),
    clock="rows of F as written; moves of the planner last whole servo cycles",
    axes={"pose": AXES},
    written_times=_written_times,
    uniform=True,
    fixed_angles=True,
    beside={ENDING: geometry_lines},
    trigger=(
        "M62 P{number} and M63 P{number} switch the digital output motion.digital-out-{number:02} "
        "of HAL together with the motion: it is on from {on} s to {off} s after the start. Connect "
        "it to what records, and load motmod with num_dio above {number}."
    ),
)
