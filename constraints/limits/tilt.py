"""Angle between the platform's and the base's z axis."""

import casadi as ca
import numpy as np

from constraints.definition import LimitDefinition, Quantities


def _tilt(q: Quantities) -> ca.SX:
    # atan2 of sine and cosine: the arc cosine alone loses half its digits near zero.
    rotation = q["rotation_matrix"]
    return ca.atan2(ca.hypot(rotation[0, 2], rotation[1, 2]), rotation[2, 2])


LIMIT = LimitDefinition(
    key="tilt",
    title="tilt of the platform",
    unit="rad",
    kind="upper",
    requires=("rotation_matrix",),
    natural=_tilt,
    smooth=lambda q: q["rotation_matrix"][2, 2],
    transform=np.cos,
    decreasing=True,
)
