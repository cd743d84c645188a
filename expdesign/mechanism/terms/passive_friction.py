"""Dry friction about the cardan axes at the base, carried to the actuators by virtual work."""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.strut import torque_wrench
from expdesign.mechanism.term import ALPHA_RATE, BETA_RATE, Columns, Instant, Parameter, Term


def _columns(instant: Instant) -> Columns:
    alpha, beta = instant.signs[ALPHA_RATE], instant.signs[BETA_RATE]
    return Columns(
        sum(
            (
                torque_wrench(strut, instant.arms[:, j], ca.diag(ca.vertcat(alpha[j], beta[j])))
                for j, strut in enumerate(instant.struts)
            ),
            ca.SX.zeros(6, 2),
        )
    )


TERM = Term(
    name="passive_friction",
    meaning="dry friction about the cardan axes",
    parameters=tuple(
        Parameter(
            name, "N m", "dry friction about the cardan axes, the same in all struts", lower=0
        )
        for name in ("r_alpha", "r_beta")
    ),
    columns=_columns,
    rates=(ALPHA_RATE, BETA_RATE),
)
