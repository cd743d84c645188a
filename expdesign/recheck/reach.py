"""How far the platform goes from home along each coordinate alone, and what stops it there."""

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
"""What stops a coordinate, where it is no limit: the struts no longer hold the platform."""

_FARTHEST = 3.0
"""How far a translation is followed: times the longest strut at home."""
_LOOKS = (400, 400, *(20,) * 7)
"""Points of each look: along the whole way, along all before the first that is not admitted, and
then between that and the last before it, again and again.
"""
_TIED = 0.5
"""Rows of a limit that are broken by this share of the worst are told with it."""


@dataclass(frozen=True)
class Stop:
    """The end of a way from home."""

    way: float
    """From home, 0 or more; how far was looked where nothing stops. m or rad."""
    limit: str
    """Key of the limit that is reached, `SINGULAR`, or empty where nothing stops."""
    title: str
    """The same in words."""
    rows: tuple[str, ...]
    """Components, struts or pairs of struts that reach it together."""
    bound: float | None
    """The bound that is reached, in the unit of the limit."""
    unit: str
    """That of the bound."""


@dataclass(frozen=True)
class Reach:
    """How far one coordinate goes while all others stay as they are at home."""

    coordinate: str
    unit: str
    """m or rad."""
    back: Stop
    """Towards smaller values."""
    ahead: Stop


@lru_cache(maxsize=8)
def reach(robot: Robot) -> tuple[Reach, ...]:
    """Return how far each coordinate goes from home alone, at rest, until a limit stops it.

    Looked at are the limits of robot and run at rest: speeds and accelerations stop nothing, and
    forces are those that bear the machine. A singular pose stops it, too. Positions are followed
    for three of the longest struts, rotations for half a turn; what happens between two of the 400
    points of a look is not seen.
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

    def poses(ways: Array) -> Array:
        return home + ways[:, None] * direction

    def broken(ways: Array) -> Mask:
        at = poses(ways)
        worst = np.max(model.violations(states_at_rest(at)), axis=1, initial=-np.inf)
        return (worst > TOLERANCE) | (side_of(model.robot, at) != side)

    way = _first(broken, longest)
    if way is None:
        return Stop(longest, "", "nothing", (), None, "1")
    values = model.values(states_at_rest(poses(np.array([way]))))[0]
    excess = model.excess(values[None, :])[0]
    if not np.any(excess > TOLERANCE):
        return Stop(way, SINGULAR, "singular pose", (), None, "1")
    worst = int(np.argmax(excess))
    limit = next(one for one in model.limits if one.key == model.keys[worst])
    columns = model.columns[model.limits.index(limit)]
    own = excess[columns]
    tied = tuple(limit.labels[row] for row in np.flatnonzero(own >= _TIED * excess[worst]))
    bound = limit.nearest_bound(worst - columns.start, float(values[worst]))
    return Stop(way, limit.key, limit.definition.title, tied, bound, limit.unit)


def side_of(robot: Robot, poses: Array) -> Array:
    """Return the sign of det J of the struts, (N,): it changes where a pose is singular.

    That of ∂q/∂λ, but for the sign of cos θ: the angles' own singularity stops no machine.
    """
    _, jacobian = robot.lengths_and_jacobian(poses)
    theta = poses[:, COORDINATE_NAMES.index("theta")]
    return np.sign(np.linalg.det(jacobian)) * np.sign(np.cos(theta))


def _first(broken: Callable[[Array], Mask], longest: float) -> float | None:
    """Return the smallest way that is broken, up to the last digits; None where none is."""
    low, high = 0.0, longest
    for look, points in enumerate(_LOOKS):
        ways = np.linspace(low, high, points)
        found = np.flatnonzero(broken(ways))
        if not found.size:
            return None
        first = int(found[0])
        high = float(ways[first])
        if look > 0:
            low = float(ways[max(first - 1, 0)])
    return high
