"""Forces along the struts beyond friction: offset, cogging, springs such as cables."""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.term import (
    WEIGHT_SCALE,
    Columns,
    Constant,
    Instant,
    Parameter,
    Scale,
    Term,
    per_actuator,
)

OFFSET = Term(
    name="force_offset",
    place=90,
    meaning="constant force of each actuator",
    parameters=per_actuator(
        Parameter("o", "N", "constant force of the actuators", WEIGHT_SCALE, default=0.0)
    ),
    columns=lambda _: Columns(along=ca.SX.eye(ACTUATORS)),
)
"""The zero of the force measurement, or the bias of a current."""
CABLE = Term(
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
    columns=lambda instant: Columns(
        along=ca.diag(instant.kinematic["strut_length"] - instant.constants["rest_length"])
    ),
    constants=(Constant("rest_length", "m", "length of a strut at which there is no force"),),
)
"""Cables, hoses and bellows: a force linear in the strut's length, with one rest length for all.

If the rest lengths are unknown, the term `force_offset` absorbs their error: the stiffness is then
independent of the rest length.
"""


def _cogging(instant: Instant, order: int) -> Columns:
    """Return the columns of sines, then cosines, of a harmonic of the pitch."""
    angle = 2 * ca.pi * order * instant.kinematic["strut_length"] / instant.constants["pitch"]
    return Columns(along=ca.horzcat(ca.diag(ca.sin(angle)), ca.diag(ca.cos(angle))))


def _amplitudes(letter: str, order: str) -> tuple[Parameter, ...]:
    """Return the amplitudes of sines, then cosines, whose names begin with a letter."""
    return tuple(
        parameter
        for kind, word in (("s", "sine"), ("c", "cosine"))
        for parameter in per_actuator(
            Parameter(
                letter + kind,
                "N",
                f"{word} of the actuators' cogging, {order} harmonic",
                WEIGHT_SCALE,
                default=0.0,
            )
        )
    )


COGGING = Term(
    name="cogging",
    place=130,
    meaning="forces of the actuators with the period of a pitch, such as that of their magnets",
    parameters=_amplitudes("c", "first"),
    columns=lambda instant: _cogging(instant, 1),
    constants=(
        Constant("pitch", "m", "stroke of an actuator in which they repeat", positive=True),
    ),
)
"""Cogging of linear motors, and errors of screws and bearings with the period of their turns.

The force is a Fourier series of the position (Röhrig and Jochheim, Identification and compensation
of force ripple in linear permanent magnet motors, American Control Conference 2001). This is the
first harmonic of the pitch τ,

    cs sin(2π q/τ) + cc cos(2π q/τ) = amplitude · sin(2π q/τ + phase),

with amplitude² = cs² + cc² and phase = atan2(cc, cs), as in the twin's `experiment.cogging`.
"""
SECOND_COGGING = Term(
    name="cogging_second",
    place=140,
    meaning="second harmonic of the cogging, with half its period",
    parameters=_amplitudes("d", "second"),
    columns=lambda instant: _cogging(instant, 2),
    beside=COGGING.name,
)
TERMS = (OFFSET, CABLE, COGGING, SECOND_COGGING)
