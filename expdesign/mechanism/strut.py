"""One strut between base cardan and platform joint: its motion in (α, β, l).

The end point B of a strut has the spherical coordinates (α, β, l) about its cardan centre A:
u = (sin β, −sin α cos β, cos α cos β) in the cardan base frame C. Every energy of ring, stator
and slider depends on these three alone, so Lagrange's equations are written in them and carried
to B with the two transverse unit vectors e₁ (growing α) and e₂ (growing β).
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.hexapod import ACTUATORS


def cardan_frames(base_joints: Array, alpha_axes: Array, home_joints: Array) -> Array:
    """Return C of each strut, (6, 3, 3), from its first axis and its direction at home.

    x is the first cardan axis, z the strut's direction at home made perpendicular to x, and
    y = z × x, so that α is zero at home.

    Parameters
    ----------
    base_joints, alpha_axes, home_joints : (6, 3)
        A, unit first cardan axes and platform joints B at home; base frame, m.
    """
    strut = home_joints - base_joints
    along = np.sum(strut * alpha_axes, axis=1, keepdims=True)
    z = strut - along * alpha_axes
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([alpha_axes, np.cross(z, alpha_axes), z], axis=2)


class GeometrySymbols:
    """Symbols of the joints' positions, one column per strut: one graph serves every robot.

    Struts that turn on a thread (`expdesign.mechanism.strut`) have two more.
    """

    def __init__(self, *, turning: bool = False) -> None:
        self.base_joints = ca.SX.sym("A", 3, ACTUATORS)
        self.platform_joints = ca.SX.sym("b", 3, ACTUATORS)
        self.cardan_frames = tuple(ca.SX.sym(f"C{j + 1}", 3, 3) for j in range(ACTUATORS))
        self.platform_joint_axes = ca.SX.sym("c", 3, ACTUATORS)
        self.gravity = ca.SX.sym("g", 3)
        # First axes of the cardan joints at the platform, platform frame; lead, m per turn, above
        # zero for a right-handed thread
        self.platform_cardan_axes = ca.SX.sym("n", 3, ACTUATORS if turning else 0)
        self.lead = ca.SX.sym("h", 1 if turning else 0)
        # CasADi stores by columns, NumPy by rows: the frames are transposed to match arrays with
        # one row, or one matrix, per strut.
        self.vector = ca.vertcat(
            ca.vec(self.base_joints),
            ca.vec(self.platform_joints),
            *(ca.vec(frame.T) for frame in self.cardan_frames),
            ca.vec(self.platform_joint_axes),
            self.gravity,
            ca.vec(self.platform_cardan_axes),
            self.lead,
        )


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
        # First cardan axis; the second one is across it and u
        self.alpha_axis = frame[:, 0]
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


class ThreadTurn:
    """Thread turn δ of one strut and its inputs; vectors (3, 1) in the base frame.

    Parameters
    ----------
    strut : StrutKinematics
    arm : (3, 1)
        From the TCP to the platform joint B, m.
    base_axis, platform_axis : (3, 1)
        First axes of the two cardan joints, unit vectors, fixed in base and platform.
    """

    def __init__(
        self, strut: StrutKinematics, arm: ca.SX, base_axis: ca.SX, platform_axis: ca.SX
    ) -> None:
        u = strut.direction
        lower, upper = ca.cross(base_axis, u), ca.cross(platform_axis, u)
        # rad
        self.angle = ca.atan2(ca.dot(upper, ca.cross(u, lower)), ca.dot(upper, lower))
        # A half that is held by an axis n spins about u by (n·u) n₂·u̇/s, with n₂ = n × u/s of unit
        # length, and by (ω·u − (n·u) ω·n)/s² where n turns with ω; u̇ = (1 − u uᵀ) v_B/l.
        transverse = _spin(upper, platform_axis, u) - _spin(lower, base_axis, u)
        turned = u - ca.dot(platform_axis, u) * platform_axis
        force = transverse / strut.length
        # (6, 1): δ̇ = wrenchᵀ V, and of a torque of one about u between the halves the wrench on
        # the platform
        self.wrench = ca.vertcat(force, ca.cross(arm, force) + turned / ca.dot(upper, upper))


def _spin(second: ca.SX, first: ca.SX, u: ca.SX) -> ca.SX:
    """Return w of the spin w·u̇ about u, of a half with a fixed first axis."""
    return ca.dot(first, u) * second / ca.dot(second, second)
