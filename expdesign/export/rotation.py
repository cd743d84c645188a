"""The platform's rotation in the conventions of controllers.

Ours is that of `expdesign.mechanism.strut`: R = Rx(φ) Ry(θ) Rz(ψ), about moving axes.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
from scipy.spatial.transform import Rotation

from constraints.arrays import Array
from expdesign.mechanism.strut import (
    ANGLES,
    FIXED_AXES,
    angular_acceleration,
    angular_velocity,
    rotation_matrix,
)


def roll_pitch_yaw(angles: Array) -> Array:
    """Return A, B, C with Rz(C) Ry(B) Rx(A) = R for angles (N, 3), rad, without jumps of 360°."""
    return np.unwrap(Rotation.from_euler(ANGLES, angles).as_euler(FIXED_AXES), axis=0)


def from_roll_pitch_yaw(fixed: Array) -> Array:
    """Return φ, θ, ψ, (N, 3) rad, of rotations about fixed axes; without jumps of 360°."""
    return np.unwrap(Rotation.from_euler(FIXED_AXES, fixed).as_euler(ANGLES), axis=0)


@cache
def moving_angles() -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return roll, pitch and yaw, middles of φ, θ, ψ, and φ, θ, ψ within half a turn of them.

    All are columns of three, rad.
    """
    fixed, middle = ca.SX.sym("fixed", 3), ca.SX.sym("middle", 3)
    # Rz(C) Ry(B) Rx(A) is the transpose of Rx(−A) Ry(−B) Rz(−C).
    rotation = rotation_matrix(-fixed).T
    sine = ca.vertcat(-rotation[1, 2], rotation[0, 2], -rotation[0, 1])
    level = ca.hypot(rotation[0, 0], rotation[0, 1])
    cosine = ca.vertcat(rotation[2, 2], level, rotation[0, 0])
    c, s = ca.cos(middle), ca.sin(middle)
    return fixed, middle, middle + ca.atan2(sine * c - cosine * s, cosine * c + sine * s)


def quaternions(angles: Array) -> Array:
    """Return x, y, z, w, (N, 4), without jumps of sign, for angles (N, 3), rad."""
    converted = Rotation.from_euler(ANGLES, angles).as_quat()
    turns = np.where(np.sum(converted[1:] * converted[:-1], axis=1) < 0, -1.0, 1.0)
    converted[1:] *= np.cumprod(turns)[:, None]
    return converted


def from_quaternions(values: Array) -> Array:
    """Return φ, θ, ψ, (N, 3) rad, of quaternions x, y, z, w; without jumps of 360°."""
    return np.unwrap(Rotation.from_quat(values).as_euler(ANGLES), axis=0)


def angular_motion(angles: Array, rates: Array, accelerations: Array) -> tuple[Array, Array]:
    """Return ω and ω̇ in the base frame, (N, 3) each, of angles with their derivatives."""
    return _rows(_functions()[0], angles, rates, accelerations)


def angle_derivatives(angles: Array, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return the first and second derivatives of φ, θ, ψ from ω and ω̇, (N, 3) each."""
    return _rows(_functions()[1], angles, velocity, acceleration)


@cache
def _functions() -> tuple[ca.Function, ca.Function]:
    """Build the function of ω and ω̇ by the angles and its inverse; both are linear in the rates."""
    angles, first, second = (ca.SX.sym(name, 3) for name in ("angles", "first", "second"))
    velocity = angular_velocity(angles, first)
    acceleration = angular_acceleration(angles, first, second)
    matrix = ca.jacobian(velocity, first)
    rates = ca.solve(matrix, first)
    rest = angular_acceleration(angles, rates, ca.SX.zeros(3))
    given = [angles, first, second]
    return (
        ca.Function("angular_motion", given, [velocity, acceleration]),
        ca.Function("angle_derivatives", given, [rates, ca.solve(matrix, second - rest)]),
    )


def _rows(function: ca.Function, *parts: Array) -> tuple[Array, Array]:
    first, second = function(*(part.T for part in parts))
    return np.array(first).T, np.array(second).T
