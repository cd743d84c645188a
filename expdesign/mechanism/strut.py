"""One strut between base cardan and platform joint: its motion in (α, β, l).

The end point B of a strut has the spherical coordinates (α, β, l) about its cardan centre A:
u = (sin β, −sin α cos β, cos α cos β) in the cardan base frame C. Every energy of ring, stator
and slider depends on these three alone, so Lagrange's equations are written in them and carried
to B with the two transverse unit vectors e₁ (growing α) and e₂ (growing β).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True)
class StrutKinematics:
    """Symbolic motion of one strut; vectors (3, 1) in the base frame, SI units and radians."""

    direction: ca.SX
    """u, from A to B."""
    along_alpha: ca.SX
    """e₁: direction in which B moves when α grows."""
    along_beta: ca.SX
    """e₂: direction in which B moves when β grows."""
    length: ca.SX
    length_rate: ca.SX
    length_acceleration: ca.SX
    sin_beta: ca.SX
    cos_beta: ca.SX
    alpha: ca.SX
    beta: ca.SX
    alpha_rate: ca.SX
    beta_rate: ca.SX
    alpha_acceleration: ca.SX
    beta_acceleration: ca.SX


def strut_kinematics(
    base: ca.SX, frame: ca.SX, point: ca.SX, velocity: ca.SX, acceleration: ca.SX
) -> StrutKinematics:
    """Express the motion of the platform joint B in the strut's coordinates.

    Parameters
    ----------
    base : (3, 1)
        Cardan centre A, base frame, m.
    frame : (3, 3)
        Cardan base frame C, columns x, y, z in the base frame.
    point, velocity, acceleration : (3, 1)
        B and its time derivatives, base frame.
    """
    offset = point - base
    length = ca.sqrt(ca.dot(offset, offset))
    direction = offset / length
    ux, uy, uz = (ca.dot(frame[:, k], direction) for k in range(3))
    sin_beta = ux
    cos_beta = ca.sqrt(uy * uy + uz * uz)
    sin_alpha, cos_alpha = -uy / cos_beta, uz / cos_beta
    along_alpha = -cos_alpha * frame[:, 1] - sin_alpha * frame[:, 2]
    along_beta = cos_beta * frame[:, 0] + sin_beta * (
        sin_alpha * frame[:, 1] - cos_alpha * frame[:, 2]
    )
    length_rate = ca.dot(direction, velocity)
    alpha_rate = ca.dot(along_alpha, velocity) / (length * cos_beta)
    beta_rate = ca.dot(along_beta, velocity) / length
    # Acceleration of a point in spherical coordinates, solved for (α̈, β̈, l̈).
    alpha_acceleration = (
        ca.dot(along_alpha, acceleration)
        - 2 * alpha_rate * (length_rate * cos_beta - length * beta_rate * sin_beta)
    ) / (length * cos_beta)
    beta_acceleration = (
        ca.dot(along_beta, acceleration) - 2 * length_rate * beta_rate
    ) / length - alpha_rate**2 * sin_beta * cos_beta
    length_acceleration = ca.dot(direction, acceleration) + length * (
        beta_rate**2 + (alpha_rate * cos_beta) ** 2
    )
    return StrutKinematics(
        direction=direction,
        along_alpha=along_alpha,
        along_beta=along_beta,
        length=length,
        length_rate=length_rate,
        length_acceleration=length_acceleration,
        sin_beta=sin_beta,
        cos_beta=cos_beta,
        alpha=ca.atan2(-uy, uz),
        beta=ca.asin(sin_beta),
        alpha_rate=alpha_rate,
        beta_rate=beta_rate,
        alpha_acceleration=alpha_acceleration,
        beta_acceleration=beta_acceleration,
    )


def torque_wrench(strut: StrutKinematics, arm: ca.SX, torques: ca.SX) -> ca.SX:
    """Return force and moment about the TCP, (6, k), of torques about the cardan axes.

    Parameters
    ----------
    strut : StrutKinematics
    arm : (3, 1)
        From the TCP to the platform joint B, base frame, m.
    torques : (2, k)
        About the axes of α and β, N·m.
    """
    # A torque about a cardan axis is a transverse force at B.
    per_alpha = strut.along_alpha / (strut.length * strut.cos_beta)
    per_beta = strut.along_beta / strut.length
    forces = ca.horzcat(per_alpha, per_beta) @ torques
    moments = ca.horzcat(*(ca.cross(arm, forces[:, k]) for k in range(forces.shape[1])))
    return ca.vertcat(forces, moments)
