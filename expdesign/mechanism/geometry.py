"""Geometry of a 6-UPS hexapod: the frames of its struts, and the input of the symbolic graph."""

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
    """Where the joints are, as symbols, one column per strut: one graph serves every robot.

    Struts that turn on a thread (`expdesign.mechanism.thread`) have two more.
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
