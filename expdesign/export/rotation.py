"""The platform's rotation in the conventions of controllers.

Ours is R = Rx(φ) Ry(θ) Rz(ψ), rotations about moving axes.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from constraints.arrays import Array

_OURS, _FIXED_AXES = "XYZ", "xyz"
"""SciPy's letters: upper case for moving axes, lower case for fixed ones."""


def roll_pitch_yaw(angles: Array) -> Array:
    """Return A, B, C with Rz(C) Ry(B) Rx(A) = R for angles (N, 3), rad, without jumps of 360°."""
    converted = Rotation.from_euler(_OURS, angles).as_euler(_FIXED_AXES)
    return np.unwrap(converted, axis=0)


def from_roll_pitch_yaw(fixed: Array) -> Array:
    """Return φ, θ, ψ, (N, 3) rad, of rotations about fixed axes; without jumps of 360°."""
    converted = Rotation.from_euler(_FIXED_AXES, fixed).as_euler(_OURS)
    return np.unwrap(converted, axis=0)


def quaternions(angles: Array) -> Array:
    """Return x, y, z, w, (N, 4), without jumps of sign, for angles (N, 3), rad."""
    converted = Rotation.from_euler(_OURS, angles).as_quat()
    turns = np.where(np.sum(converted[1:] * converted[:-1], axis=1) < 0, -1.0, 1.0)
    converted[1:] *= np.cumprod(turns)[:, None]
    return converted


def from_quaternions(values: Array) -> Array:
    """Return φ, θ, ψ, (N, 3) rad, of quaternions x, y, z, w; without jumps of 360°."""
    return np.unwrap(Rotation.from_quat(values).as_euler(_OURS), axis=0)


def angular_motion(angles: Array, rates: Array, accelerations: Array) -> tuple[Array, Array]:
    """Return ω and ω̇ in the base frame, (N, 3) each, of angles with their derivatives."""
    matrix = _rate_matrix(angles)
    return (
        _times(matrix, rates),
        _times(matrix, accelerations) + _convective(angles, rates),
    )


def angle_derivatives(angles: Array, velocity: Array, acceleration: Array) -> tuple[Array, Array]:
    """Return the first and second derivatives of φ, θ, ψ from ω and ω̇, (N, 3) each."""
    matrix = _rate_matrix(angles)
    rates = _solved(matrix, velocity)
    return rates, _solved(matrix, acceleration - _convective(angles, rates))


def _solved(matrices: Array, vectors: Array) -> Array:
    return np.asarray(np.linalg.solve(matrices, vectors[:, :, None])[:, :, 0], dtype=np.float64)


def _times(matrices: Array, vectors: Array) -> Array:
    return np.einsum("nij,nj->ni", matrices, vectors)


def _rate_matrix(angles: Array) -> Array:
    """Return E of ω = E (φ̇, θ̇, ψ̇); its columns are e_x, Rx e_y and Rx Ry e_z."""
    (sphi, sthe, _), (cphi, cthe, _) = np.sin(angles).T, np.cos(angles).T
    zero, one = np.zeros_like(sphi), np.ones_like(sphi)
    rows = [[one, zero, sthe], [zero, cphi, -sphi * cthe], [zero, sphi, cphi * cthe]]
    return np.moveaxis(np.array(rows), 2, 0)


def _convective(angles: Array, rates: Array) -> Array:
    """Return Ė (φ̇, θ̇, ψ̇)."""
    (sphi, sthe, _), (cphi, cthe, _) = np.sin(angles).T, np.cos(angles).T
    dphi, dthe, dpsi = rates.T
    return np.stack(
        [
            cthe * dthe * dpsi,
            -sphi * dphi * dthe + (sphi * sthe * dthe - cphi * cthe * dphi) * dpsi,
            cphi * dphi * dthe + (-cphi * sthe * dthe - sphi * cthe * dphi) * dpsi,
        ],
        axis=1,
    )
