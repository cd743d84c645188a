"""Reach of the platform from home along each coordinate alone, and the limits that stop it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.mechanism.hexapod import COORDINATE_NAMES, COORDINATES, POSE
from expdesign.progress import track
from expdesign.recheck.limit_check import TOLERANCE
from expdesign.robot import LimitModel, Robot
from expdesign.robot.limit_model import states_at_rest

SINGULAR = "singular"
"""Key of a stop at a singular pose, where the struts no longer hold the platform."""

_FARTHEST = 3.0
"""Largest translation, relative to the longest strut at home."""
_LOOKS = (400, 400, *(20,) * 7)
"""Points of each search: over the whole distance, up to the first inadmissible point, and then
repeatedly between that point and the one before it.
"""
_TIED = 0.5
"""Rows of a limit violated by this share of the worst are named with it."""


@dataclass(frozen=True)
class Stop:
    """The end of a movement from home."""

    travel: float
    """From home, 0 or more, m or rad; without a stop the distance searched."""
    limit: str
    """Key of the limit that is reached, `SINGULAR`, or empty without a stop."""
    title: str
    """The limit in words."""
    rows: tuple[str, ...]
    """Components, struts or pairs of struts that reach it."""
    bound: float | None
    """The bound that is reached."""
    unit: str
    """Unit of the bound."""


@dataclass(frozen=True)
class Reach:
    """Reach of one coordinate with all others at home."""

    coordinate: str
    unit: str
    """m or rad."""
    back: Stop
    """Towards smaller values."""
    ahead: Stop


@lru_cache(maxsize=8)
def reach(robot: Robot) -> tuple[Reach, ...]:
    """Return the reach of each coordinate from home, at rest, up to the first limit.

    The limits of robot and run apply at rest: speeds and accelerations are zero, and forces are
    static. A singular pose is a stop as well. Positions are searched up to three times the longest
    strut, rotations up to half a turn, at 400 points.
    """
    model = LimitModel.of(robot)
    far = _FARTHEST * float(np.max(robot.inverse_kinematics(robot.home)))
    found = []
    for k, coordinate in enumerate(track("the reach of each coordinate", POSE)):
        longest = far if coordinate.unit == "m" else np.pi
        back, ahead = (_stop(model, sign * np.eye(COORDINATES)[k], longest) for sign in (-1, 1))
        found.append(Reach(coordinate.name, coordinate.unit, back, ahead))
    return tuple(found)


def _stop(model: LimitModel, direction: Array, longest: float) -> Stop:
    home = model.robot.home
    side = side_of(model.robot, home[None, :])[0]

    def poses(distances: Array) -> Array:
        return home + distances[:, None] * direction

    def broken(distances: Array) -> Mask:
        at = poses(distances)
        worst = np.max(model.violations(states_at_rest(at)), axis=1, initial=-np.inf)
        return (worst > TOLERANCE) | (side_of(model.robot, at) != side)

    distance = _first(broken, longest)
    if distance is None:
        return Stop(longest, "", "nothing", (), None, "1")
    values = model.values(states_at_rest(poses(np.array([distance]))))[0]
    excess = model.excess(values[None, :])[0]
    if not np.any(excess > TOLERANCE):
        return Stop(distance, SINGULAR, "singular pose", (), None, "1")
    worst = int(np.argmax(excess))
    limit = next(one for one in model.limits if one.key == model.keys[worst])
    columns = model.columns[model.limits.index(limit)]
    own = excess[columns]
    tied = tuple(limit.labels[row] for row in np.flatnonzero(own >= _TIED * excess[worst]))
    bound = limit.nearest_bound(worst - columns.start, float(values[worst]))
    return Stop(distance, limit.key, limit.definition.title, tied, bound, limit.unit)


def side_of(robot: Robot, poses: Array) -> Array:
    """Return the sign of det J of the struts, (N,): it changes at singular poses.

    It is the sign of det ∂q/∂λ without that of cos θ: the singularity of the angles is not one of
    the machine.
    """
    _, jacobian = robot.lengths_and_jacobian(poses)
    theta = poses[:, COORDINATE_NAMES.index("theta")]
    return np.sign(np.linalg.det(jacobian)) * np.sign(np.cos(theta))


def _first(broken: Callable[[Array], Mask], longest: float) -> float | None:
    """Return the smallest inadmissible distance, to nearly full precision; None without one."""
    low, high = 0.0, longest
    for look, points in enumerate(_LOOKS):
        distances = np.linspace(low, high, points)
        found = np.flatnonzero(broken(distances))
        if not found.size:
            return None
        first = int(found[0])
        high = float(distances[first])
        if look > 0:
            low = float(distances[max(first - 1, 0)])
    return high
