"""A second computation of the actuator forces: Lagrange's equations by automatic differentiation.

Written from the energies of the model alone. Nothing of `expdesign` is used: neither its strut
coordinates, nor its rotations, nor its parameter names. Only numbers go in.
"""

from functools import cache

import casadi as ca
import numpy as np

STRUTS = 6
COLUMNS = (
    *(f"p{k}" for k in range(1, 11)),
    *("sx", "sy", "Ixy", "Ixz", "Iyz"),
    *("r_alpha", "r_beta"),
    *(f"r{j}" for j in range(1, 7)),
    *(f"v{j}" for j in range(1, 7)),
)


def _turn(axis, angle):
    c, s = ca.cos(angle), ca.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    matrix = ca.SX.eye(3)
    matrix[i, i], matrix[i, j], matrix[j, i], matrix[j, j] = c, -s, s, c
    return matrix


def rotation(pose):
    """R = Rx(φ) Ry(θ) Rz(ψ), one rotation after the other."""
    return _turn(0, pose[3]) @ _turn(1, pose[4]) @ _turn(2, pose[5])


@cache
def _lagrange():
    pose, rate, acceleration = ca.SX.sym("q", 6), ca.SX.sym("dq", 6), ca.SX.sym("ddq", 6)
    base, joints = ca.SX.sym("A", 3, STRUTS), ca.SX.sym("b", 3, STRUTS)
    frames, gravity = ca.SX.sym("C", 3, 3 * STRUTS), ca.SX.sym("g", 3)
    rigid = {name: ca.SX.sym(name) for name in COLUMNS[:15]}

    def change(expression):
        return ca.jtimes(expression, pose, rate)

    R = rotation(pose)
    dR = ca.reshape(change(ca.vec(R)), 3, 3)
    spin = dR @ R.T
    omega = ca.vertcat(spin[2, 1], spin[0, 2], spin[1, 0])
    first = ca.vertcat(rigid["sx"], rigid["sy"], rigid["p9"])
    inertia = ca.vertcat(
        ca.horzcat(rigid["p6"], rigid["Ixy"], rigid["Ixz"]),
        ca.horzcat(rigid["Ixy"], rigid["p7"], rigid["Iyz"]),
        ca.horzcat(rigid["Ixz"], rigid["Iyz"], rigid["p8"]),
    )
    v, own = rate[:3], R.T @ omega
    kinetic = (
        rigid["p10"] * ca.dot(v, v) / 2
        + ca.dot(v, ca.cross(omega, R @ first))
        + ca.dot(own, inertia @ own) / 2
    )
    potential = -ca.dot(gravity, rigid["p10"] * pose[:3] + R @ first)
    lengths, alphas, betas = [], [], []
    for j in range(STRUTS):
        d = pose[:3] + R @ joints[:, j] - base[:, j]
        length = ca.norm_2(d)
        u = d / length
        x, y, z = (frames[:, 3 * j + k] for k in range(3))
        alpha = ca.atan2(-ca.dot(u, y), ca.dot(u, z))
        beta = ca.asin(ca.dot(u, x))
        dalpha, dbeta, du = change(alpha), change(beta), change(u)
        kinetic += (
            rigid["p1"] * dalpha**2 / 2
            + rigid["p2"] * (ca.cos(beta) * dalpha) ** 2 / 2
            + rigid["p3"] * dbeta**2 / 2
            + rigid["p5"] * length * ca.dot(du, du)
        )
        potential -= (rigid["p4"] + rigid["p5"]) * ca.dot(gravity, u)
        lengths.append(length)
        alphas.append(alpha)
        betas.append(beta)
    momentum = ca.gradient(kinetic, rate)
    forces = (
        ca.jtimes(momentum, pose, rate)
        + ca.jtimes(momentum, rate, acceleration)
        - ca.gradient(kinetic, pose)
        + ca.gradient(potential, pose)
    )
    lengths, alphas, betas = (ca.vertcat(*column) for column in (lengths, alphas, betas))
    return ca.Function(
        "lagrange",
        [pose, rate, acceleration, base, joints, frames, gravity],
        [
            ca.jacobian(forces, ca.vertcat(*rigid.values())),
            *(ca.jacobian(column, pose) for column in (lengths, alphas, betas)),
            lengths,
            alphas,
            betas,
        ],
    )


def cardan_frames(base, joints, axes, home):
    """C of every strut: x = e_α, z = direction at home made perpendicular to x, y = z × x."""
    R = np.array(ca.evalf(rotation(ca.SX(ca.DM(home)))))
    frames = []
    for A, b, x in zip(base, joints, axes, strict=True):
        d = home[:3] + R @ b - A
        z = d - (d @ x) * x
        z = z / np.linalg.norm(z)
        frames.append(np.column_stack([x, np.cross(z, x), z]))
    return np.array(frames)


class Energies:
    """Forces of one hexapod from its energies.

    Parameters
    ----------
    base, joints, axes : (6, 3)
        Base joints, platform joints, unit first cardan axes.
    home : (6,)
    gravity : (3,)
    """

    def __init__(self, base, joints, axes, home, gravity):
        frames = cardan_frames(base, joints, axes, home)
        stacked = np.concatenate(list(frames), axis=1)
        self._geometry = [ca.DM(base.T), ca.DM(joints.T), ca.DM(stacked), ca.DM(gravity)]

    def at(self, pose, rate, acceleration):
        """Return the regressor (6, 29), ∂q/∂λ (6, 6), and (α̇, β̇) of all struts."""
        values = _lagrange()(*map(ca.DM, (pose, rate, acceleration)), *self._geometry)
        rigid, of_length, of_alpha, of_beta, *_ = (value.full() for value in values)
        dlength, dalpha, dbeta = of_length @ rate, of_alpha @ rate, of_beta @ rate
        passive = np.column_stack([of_alpha.T @ np.sign(dalpha), of_beta.T @ np.sign(dbeta)])
        carried = np.linalg.solve(of_length.T, np.column_stack([rigid, passive]))
        regressor = np.hstack([carried, np.diag(np.sign(dlength)), np.diag(dlength)])
        return regressor, of_length, (dalpha, dbeta)

    def motion(self, pose):
        """Return lengths, α and β at a pose."""
        zero = ca.DM.zeros(6)
        values = _lagrange()(ca.DM(pose), zero, zero, *self._geometry)
        return tuple(value.full().ravel() for value in values[-3:])
