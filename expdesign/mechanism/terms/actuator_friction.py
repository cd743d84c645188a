"""Dry and viscous friction of the actuators."""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.term import STRUT_SPEED, Columns, Instant, Parameter, Term, per_actuator


def _columns(instant: Instant) -> Columns:
    dry = ca.diag(instant.signs[STRUT_SPEED])
    return Columns(along=ca.horzcat(dry, ca.diag(instant.kinematic["strut_speed"])))


TERM = Term(
    name="actuator_friction",
    place=50,
    meaning="dry and viscous friction of the actuators",
    parameters=(
        *per_actuator(Parameter("r", "N", "dry friction of the actuators", lower=0)),
        *per_actuator(Parameter("v", "N s/m", "viscous friction of the actuators", lower=0)),
    ),
    columns=_columns,
    rates=(STRUT_SPEED,),
)
