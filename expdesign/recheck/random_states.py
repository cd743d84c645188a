"""Random states within the limits of a machine: what no motion can reach is not among them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.mechanism.hexapod import COORDINATES
from expdesign.recheck.reach import reach, side_of
from expdesign.robot import LimitModel, Robot
from expdesign.robot.limit_model import states_at_rest

_DRAWS = 8
"""Batches that are drawn at most: of a batch some states are always within the limits."""
_BISECTIONS = 6


def random_states(robot: Robot, count: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Return poses, rates and accelerations, (count, 6) each, m, rad, s, that keep every limit.

    Each coordinate is drawn from its reach, then the pose is drawn back towards home, the rates and
    the accelerations towards zero, until the limits of robot and run are kept. Speeds and
    accelerations that nothing limits are drawn as lengths of the struts per s and s². Of a machine
    hardly any of whose states keep the limits, as many as were found are returned, at least that
    at rest at home.
    """
    model, rng = LimitModel.of(robot), np.random.default_rng(seed)
    ways = np.array([[-one.back.way, one.ahead.way] for one in reach(robot)])
    states = np.concatenate([robot.home, np.zeros(2 * COORDINATES)])[None, :]
    for _ in range(_DRAWS):
        states = np.concatenate([_drawn(model, ways, count, rng), states])
        if len(states) > count:
            break
    pose, rate, acceleration = np.split(states[:count], 3, axis=1)
    return pose, rate, acceleration


def _drawn(model: LimitModel, ways: Array, count: int, rng: np.random.Generator) -> Array:
    """Return states, (≤ count, 18), as many of those drawn as keep the limits."""
    robot = model.robot
    home = robot.home[None, :]
    side = side_of(robot, home)[0]

    def kept(states: Array) -> Mask:
        within = np.all(model.violations(states) <= 0, axis=1)
        return within & (side_of(robot, states[:, :COORDINATES]) == side)

    def moved(states: Array, part: int, change: Array) -> Array:
        """Move pose, rate or acceleration as far as is kept; not only states at a limit count."""
        whole = np.zeros_like(states)
        whole[:, part * COORDINATES : (part + 1) * COORDINATES] = change
        share = _largest_shares(lambda shares: kept(states + shares[:, None] * whole), count)
        return states + (share * np.sqrt(rng.uniform(size=count)))[:, None] * whole

    offset = rng.uniform(ways[:, 0], ways[:, 1], (count, COORDINATES))
    states = moved(states_at_rest(np.repeat(home, count, axis=0)), 0, offset)
    _, jacobian = robot.lengths_and_jacobian(states[:, :COORDINATES])
    for part, key in enumerate(("strut_speed", "strut_acceleration"), start=1):
        struts = _pace(robot, key) * rng.uniform(-1, 1, (count, COORDINATES))
        change = np.linalg.solve(jacobian, struts[:, :, None])[:, :, 0]
        states = moved(states, part, np.asarray(change, dtype=np.float64))
    return states[kept(states)]


def _pace(robot: Robot, key: str) -> Array:
    """Return how fast the struts are drawn at most, (6,): the limit where there is one.

    Where there is none it is their lengths at home per s and s².
    """
    limit, free = robot.limit(key), robot.inverse_kinematics(robot.home)
    return free if limit is None else np.where(np.isfinite(limit.upper), limit.upper, free)


def _largest_shares(kept: Callable[[Array], Mask], count: int) -> Array:
    """Return by bisection the largest shares, (count,) up to 1, that are kept."""
    low, high = np.zeros(count), np.ones(count)
    whole = kept(high)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        fits = kept(middle)
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    return np.where(whole, 1.0, low)
