"""Forces of the actuators that are periodic in their coordinate: cogging of linear motors.

Magnets and iron attract each other with the period of the poles, screws and bearings with that of
their turns: the force is a Fourier series of the position (Röhrig and Jochheim, Identification and
compensation of force ripple in linear permanent magnet motors, American Control Conference 2001).
This is the first harmonic of the pitch τ,

    cs sin(2π q/τ) + cc cos(2π q/τ) = amplitude · sin(2π q/τ + phase),

with amplitude² = cs² + cc² and phase = atan2(cc, cs), which are those of the twin's
`experiment.cogging`. `cogging_second` is the second one.
"""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.term import (
    WEIGHT_SCALE,
    Columns,
    Constant,
    Instant,
    Parameter,
    Term,
    per_actuator,
)

PITCH = "pitch"


def columns_of(instant: Instant, order: int) -> Columns:
    """Return the columns of sines, then cosines, of a harmonic of the pitch."""
    angle = 2 * ca.pi * order * instant.kinematic["strut_length"] / instant.constants[PITCH]
    return Columns(along=ca.horzcat(ca.diag(ca.sin(angle)), ca.diag(ca.cos(angle))))


def parameters_of(letter: str, order: str) -> tuple[Parameter, ...]:
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


def _columns(instant: Instant) -> Columns:
    return columns_of(instant, 1)


TERM = Term(
    name="cogging",
    place=130,
    meaning="forces of the actuators with the period of a pitch, such as that of their magnets",
    parameters=parameters_of("c", "first"),
    columns=_columns,
    constants=(Constant(PITCH, "m", "stroke of an actuator in which they repeat", positive=True),),
)
