"""A spring along each strut: cables, hoses and bellows that the strut stretches.

The force is linear in the strut's length about one rest length for all struts. If the rest
lengths are unknown, the term `force_offset` absorbs their error: the stiffness is then independent
of the rest length.
"""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.term import (
    Columns,
    Constant,
    Instant,
    Parameter,
    Scale,
    Term,
    per_actuator,
)


def _columns(instant: Instant) -> Columns:
    return Columns(
        along=ca.diag(instant.kinematic["strut_length"] - instant.constants["rest_length"])
    )


TERM = Term(
    name="cable",
    place=120,
    meaning="springs along the struts, such as cables and hoses",
    parameters=per_actuator(
        Parameter(
            "k",
            "N/m",
            "stiffness of the spring along a strut",
            Scale("p10 g / (6 L)", mass=1, gravity=1, length=-1, share=1 / ACTUATORS),
            default=0.0,
        )
    ),
    columns=_columns,
    constants=(Constant("rest_length", "m", "length of a strut at which there is no force"),),
)
