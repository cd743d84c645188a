"""Friction of the actuators in proportion to their load: screws, belts and guides.

The load is the frictionless force of the terms listed before this one at the parameters of
`HexapodGraph.nominal`. The forces are not linear in all parameters together: an estimate repeats
the computation with the load of its own result (`estimation.identification.recording`).
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
    return Columns(along=ca.diag(instant.signs[STRUT_SPEED] * ca.fabs(instant.load)))


TERM = Term(
    name="load_friction",
    place=110,
    meaning="friction of the actuators in proportion to their load",
    parameters=per_actuator(
        Parameter(
            "mu",
            "1",
            "friction of the actuators as a share of their load",
            Scale("0.1", share=0.1),
            lower=0,
            default=0.0,
        )
    ),
    columns=_columns,
    rates=(STRUT_SPEED,),
)
