"""Rotations of other programs as the angles φ, θ, ψ of the pose: R = Rx(φ) Ry(θ) Rz(ψ)."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array


def fixed_axes_rotation(angles: Array) -> Array:
    """Return Rz(c) Ry(b) Rx(a), (3, 3), of roll a, pitch b and yaw c, rad: turns about fixed axes.

    SDF, URDF and LinuxCNC state orientations so.
    """
    return turn(2, angles[2]) @ turn(1, angles[1]) @ turn(0, angles[0])


def rotation_of(angles: Array) -> Array:
    """Return Rx(φ) Ry(θ) Rz(ψ), (3, 3), of the angles of a pose, rad."""
    return turn(0, angles[0]) @ turn(1, angles[1]) @ turn(2, angles[2])


def turn(axis: int, angle: float) -> Array:
    """Return the rotation by an angle, rad, about x, y or z (0, 1, 2), (3, 3)."""
    matrix = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i] = np.sin(angle)
    matrix[i, j] = -matrix[j, i]
    return matrix


def angles_of(rotation: Array) -> tuple[float, float, float]:
    """Return φ, θ, ψ, rad, of a rotation (3, 3) with |θ| < 90°."""
    theta = np.arctan2(rotation[0, 2], np.hypot(rotation[0, 0], rotation[0, 1]))
    phi = np.arctan2(-rotation[1, 2], rotation[2, 2])
    psi = np.arctan2(-rotation[0, 1], rotation[0, 0])
    return float(phi) + 0.0, float(theta) + 0.0, float(psi) + 0.0
