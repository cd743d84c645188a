"""Rotation of the platform: R = Rx(φ) Ry(θ) Rz(ψ), rotations about moving axes."""

from __future__ import annotations

import casadi as ca

ANGLES = "XYZ"
"""SciPy's letters for φ, θ, ψ: upper case for moving axes."""
FIXED_AXES = "xyz"
"""SciPy's letters for roll, pitch and yaw, as LinuxCNC, SDF and ROS take them."""


def rotation_matrix(angles: ca.SX) -> ca.SX:
    """Return R of φ, θ, ψ, rad, that takes platform-frame vectors into the base frame."""
    sphi, cphi = ca.sin(angles[0]), ca.cos(angles[0])
    sthe, cthe = ca.sin(angles[1]), ca.cos(angles[1])
    spsi, cpsi = ca.sin(angles[2]), ca.cos(angles[2])
    return ca.vertcat(
        ca.horzcat(cthe * cpsi, -cthe * spsi, sthe),
        ca.horzcat(
            cphi * spsi + sphi * sthe * cpsi, cphi * cpsi - sphi * sthe * spsi, -sphi * cthe
        ),
        ca.horzcat(sphi * spsi - cphi * sthe * cpsi, sphi * cpsi + cphi * sthe * spsi, cphi * cthe),
    )


def angular_velocity(angles: ca.SX, rates: ca.SX) -> ca.SX:
    """Return ω in the base frame, rad/s: ω = E(φ, θ) (φ̇, θ̇, ψ̇)."""
    return _euler_rate_matrix(angles) @ rates


def angular_acceleration(angles: ca.SX, rates: ca.SX, accelerations: ca.SX) -> ca.SX:
    """Return ω̇ in the base frame, rad/s²: E q̈ + Ė q̇."""
    phi, the = angles[0], angles[1]
    dphi, dthe, dpsi = rates[0], rates[1], rates[2]
    sphi, cphi = ca.sin(phi), ca.cos(phi)
    sthe, cthe = ca.sin(the), ca.cos(the)
    convective = ca.vertcat(
        cthe * dthe * dpsi,
        -sphi * dphi * dthe + (sphi * sthe * dthe - cphi * cthe * dphi) * dpsi,
        cphi * dphi * dthe + (-cphi * sthe * dthe - sphi * cthe * dphi) * dpsi,
    )
    return _euler_rate_matrix(angles) @ accelerations + convective


def _euler_rate_matrix(angles: ca.SX) -> ca.SX:
    # Columns: e_x, Rx e_y, Rx Ry e_z. Singular at θ = ±90°, far outside any hexapod's tilt.
    sphi, cphi = ca.sin(angles[0]), ca.cos(angles[0])
    sthe, cthe = ca.sin(angles[1]), ca.cos(angles[1])
    return ca.vertcat(
        ca.horzcat(1, 0, sthe),
        ca.horzcat(0, cphi, -sphi * cthe),
        ca.horzcat(0, sphi, cphi * cthe),
    )
