"""Inertia of the drives, reflected through lead or gear as a mass along the strut.

A motor and screw of inertia J behind a lead h have ½ J (2π/h)² q̇² of energy along the strut. Their
motion with the swinging strut is neglected: the strut's angle α about its first axis adds a turn
α̇ sin β of the screw, a small share of q̇ 2π/h for any screw.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from expdesign.mechanism.term import Columns, Instant, Parameter, Scale, Term

MASS = "m_drive"


def _columns(instant: Instant) -> Columns:
    return Columns(along=ca.SX(instant.kinematic["strut_acceleration"]))


TERM = Term(
    name="drive_inertia",
    place=30,
    meaning="inertia of the drives, as a mass along each strut",
    parameters=(
        Parameter(
            MASS,
            "kg",
            "mass that a drive's inertia makes along its strut, $J\\,(2\\pi/h)^2$, the same in all",
            Scale("p10", mass=1),
            lower=0,
            default=0.0,
        ),
    ),
    columns=_columns,
)
ON_A_THREAD = replace(TERM, turning=True)
"""The same of screws that the platform turns (`expdesign.mechanism.strut`)."""
