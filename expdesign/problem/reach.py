"""How far each coordinate can move from home: the natural unit of the design's variables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from expdesign.robot import ExactModel

Array = NDArray[np.float64]

LARGEST_ANGLE = np.pi / 2

_STEPS = 400
_ENOUGH_STEPS = 100
_REFINEMENTS = 4


def coordinate_reach(model: ExactModel) -> Array:
    """Return (6,) displacements from home, m and rad, that keep the limits at rest.

    Each coordinate is moved alone, to both sides, as far as the limits allow; the smaller side
    counts. Angles that nothing bounds are taken as 90°, positions as ten characteristic lengths.
    """
    robot = model.robot
    farthest = np.array([10 * robot.characteristic_length] * 3 + [LARGEST_ANGLE] * 3)
    shares = np.linspace(0, 1, _STEPS + 1)[1:]
    reach = farthest.copy()
    for i in range(6):
        for side in (-1.0, 1.0):
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
            reach[i] = min(reach[i], span * max(steps, 1) / shares.size)
    return reach
