"""Forces along the struts beyond friction: drive inertia, offset, cogging, springs."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca

from expdesign.mechanism import term
from expdesign.mechanism.hexapod import ACTUATORS

DRIVE_MASS = "m_drive"
DRIVE_INERTIA = term.Term(
    name="drive_inertia",
    place=30,
    meaning="inertia of the drives, as a mass along each strut",
    parameters=(
        term.Parameter(
            DRIVE_MASS,
            "kg",
            "mass that a drive's inertia makes along its strut, $J\\,(2\\pi/h)^2$, the same in all",
            term.Scale("p10", mass=1),
            "mass that the inertia of motor and screw makes along a strut",
            lower=0,
            default=0.0,
        ),
    ),
    columns=lambda instant: term.Columns(along=ca.SX(instant.kinematic["strut_acceleration"])),
)
"""Inertia of the drives, reflected through lead or gear as a mass along the strut.

A motor and screw of inertia J behind a lead h have ½ J (2π/h)² q̇² of energy along the strut. Their
motion with the swinging strut is neglected: the strut's angle α about its first axis adds a turn
α̇ sin β of the screw, a small share of q̇ 2π/h for any screw.
"""
DRIVE_INERTIA_ON_A_THREAD = replace(DRIVE_INERTIA, turning=True)
"""The same for screws that the platform turns (`expdesign.mechanism.strut`)."""
BACK_EMF = term.Term(
    name="back_emf",
    place=55,
    meaning="damping of the drives by the voltage that their motors induce",
    parameters=term.per_actuator(
        term.Parameter(
            "e",
            "N s/m",
            "damping by the induced voltage of a motor",
            term.DAMPING_SCALE,
            lower=0,
            default=0.0,
        )
    ),
    columns=lambda instant: term.Columns(along=ca.diag(instant.kinematic["strut_speed"])),
    viscous=True,
)
"""Share of the speed in forces that come from voltages, K²/R q̇ with K in N/A along the strut.

The voltage u at the terminals makes the force K/R u − K²/R q̇. The term is added, with values that
are known, when forces were recorded as voltages.
"""
OFFSET = term.Term(
    name="force_offset",
    place=90,
    meaning="constant force of each actuator",
    parameters=term.per_actuator(
        term.Parameter("o", "N", "constant force of the actuators", term.WEIGHT_SCALE, default=0.0)
    ),
    columns=lambda _: term.Columns(along=ca.SX.eye(ACTUATORS)),
)
"""The zero of the force measurement, or the bias of a current."""
CABLE = term.Term(
    name="cable",
    place=120,
    meaning="springs along the struts, such as cables and hoses",
    parameters=term.per_actuator(
        term.Parameter(
            "k",
            "N/m",
            "stiffness of the spring along a strut",
            term.Scale("p10 g / (6 L)", mass=1, gravity=1, length=-1, share=1 / ACTUATORS),
            default=0.0,
        )
    ),
    columns=lambda instant: term.Columns(
        along=ca.diag(instant.kinematic["strut_length"] - instant.constants["rest_length"])
    ),
    constants=(term.Constant("rest_length", "m", "length of a strut at which there is no force"),),
)
"""Cables, hoses and bellows: a force linear in the strut's length, with one rest length for all.

If the rest lengths are unknown, the term `force_offset` absorbs their error: the stiffness is then
independent of the rest length.
"""


def _cogging(instant: term.Instant, order: int) -> term.Columns:
    """Return the columns of sines, then cosines, of a harmonic of the pitch."""
    angle = 2 * ca.pi * order * instant.kinematic["strut_length"] / instant.constants["pitch"]
    return term.Columns(along=ca.horzcat(ca.diag(ca.sin(angle)), ca.diag(ca.cos(angle))))


def _amplitudes(letter: str, order: str) -> tuple[term.Parameter, ...]:
    """Return the amplitudes of sines, then cosines, with names that begin with a letter."""
    return tuple(
        parameter
        for kind, word in (("s", "sine"), ("c", "cosine"))
        for parameter in term.per_actuator(
            term.Parameter(
                letter + kind,
                "N",
                f"{word} of the actuators' cogging, {order} harmonic",
                term.WEIGHT_SCALE,
                default=0.0,
            )
        )
    )


COGGING = term.Term(
    name="cogging",
    place=130,
    meaning="forces of the actuators with the period of a pitch, such as that of their magnets",
    parameters=_amplitudes("c", "first"),
    columns=lambda instant: _cogging(instant, 1),
    constants=(
        term.Constant("pitch", "m", "stroke of an actuator in which they repeat", positive=True),
    ),
)
"""Cogging of linear motors, and errors of screws and bearings with the period of their turns.

The force is a Fourier series of the position (Röhrig and Jochheim, Identification and compensation
of force ripple in linear permanent magnet motors, American Control Conference 2001). This is the
first harmonic of the pitch τ,

    cs sin(2π q/τ) + cc cos(2π q/τ) = amplitude · sin(2π q/τ + phase),

with amplitude² = cs² + cc² and phase = atan2(cc, cs), as in the twin's `experiment.cogging`.
"""
SECOND_COGGING = term.Term(
    name="cogging_second",
    place=140,
    meaning="second harmonic of the cogging, with half its period",
    parameters=_amplitudes("d", "second"),
    columns=lambda instant: _cogging(instant, 2),
    constants_of=COGGING.name,
)
TERMS = (DRIVE_INERTIA, BACK_EMF, OFFSET, CABLE, COGGING, SECOND_COGGING)
