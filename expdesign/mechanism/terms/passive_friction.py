"""Dry friction about the cardan axes at the base, carried to the actuators by virtual work."""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.term import ALPHA_RATE, BETA_RATE, Columns, Instant, Parameter, Term

_MEANING = "dry friction about the cardan axes, the same in all struts"


def _columns(instant: Instant) -> Columns:
    alpha, beta = instant.signs[ALPHA_RATE], instant.signs[BETA_RATE]
    pairs = zip(ca.vertsplit(alpha), ca.vertsplit(beta), strict=True)
    return Columns(torques=ca.vertcat(*(ca.diag(ca.vertcat(*pair)) for pair in pairs)))


TERM = Term(
    name="passive_friction",
    place=40,
    meaning="dry friction about the cardan axes",
    parameters=tuple(Parameter(name, "N m", _MEANING, lower=0) for name in ("r_alpha", "r_beta")),
    columns=_columns,
    rates=(ALPHA_RATE, BETA_RATE),
)
