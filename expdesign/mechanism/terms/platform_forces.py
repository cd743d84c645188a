"""Loads of the platform: a payload, and the compensation of its weight."""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.term import Columns, Constant, Instant, Parameter, Scale, Term


def _payload(instant: Instant) -> Columns:
    constants, omega = instant.constants, instant.angular_velocity
    place = ca.vertcat(*(constants[axis] for axis in "xyz"))
    arm = instant.kinematic["rotation_matrix"] @ place
    acceleration = instant.acceleration + ca.cross(instant.angular_acceleration, arm)
    force = acceleration + ca.cross(omega, ca.cross(omega, arm)) - instant.gravity
    return Columns(wrench=ca.vertcat(force, ca.cross(arm, force)))


PAYLOAD = Term(
    name="payload",
    place=160,
    meaning="a mass at a known point of the platform",
    parameters=(
        Parameter(
            "m_payload",
            "kg",
            "mass at a known point of the platform",
            Scale("p10", mass=1),
            lower=0,
            default=0.0,
        ),
    ),
    columns=_payload,
    constants=tuple(
        Constant(axis, "m", f"{axis} of the mass, platform frame", default=0.0) for axis in "xyz"
    ),
)
"""Payload: a point mass at a known point of the platform, in addition to the platform.

A point mass m at c (platform frame) has the mass m, the first moment m c and the inertia
m (|c|² 1 − c cᵀ) about the TCP: its column is

    p10 + x sx + y sy + z p9 + (y² + z²) p6 + (x² + z²) p7 + (x² + y²) p8 − xy Ixy − xz Ixz − yz Iyz

of those of `rigid_platform`. With a general platform whose parameters are all estimated the data
know the sum alone; with a symmetric one, too, where x = y = 0.
"""

_POINTS = {"base": "base frame", "platform": "platform frame"}


def _compensation(instant: Instant) -> Columns:
    base, place = (
        ca.vertcat(*(instant.constants[f"{end}_{axis}"] for axis in "xyz")) for end in _POINTS
    )
    arm = instant.kinematic["rotation_matrix"] @ place
    line = instant.kinematic["position"] + arm - base
    distance = ca.sqrt(ca.dot(line, line))
    # What it bears the actuators need not.
    force = -line / distance
    force = ca.horzcat(force, force * (distance - instant.constants["length"]))
    moments = ca.horzcat(*(ca.cross(arm, force[:, k]) for k in range(force.shape[1])))
    return Columns(wrench=ca.vertcat(force, moments))


COMPENSATION = Term(
    name="gravity_compensation",
    place=150,
    meaning="spring, cylinder or counterweight between a point of the base and one of the platform",
    parameters=(
        Parameter(
            "b_force",
            "N",
            "force of the gravity compensation at its `length`, above zero where it pushes",
            Scale("p10 g", mass=1, gravity=1),
            default=0.0,
        ),
        Parameter(
            "b_stiffness",
            "N/m",
            "change of that force with its length",
            Scale("p10 g / L", mass=1, gravity=1, length=-1),
            default=0.0,
        ),
    ),
    columns=_compensation,
    constants=(
        *(
            Constant(
                f"{end}_{axis}",
                "m",
                f"{axis} of its point of the {end}, {frame}",
                default=None if end == "base" else 0.0,
            )
            for end, frame in _POINTS.items()
            for axis in "xyz"
        ),
        Constant("length", "m", "distance of the points at which the force is b_force"),
    ),
)
"""Gravity compensation: a gas spring, counterweight or spring that carries part of the weight.

It acts along the line from a fixed point of the base to a point of the platform, with the force

    b_force + b_stiffness · (d − d₀)

that pushes both apart, at their distance d. The cylinder of a motion platform that stands under its
middle, on a tank of compressed gas, has a force above zero that hardly depends on d, and a small
stiffness below zero; a counterweight that hangs on a rope over a pulley above the platform has a
force below zero; a spring between the points has a stiffness above zero. A force of constant
direction, such as that of the secondary mechanism of Baradat, Arakelian, Briot and Guegan (Journal
of Mechanical Design 130, 2008), is that of a point of the base far away: from 1 km its direction
changes by less than 1 mrad.

Left out is the inertia of what moves along, such as the counterweight's.
"""
TERMS = (PAYLOAD, COMPENSATION)
