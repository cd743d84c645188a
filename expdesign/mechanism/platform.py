"""The platform with the sliders' masses lumped at its joints: wrench linear in its parameters."""

from __future__ import annotations

import casadi as ca

SYMMETRIC = ("p6", "p7", "p8", "p9", "p10")
"""I_xx, I_yy, I_zz, s_z and the mass: lateral moments and products of inertia vanish."""
GENERAL = (*SYMMETRIC, "sx", "sy", "Ixy", "Ixz", "Iyz")
"""The full ten parameters of a rigid body; products are matrix entries."""


def platform_wrench_regressor(
    rotation: ca.SX,
    acceleration: ca.SX,
    angular_velocity: ca.SX,
    angular_acceleration: ca.SX,
    gravity: ca.SX,
    *,
    general: bool,
) -> ca.SX:
    """Return the (6, 5) or (6, 10) regressor of force and moment about the TCP, base frame.

    Parameters
    ----------
    rotation : (3, 3)
        R, platform frame into base frame.
    acceleration : (3, 1)
        Acceleration of the TCP, m/s².
    angular_velocity, angular_acceleration : (3, 1)
        ω, ω̇ in the base frame.
    gravity : (3, 1)
        g in the base frame, m/s².
    general : bool
        False: parameters `SYMMETRIC`; True: `GENERAL`.
    """
    felt = acceleration - gravity
    omega = rotation.T @ angular_velocity
    domega = rotation.T @ angular_acceleration
    zero = ca.SX.zeros(3, 1)

    def inertia(matrix: ca.DM) -> ca.SX:
        momentum_rate = matrix @ domega + ca.cross(omega, matrix @ omega)
        return ca.vertcat(zero, rotation @ momentum_rate)

    def first_moment(axis: int) -> ca.SX:
        arm = rotation[:, axis]
        force = ca.cross(angular_acceleration, arm) + ca.cross(
            angular_velocity, ca.cross(angular_velocity, arm)
        )
        return ca.vertcat(force, ca.cross(arm, felt))

    def unit(row: int, column: int) -> ca.DM:
        matrix = ca.DM.zeros(3, 3)
        matrix[row, column] = matrix[column, row] = 1
        return matrix

    columns = [inertia(unit(0, 0)), inertia(unit(1, 1)), inertia(unit(2, 2))]
    columns += [first_moment(2), ca.vertcat(felt, zero)]
    if general:
        columns += [first_moment(0), first_moment(1)]
        columns += [inertia(unit(0, 1)), inertia(unit(0, 2)), inertia(unit(1, 2))]
    return ca.horzcat(*columns)
