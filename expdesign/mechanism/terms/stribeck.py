"""Friction of the actuators near standstill, beyond the dry one: it falls as the speed grows.

The Gaussian form, s exp(−(v/v_s)²) sign(v), of Armstrong-Hélouvry, Dupont and Canudas de Wit
(Automatica 30, 1994).
"""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.term import (
    STRUT_SPEED,
    WEIGHT_SCALE,
    Columns,
    Constant,
    Instant,
    Parameter,
    Term,
    per_actuator,
)


def _columns(instant: Instant) -> Columns:
    ratio = instant.kinematic["strut_speed"] / instant.constants["velocity"]
    return Columns(along=ca.diag(instant.signs[STRUT_SPEED] * ca.exp(-(ratio**2))))


TERM = Term(
    name="stribeck",
    place=100,
    meaning="friction of the actuators near standstill, beyond the dry one",
    parameters=per_actuator(
        Parameter(
            "s",
            "N",
            "friction of the actuators at standstill, beyond the dry one",
            WEIGHT_SCALE,
            default=0.0,
        )
    ),
    columns=_columns,
    rates=(STRUT_SPEED,),
    constants=(Constant("velocity", "m/s", "speed at which it has fallen to 1/e", positive=True),),
)
