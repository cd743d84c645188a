"""How far the attitude stays from where the rotation angles φ, θ, ψ are singular: θ = ±90°."""

import math
from collections.abc import Mapping

import casadi as ca
import numpy as np

from constraints.definition import Limit, LimitDefinition, Quantities

_BOUND = math.radians(80)
LARGEST = math.radians(85)
"""A home beyond it is refused, and so is a wider bound: 1/cos θ, by which the angles turn faster
than the platform, is 11 there."""


def _theta(q: Quantities) -> ca.SX:
    # The third column of R is (sin θ, −sin φ cos θ, cos φ cos θ). Past a quarter turn θ counts
    # from the half turn: 170° is as far from ±90° as 10°.
    rotation = q["rotation_matrix"]
    return ca.atan2(rotation[0, 2], ca.hypot(rotation[0, 0], rotation[0, 1]))


def _largest_within(low: float, high: float) -> float:
    """Return how close to ±90° θ comes between two values: as the limit counts it, rad."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return math.pi / 2
    turns = round(low / math.pi)
    if turns != round(high / math.pi):
        return math.pi / 2
    return max(abs(low - math.pi * turns), abs(high - math.pi * turns))


def _held_by(limits: Mapping[str, Limit]) -> str | None:
    tilt, rotation = limits.get("tilt"), limits.get("rotation")
    # cos(tilt) = cos φ cos θ: who tilts by less than 80° has no larger θ.
    if tilt is not None and tilt.stated_bounds[1][0] <= _BOUND:
        return tilt.key
    if rotation is not None:
        row = rotation.labels.index("theta")
        low, high = (float(side[row]) for side in rotation.stated_bounds)
        if _largest_within(low, high) <= _BOUND:
            return rotation.key
    return None


LIMIT = LimitDefinition(
    key="attitude",
    title="attitude angle θ",
    unit="rad",
    kind="symmetric",
    requires=("rotation_matrix",),
    natural=_theta,
    smooth=lambda q: q["rotation_matrix"][0, 2],
    transform=np.sin,
    standing=_BOUND,
    widest=LARGEST,
    held_by=_held_by,
    remedy=(
        "Where theta is ±90 deg, phi, theta and psi are singular: turn the base frame so that its "
        "z axis is along the platform's at home, and state home, base_joints, gravity and "
        "alpha_axes in it"
    ),
)
