"""Loads of the platform: a payload, the compensation of its weight, and hoses and cables."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from expdesign.mechanism.hexapod import COORDINATE_NAMES, COORDINATES
from expdesign.mechanism.term import (
    PLATFORM_RATE,
    Columns,
    Constant,
    Instant,
    Parameter,
    Scale,
    Term,
)


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
    # The actuators carry the platform's load less this wrench.
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


def _components(
    names: Sequence[str],
    force: str,
    moment: str,
    meaning: str,
    power: int = 0,
    lower: float = -np.inf,
) -> tuple[Parameter, ...]:
    """Return the parameters of three forces and three moments, per length to a power."""
    scales = {
        force: Scale(f"p10 g{' / L' * power}", mass=1, gravity=1, length=-power),
        moment: Scale("p10 g L", mass=1, gravity=1, length=1),
    }
    units = (force,) * 3 + (moment,) * 3
    return tuple(
        Parameter(name, unit, meaning, scales[unit], default=0.0, lower=lower)
        for name, unit in zip(names, units, strict=True)
    )


WRENCH = Term(
    name="platform_wrench",
    place=170,
    meaning="constant force and moment on the platform, in directions of the base",
    parameters=_components(
        [f"{letter}_{axis}" for letter in "fm" for axis in "xyz"],
        "N",
        "N m",
        "constant force on the platform, or moment about the TCP, along a base axis",
    ),
    # The actuators carry the platform's load less this wrench.
    columns=lambda _: Columns(wrench=-ca.SX.eye(COORDINATES)),
)
"""The mean pull of hoses, cables and weights on ropes."""


def _spring(instant: Instant) -> Columns:
    rotation = instant.kinematic["rotation_matrix"]
    rest = ca.vertcat(*(instant.constants[axis] for axis in "xyz"))
    moments = []
    for axis in range(3):
        # Of the energy tr(K (1 − R)), whose slope to a turn is the axial vector of R K − K Rᵀ.
        turned = rotation @ ca.diag([-0.5 if k == axis else 0.5 for k in range(3)])
        moments.append(ca.inv_skew(turned - turned.T))
    forces = ca.diag(instant.kinematic["position"] - rest)
    return Columns(wrench=ca.diagcat(forces, ca.horzcat(*moments)))


SPRING = Term(
    name="platform_spring",
    place=180,
    meaning="stiffness between base and platform, such as that of hoses",
    parameters=_components(
        [f"k_{name}" for name in COORDINATE_NAMES],
        "N/m",
        "N m",
        "stiffness of the platform along or about a base axis",
        power=1,
        lower=0.0,
    ),
    columns=_spring,
    constants=tuple(
        Constant(axis, "m", f"{axis} of the TCP without such a force, base frame", default=0.0)
        for axis in "xyz"
    ),
)
"""A spring between base and platform, without a moment at the orientation of the base.

Its energy is ½ Σ k_i (x_i − x_i0)² for the position and Σ κ_i (1 − cos φ) for a turn by φ about one
of the axes. Together with `platform_wrench` any rest position gives the same stiffness.
"""
DRAG = Term(
    name="platform_drag",
    place=190,
    meaning="constant force and moment against the platform's motion, such as of dragged hoses",
    parameters=_components(
        [f"d_{name}" for name in COORDINATE_NAMES],
        "N",
        "N m",
        "force or moment against the platform's velocity along or about a base axis",
        lower=0.0,
    ),
    columns=lambda instant: Columns(wrench=ca.diag(instant.signs[PLATFORM_RATE])),
    rates=(PLATFORM_RATE,),
)
"""The hysteresis of hoses and cable carriers: d sign of the velocity, component by component."""
TERMS = (PAYLOAD, COMPENSATION, WRENCH, SPRING, DRAG)
