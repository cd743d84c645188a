"""How far each coordinate can move from home: the natural unit of the design's variables."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.robot import LimitModel

LARGEST_ANGLE = np.pi / 2

_STEPS = 400
_ENOUGH_STEPS = 100
_REFINEMENTS = 4
_SMALLEST_SHARE = 1e-6


def coordinate_reach(model: LimitModel) -> tuple[Array, Array]:
    """Return middle (6,) and half-width (6,) of the motion that the limits allow at rest: m, rad.

    Each coordinate is moved alone from home, to both sides, as far as the limits allow. Angles
    that nothing bounds are taken as 90°, positions as ten characteristic lengths. The middle is
    drawn back towards home as far as all coordinates together need it.
    """
    robot = model.robot
    farthest = np.array([10 * robot.characteristic_length] * 3 + [LARGEST_ANGLE] * 3)
    shares = np.linspace(0, 1, _STEPS + 1)[1:]
    sides = np.zeros((2, 6))
    for i in range(6):
        for row, side in enumerate((-1.0, 1.0)):
            span = farthest[i]
            # Ever finer: a machine may move a thousandth of what its size suggests.
            for _ in range(_REFINEMENTS):
                states = np.zeros((shares.size, 18))
                states[:, :6] = robot.home
                states[:, i] += side * shares * span
                kept = np.all(model.violations(states) <= 0, axis=1)
                steps = shares.size if np.all(kept) else int(np.argmin(kept))
                if steps >= _ENOUGH_STEPS:
                    break
                span *= (steps + 1) / shares.size
            sides[row, i] = span * steps / shares.size
    half = np.maximum(sides.sum(axis=0) / 2, _SMALLEST_SHARE * farthest)
    offset = (sides[1] - sides[0]) / 2
    for share in (1.0, 0.5, 0.25, 0.125):
        state = np.concatenate([robot.home + share * offset, np.zeros(12)])[None, :]
        if np.all(model.violations(state) < 0):
            return robot.home + share * offset, half
    return robot.home.copy(), half
