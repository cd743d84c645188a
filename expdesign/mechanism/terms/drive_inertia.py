"""Inertia of the drives: what turns h/2π of a turn for every metre of a strut counts as a mass.

A motor and screw of inertia J behind a lead h have ½ J (2π/h)² q̇² of energy along the strut. That
the strut carries them as it swings is left out: with the angle α of the strut about its first axis
the screw turns by α̇ sin β besides, whose share of q̇ 2π/h is small for any screw.
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
