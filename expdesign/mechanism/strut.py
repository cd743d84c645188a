"""One strut between base cardan and platform joint: its motion in (α, β, l).

The end point B of a strut has the spherical coordinates (α, β, l) about its cardan centre A:
u = (sin β, −sin α cos β, cos α cos β) in the cardan base frame C. Every energy of ring, stator
and slider depends on these three alone, so Lagrange's equations are written in them and carried
to B with the two transverse unit vectors e₁ (growing α) and e₂ (growing β).
"""

from __future__ import annotations

import casadi as ca


class StrutKinematics:
    """Symbolic motion of one strut; vectors (3, 1) in the base frame, SI units and radians.

    Parameters
    ----------
    base : (3, 1)
        Cardan centre A, base frame, m.
    frame : (3, 3)
        Cardan base frame C, columns x, y, z in the base frame.
    point, velocity, acceleration : (3, 1)
        Platform joint B and its time derivatives, base frame.
    """

    def __init__(
        self, base: ca.SX, frame: ca.SX, point: ca.SX, velocity: ca.SX, acceleration: ca.SX
    ) -> None:
        offset = point - base
        squared = ca.dot(offset, offset)
        self.length = length = ca.sqrt(squared)
        # A product with a reciprocal is a division to CasADi, which takes as long as many products:
        # with the root of a reciprocal it is not.
        per_length = ca.sqrt(1 / squared)
        # u, from A to B
        self.direction = direction = offset * per_length
        ux, uy, uz = (ca.dot(frame[:, k], direction) for k in range(3))
        self.sin_beta = sin_beta = ux
        self.cos_beta = cos_beta = ca.sqrt(uy * uy + uz * uz)
        per_cosine = ca.sqrt(1 / (uy * uy + uz * uz))
        self.alpha, self.beta = ca.atan2(-uy, uz), ca.asin(sin_beta)
        sin_alpha, cos_alpha = -uy * per_cosine, uz * per_cosine
        # e₁ and e₂: directions in which B moves when α and β grow
        self.along_alpha = along_alpha = -cos_alpha * frame[:, 1] - sin_alpha * frame[:, 2]
        self.along_beta = along_beta = cos_beta * frame[:, 0] + sin_beta * (
            sin_alpha * frame[:, 1] - cos_alpha * frame[:, 2]
        )
        self.length_rate = length_rate = ca.dot(direction, velocity)
        # What α and β grow by when B moves by one along e₁ and e₂
        self.alpha_per_way, self.beta_per_way = per_length * per_cosine, per_length
        self.alpha_rate = alpha_rate = ca.dot(along_alpha, velocity) * self.alpha_per_way
        self.beta_rate = beta_rate = ca.dot(along_beta, velocity) * self.beta_per_way
        # Acceleration of a point in spherical coordinates, solved for (α̈, β̈, l̈).
        self.alpha_acceleration = (
            ca.dot(along_alpha, acceleration)
            - 2 * alpha_rate * (length_rate * cos_beta - length * beta_rate * sin_beta)
        ) * self.alpha_per_way
        self.beta_acceleration = (
            ca.dot(along_beta, acceleration) - 2 * length_rate * beta_rate
        ) * self.beta_per_way - alpha_rate**2 * sin_beta * cos_beta
        self.length_acceleration = ca.dot(direction, acceleration) + length * (
            beta_rate**2 + (alpha_rate * cos_beta) ** 2
        )


def torque_wrench(strut: StrutKinematics, arm: ca.SX, torques: ca.SX) -> ca.SX:
    """Return force and moment about the TCP, (6, k), of torques (2, k) about the axes of α and β.

    The arm (3, 1) leads from the TCP to the platform joint B, base frame, m.
    """
    # A torque about a cardan axis is a transverse force at B.
    per_alpha = strut.along_alpha * strut.alpha_per_way
    per_beta = strut.along_beta * strut.beta_per_way
    forces = ca.horzcat(per_alpha, per_beta) @ torques
    moments = ca.horzcat(*(ca.cross(arm, forces[:, k]) for k in range(forces.shape[1])))
    return ca.vertcat(forces, moments)
