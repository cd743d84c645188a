"""Friction of the actuators with the square of their speed: oil and air that they move.

Nonlinear viscous friction is F_v |q̇|^δ sign q̇ in Olsson, Åström, Canudas de Wit, Gäfvert and
Lischinsky (European Journal of Control 4, 1998). Here δ is 2 and in `cubic_friction` 3: the model
stays linear in its parameters, and both together make a polynomial of the speed.
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
    speed = instant.kinematic["strut_speed"]
    return Columns(along=ca.diag(instant.signs[STRUT_SPEED] * speed**2))


TERM = Term(
    name="quadratic_friction",
    place=70,
    meaning="friction of the actuators with the square of their speed",
    parameters=per_actuator(
        Parameter(
            "w",
            "N s^2/m^2",
            "friction of the actuators per square of the speed",
            Scale("p10 / (6 L)", mass=1, length=-1, share=1 / 6),
            default=0.0,
        )
    ),
    columns=_columns,
    rates=(STRUT_SPEED,),
)
