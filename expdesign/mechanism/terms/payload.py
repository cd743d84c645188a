"""Payload: a point mass at a known point of the platform, in addition to the platform.

A point mass m at c (platform frame) has the mass m, the first moment m c and the inertia
m (|c|² 1 − c cᵀ) about the TCP: its column is

    p10 + x sx + y sy + z p9 + (y² + z²) p6 + (x² + z²) p7 + (x² + y²) p8 − xy Ixy − xz Ixz − yz Iyz

of those of `rigid_platform`. With a general platform whose parameters are all estimated the data
know the sum alone; with a symmetric one, too, where x = y = 0.
"""

from __future__ import annotations

import casadi as ca

from expdesign.mechanism.term import Columns, Constant, Instant, Parameter, Scale, Term


def _columns(instant: Instant) -> Columns:
    constants, omega = instant.constants, instant.angular_velocity
    place = ca.vertcat(*(constants[axis] for axis in "xyz"))
    arm = instant.kinematic["rotation_matrix"] @ place
    acceleration = instant.acceleration + ca.cross(instant.angular_acceleration, arm)
    force = acceleration + ca.cross(omega, ca.cross(omega, arm)) - instant.gravity
    return Columns(wrench=ca.vertcat(force, ca.cross(arm, force)))


TERM = Term(
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
    columns=_columns,
    constants=tuple(
        Constant(axis, "m", f"{axis} of the mass, platform frame", default=0.0) for axis in "xyz"
    ),
)
