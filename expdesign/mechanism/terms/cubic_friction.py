"""Friction of the actuators with the third power of their speed: viscous friction is not linear.

A parameter above zero: it grows faster than the speed. Below zero: a lubricant that shears or warms
up lets it grow more slowly. See `quadratic_friction`.
"""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.term import (
    STRUT_SPEED,
    Columns,
    Instant,
    Parameter,
    Scale,
    Term,
    per_actuator,
)


def _columns(instant: Instant) -> Columns:
    return Columns(along=ca.diag(instant.kinematic["strut_speed"] ** 3))


TERM = Term(
    name="cubic_friction",
    place=80,
    meaning="friction of the actuators with the third power of their speed",
    parameters=per_actuator(
        Parameter(
            "c",
            "N s^3/m^3",
            "friction of the actuators per third power of the speed",
            Scale("p10 / (6 √(g L³))", mass=1, length=-1.5, gravity=-0.5, share=1 / 6),
            default=0.0,
        )
    ),
    columns=_columns,
    # |q̇|³ sign q̇ needs no sign to be told: this one says that it is friction, and no load.
    rates=(STRUT_SPEED,),
)
