"""LinuxCNC's trapezoidal planner: the platform's pose in every servo cycle of a G-code program.

The model follows the sources of LinuxCNC 2.9 (`interp_inverse.cc`, `emccanon.cc`, `tp.c`, `tc.c`,
`cubic.c`) for moves with rotary axes. Such moves have no blend arcs and no tangent blends: each
ramps up and down with half of its acceleration, and the next one begins when it decelerates. The
model assumes a full queue, 100 % feed override, and no naive CAM detector (Q0 of G64).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from constraints.arrays import Array

_NO_LENGTH = 1e-8
_NO_PROGRAMMED_LENGTH = 1e-7
_LEAST_FEED = 0.1
"""Units per minute."""
_POSITION, _TIME, _VELOCITY = 1e-12, 1e-12, 1e-8
_LONGEST, _MORE_CYCLES = 2.0, 1000
"""Longest planned motion, as a multiple of the programmed time, and further cycles."""
_LEAST_COSINE = math.sin(1e-3)


@dataclass(frozen=True)
class PlannerLimits:
    """Limits in a machine's INI file, in any unit of length and in degrees."""

    period: float
    """``[EMCMOT]SERVO_PERIOD``, s."""
    velocity: Array
    acceleration: Array
    """``MAX_VELOCITY`` and ``MAX_ACCELERATION`` of the axes X, Y, Z, A, B, C, (6,)."""
    path_velocity: float = math.inf
    """``[TRAJ]MAX_LINEAR_VELOCITY``."""


def plan_motion(
    positions: Array, feeds: Array, tolerance: float, limits: PlannerLimits
) -> tuple[Array, Array]:
    """Return the commanded poses (M, 6) in all servo cycles, and the cycles (N,) that end rows.

    Parameters
    ----------
    positions : (N, 6)
        X, Y, Z, A, B, C of the rows; the motion begins at rest at the first.
    feeds : (N - 1,)
        F of each move with G93, 1/min.
    tolerance : float
        P of G64, a length.

    Examples
    --------
    A move of 10 mm and 1° in 0.1 s, with 2000 mm/s² and 10 000 °/s²:

    >>> limits = PlannerLimits(0.001, np.full(6, 1e3), np.repeat([2e3, 1e4], 3))
    >>> there = np.array([[0.0, 0, 0, 0, 0, 0], [10.0, 0, 0, 1.0, 0, 0]])
    >>> len(plan_motion(there, np.array([600.0]), 0.01, limits)[0])
    202
    """
    moves = list(_moves(positions, feeds, tolerance, limits))
    most = _LONGEST * float(np.sum(60 / feeds)) / limits.period + _MORE_CYCLES
    poses = [positions[0]]
    cycles = np.zeros(len(positions), dtype=int)
    for move, following in zip(moves, [*moves[1:], None], strict=True):
        move.blending = move.decelerating = False
        while not move.done and len(poses) < most:
            _run_cycle(move, following, limits.period)
            pose = move.pose
            if following is not None and following.progress > 0:
                pose = pose + following.pose - following.start
            poses.append(pose)
        cycles[move.row] = len(poses) - 1
    # The joints' cubic interpolator.
    padded = np.array([poses[0], *poses, poses[-1], poses[-1]])
    return (padded[:-2] + 4 * padded[1:-1] + padded[2:]) / 6, np.maximum.accumulate(cycles)


@dataclass(eq=False)
class _Move:
    """A straight move in the planner's queue."""

    row: int
    """Index of the row at its end."""
    start: Array
    step: Array
    """(6,), position at its start and the displacement to its end."""
    direction: Array
    """(3,), unit vector of X, Y, Z."""
    length: float
    """Of X, Y, Z, or of A, B, C where these do not move."""
    wanted: float
    """Velocity of the feed, within the limits."""
    acceleration: float
    tolerance: float
    period: float
    """Duration of its next cycle, s."""
    last: bool
    progress: float = 0.0
    velocity: float = 0.0
    blend_velocity: float = 0.0
    blending: bool = False
    decelerating: bool = False
    ending: bool = False
    done: bool = False

    @property
    def pose(self) -> Array:
        return self.start + self.progress / self.length * self.step

    @property
    def reachable(self) -> float:
        """Return the largest velocity between two ramps."""
        half = 0.5 if self.last else 1.0
        return min(math.sqrt(self.acceleration * self.length * half), self.wanted)

    def end_after(self, time: float) -> None:
        """End the move within its next cycle, after a time in s."""
        self.ending, self.period = True, time


def _moves(
    positions: Array, feeds: Array, tolerance: float, limits: PlannerLimits
) -> Iterator[_Move]:
    """Yield the moves that interpreter and canon hand to the planner."""
    steps = np.diff(positions, axis=0)
    distances = np.linalg.norm(steps[:, :3], axis=1)
    turns = np.linalg.norm(steps[:, 3:], axis=1)
    lengths = np.where(distances > _NO_LENGTH, distances, turns)
    programmed = np.max(np.abs(steps[:, :3]), axis=1) > _NO_PROGRAMMED_LENGTH
    rates = np.maximum(_LEAST_FEED, np.where(programmed, distances, turns) * feeds) / 60
    moved = np.where(np.abs(steps) < _NO_LENGTH, 0.0, np.abs(steps))
    straight = np.max(moved[:, :3], axis=1) > 0
    totals = np.where(
        straight, np.linalg.norm(moved[:, :3], axis=1), np.linalg.norm(moved[:, 3:], axis=1)
    )
    queued = np.flatnonzero((totals > 0) & (lengths > _POSITION))
    for k in queued:
        most = min(totals[k] / (moved[k] / limits.velocity).max(), lengths[k] / limits.period)
        if straight[k]:
            most = min(most, limits.path_velocity)
        straight_on = distances[k] > _NO_LENGTH
        yield _Move(
            row=int(k) + 1,
            start=positions[k],
            step=steps[k],
            direction=steps[k, :3] / distances[k] if straight_on else np.array([1.0, 0.0, 0.0]),
            length=float(lengths[k]),
            wanted=float(min(rates[k], most)),
            acceleration=float(totals[k] / (moved[k] / limits.acceleration).max() / 2),
            tolerance=tolerance,
            period=limits.period,
            last=bool(k == queued[-1]),
        )


def _run_cycle(move: _Move, following: _Move | None, period: float) -> None:
    """Advance a move by a servo cycle, and the following one while the two blend."""
    if move.ending:
        move.progress, move.done = move.length, True
        if following is not None:
            _update(following, period)
        return
    move.period = period
    _update(move, period)
    if following is None:
        return
    _set_blend_velocities(move, following)
    move.blending |= move.decelerating and move.velocity < move.blend_velocity
    if move.blending:
        _update(following, period)


def _update(move: _Move, period: float) -> None:
    """Advance a move on its trapezoidal profile."""
    most, time = move.acceleration, move.period
    left = move.length - move.progress
    half = most * time * 0.5
    discriminant = most * (2 * left - move.velocity * time) + half**2
    highest = -half + (math.sqrt(discriminant) if discriminant > half**2 else 0.0)
    wanted = max(min(highest, move.wanted), -move.wanted)
    acceleration = max(min((wanted - move.velocity) / max(time, _TIME), most), -most)
    velocity = move.velocity + acceleration * time
    if velocity >= 0:
        step = (velocity + move.velocity) * 0.5 * time
        move.progress = max(0.0, min(move.progress + step, move.length))
    else:
        velocity = 0.0
        if left < move.velocity * time:
            move.progress = move.length
    move.velocity = velocity
    move.decelerating = abs(highest - velocity) < _VELOCITY and acceleration < 0
    _check_end(move, period)


def _check_end(move: _Move, period: float) -> None:
    """Find out whether a move ends within the next cycle."""
    move.period = period
    left = move.length - move.progress
    if left <= _POSITION:
        move.progress = move.length
        move.end_after(0.0)
        return
    mean = move.velocity / 2
    if mean <= _VELOCITY and left > mean * period:
        return
    time = max(_TIME / 2, left / mean if mean > _VELOCITY else 0.0)
    if move.velocity / time > move.acceleration:
        ramp = move.velocity / move.acceleration
        discriminant = ramp**2 - 2 * left / move.acceleration
        if discriminant < 0:
            return
        time = ramp - (math.sqrt(discriminant) if discriminant >= _TIME**2 else 0.0)
    if time < _TIME:
        move.progress = move.length
        move.end_after(0.0)
    elif time < period and not move.ending:
        move.end_after(time)


def _set_blend_velocities(move: _Move, following: _Move) -> None:
    """Set the velocities below which two moves may overlap."""
    this, other = move.reachable, following.reachable
    longest = min(move.length / this, following.length / other)
    ramp = min(longest, max(this / move.acceleration, other / following.acceleration))
    move.blend_velocity = min(this, ramp * move.acceleration)
    following.blend_velocity = min(other, ramp * following.acceleration)
    along = max(-1.0, min(1.0, float(move.direction @ following.direction)))
    cosine = math.cos(math.acos(-along) / 2)
    if move.tolerance > 0 and cosine > _LEAST_COSINE:
        limit = 2 * math.sqrt(move.acceleration * move.tolerance / cosine)
        move.blend_velocity = min(move.blend_velocity, limit)
        following.blend_velocity = min(following.blend_velocity, limit)
