"""A constant force of each actuator: the zero of its force measurement, a bias of its current."""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.term import WEIGHT_SCALE, Columns, Instant, Parameter, Term, per_actuator


def _columns(_: Instant) -> Columns:
    return Columns(along=ca.SX.eye(ACTUATORS))


TERM = Term(
    name="force_offset",
    place=90,
    meaning="constant force of each actuator",
    parameters=per_actuator(
        Parameter("o", "N", "constant force of the actuators", WEIGHT_SCALE, default=0.0)
    ),
    columns=_columns,
)
