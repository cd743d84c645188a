"""Viscous friction of the actuators that differs between extension and retraction.

Separate dry and viscous friction for each direction, r⁺ + v⁺ q̇ for q̇ > 0 and −r⁻ + v⁻ q̇ for
q̇ < 0, are

    r sign q̇ + v q̇  +  ½ (r⁺ − r⁻) |sign q̇|  +  ½ (v⁺ − v⁻) |q̇|

with the means r and v, which are those of `actuator_friction`. While the actuator moves, the third
part is a constant force: no motion tells it from the zero of the force, and the parameter that both
have together is the offset of `force_offset`. (So they are taken in the identification of
industrial robots, as one offset of amplifier and asymmetrical Coulomb friction: Gautier, Janot,
Vandanjon, IEEE Transactions on Control Systems Technology 21, 2013.) This term is the fourth part,
a = ½ (v⁺ − v⁻), which is neither.

The load has friction of another direction, too, that of `load_friction`: it is none of this.
"""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.term import (
    DAMPING_SCALE,
    STRUT_SPEED,
    Columns,
    Instant,
    Parameter,
    Term,
    per_actuator,
)


def _columns(instant: Instant) -> Columns:
    # |q̇| by the sign, which an optimiser sees smoothed.
    return Columns(along=ca.diag(instant.signs[STRUT_SPEED] * instant.kinematic["strut_speed"]))


TERM = Term(
    name="asymmetric_friction",
    place=60,
    meaning="viscous friction of the actuators that differs between extending and retracting",
    parameters=per_actuator(
        Parameter(
            "a",
            "N s/m",
            "half the difference of viscous friction between extending and retracting",
            DAMPING_SCALE,
            default=0.0,
        )
    ),
    columns=_columns,
    rates=(STRUT_SPEED,),
)
