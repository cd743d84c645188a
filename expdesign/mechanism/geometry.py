"""Geometry of a 6-UPS hexapod as numbers, and as the input vector of the symbolic graph."""

from __future__ import annotations

from dataclasses import dataclass, fields

import casadi as ca
import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.hexapod import ACTUATORS


@dataclass(frozen=True)
class Geometry:
    """Where the joints are. Lengths in m; strut by strut in rows."""

    base_joints: Array
    """(6, 3), cardan centres A, base frame."""
    platform_joints: Array
    """(6, 3), joints b, platform frame (origin at the TCP)."""
    cardan_frames: Array
    """(6, 3, 3), C of each strut, columns x (first cardan axis), y, z in the base frame."""
    platform_joint_axes: Array
    """(6, 3), unit reference axes of the platform joints, platform frame."""
    gravity: Array
    """(3,), g in the base frame, m/s²."""

    def vector(self) -> Array:
        """Return all entries as one vector, in the order that `GeometrySymbols` reads."""
        return np.concatenate([np.ravel(getattr(self, f.name)) for f in fields(self)])


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


@dataclass(frozen=True)
class GeometrySymbols:
    """The same geometry as symbols: one graph serves every robot."""

    vector: ca.SX
    base_joints: ca.SX
    """(3, 6): one column per strut."""
    platform_joints: ca.SX
    cardan_frames: tuple[ca.SX, ...]
    platform_joint_axes: ca.SX
    gravity: ca.SX


def geometry_symbols() -> GeometrySymbols:
    """Create the graph's geometry input, laid out as `Geometry.vector`."""
    base = ca.SX.sym("A", 3, ACTUATORS)
    joints = ca.SX.sym("b", 3, ACTUATORS)
    frames = tuple(ca.SX.sym(f"C{j + 1}", 3, 3) for j in range(ACTUATORS))
    axes = ca.SX.sym("c", 3, ACTUATORS)
    gravity = ca.SX.sym("g", 3)
    # CasADi stores by columns, NumPy by rows: the frames are transposed to match `vector`.
    vector = ca.vertcat(
        ca.vec(base), ca.vec(joints), *(ca.vec(c.T) for c in frames), ca.vec(axes), gravity
    )
    return GeometrySymbols(vector, base, joints, frames, axes, gravity)
