"""Geometry at the home pose: directions that have defaults, and what makes a robot unusable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.problem import Problem

LARGEST_CONDITION = 1e6
"""Of the inverse Jacobian at home, rotations scaled by the characteristic length."""

_SAME_POINT = 1e-9
_ON_AXIS = 1e-9
_ALONG = 1e-6
_UNIT = 1e-14
_VANISHING = 1e-6

Report = Callable[..., Problem]


class _Joints(Protocol):
    @property
    def base_joints(self) -> Array: ...
    @property
    def platform_joints(self) -> Array: ...


@dataclass(frozen=True)
class HomeGeometry:
    """The struts at the home pose.

    Attributes
    ----------
    rotation : (3, 3)
        Platform to base, Rx(φ) Ry(θ) Rz(ψ).
    arms : (6, 3)
        From the TCP to the platform joints, base frame, m.
    lengths : (6,)
        m.
    directions : (6, 3)
        From base to platform joint, unit vectors in the base frame.
    """

    rotation: Array
    arms: Array
    lengths: Array
    directions: Array


def home_geometry(home: Array, base_joints: Array, platform_joints: Array) -> HomeGeometry:
    """Return the struts at the home pose; a strut without length has no finite direction."""
    with np.errstate(all="ignore"):
        rotation = rotation_matrix(*home[3:])
        arms = platform_joints @ rotation.T
        struts = home[:3] + arms - base_joints
        lengths = np.linalg.norm(struts, axis=1)
        directions = struts / lengths[:, None]
    return HomeGeometry(rotation, arms, lengths, directions)


def rotation_matrix(phi: float, theta: float, psi: float) -> Array:
    """Return Rx(φ) Ry(θ) Rz(ψ), rotations about moving axes, (3, 3)."""
    cx, sx = np.cos(phi), np.sin(phi)
    cy, sy = np.cos(theta), np.sin(theta)
    cz, sz = np.cos(psi), np.sin(psi)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_x @ about_y @ about_z, dtype=np.float64)


def condition_at_home(geometry: HomeGeometry, characteristic_length: float) -> float:
    """Return the condition number of the inverse Jacobian with rows [uᵀ, (R b × u)ᵀ / L]."""
    with np.errstate(all="ignore"):
        moments = np.cross(geometry.arms, geometry.directions) / characteristic_length
        jacobian = np.hstack([geometry.directions, moments])
    if not np.all(np.isfinite(jacobian)):
        return float("inf")
    values = np.linalg.svd(jacobian, compute_uv=False)
    return float(values[0] / values[-1]) if values[-1] > 0 else float("inf")


def unit_vectors(
    vectors: Array, name: str, problem: Report, what: str
) -> tuple[Array, list[Problem]]:
    """Normalise rows (n, 3); unit vectors stay as they are to the last bit.

    `problem` makes the record for the position of a row that is zero.
    """
    scale = np.max(np.abs(vectors), axis=1)
    problems = [
        problem((name, int(j)), f"strut {j + 1}: the {what} is zero", "a direction [x, y, z]")
        for j in np.flatnonzero(scale == 0)
    ]
    if problems:
        return vectors, problems
    norms = scale * np.linalg.norm(vectors / scale[:, None], axis=1)
    normalised = vectors / scale[:, None]
    normalised = normalised / np.linalg.norm(normalised, axis=1)[:, None]
    return np.where(np.abs(norms - 1)[:, None] > _UNIT, normalised, vectors), []


def default_alpha_axes(base_joints: Array, problem: Report) -> tuple[Array, list[Problem]]:
    """Return the horizontal parts of the base joints' positions as unit vectors, (6, 3)."""
    horizontal = base_joints * [1.0, 1.0, 0.0]
    radii = np.hypot(horizontal[:, 0], horizontal[:, 1])
    on_axis = radii <= _ON_AXIS * max(1.0, float(np.max(np.abs(base_joints))))
    problems = [
        problem(
            ("base_joints", int(j)),
            f"strut {j + 1}: the base joint is on the z axis, where the first cardan axis has no "
            "default",
            "alpha_axes: six directions",
        )
        for j in np.flatnonzero(on_axis)
    ]
    if problems:
        return horizontal, problems
    return horizontal / radii[:, None], []


def geometry_problems(
    geometry: HomeGeometry, alpha_axes: Array, condition: float, length: float, problem: Report
) -> list[Problem]:
    """Return what makes the home pose unusable.

    That is: struts without length, first cardan axes along a strut, and a singular pose.
    """
    if not np.all(np.isfinite(geometry.lengths)):
        return [problem(("base_joints",), "the coordinates are too large to be computed with")]
    short = geometry.lengths <= _SAME_POINT
    problems = [
        problem(
            ("base_joints", int(j)),
            f"strut {j + 1} has no length at home: base and platform joint are the same point",
        )
        for j in np.flatnonzero(short)
    ]
    if problems:
        return problems
    sines = np.linalg.norm(np.cross(alpha_axes, geometry.directions), axis=1)
    problems = [
        problem(
            ("alpha_axes", int(j)),
            f"strut {j + 1}: the first cardan axis is along the strut at home",
            "an axis that is not parallel to the strut",
        )
        for j in np.flatnonzero(sines < _ALONG)
    ]
    if condition > LARGEST_CONDITION:
        value = f"{condition:.3g}" if np.isfinite(condition) else "infinite"
        problems.append(
            problem(
                ("home",),
                "the robot is singular at home: the condition number of the inverse Jacobian is "
                f"{value} (rotations scaled by {length:g} m)",
                f"a geometry and home pose with at most {LARGEST_CONDITION:g}",
            )
        )
    return problems


def shared_joint_pairs(robot: _Joints) -> tuple[tuple[int, int], ...]:
    """Return the pairs of struts whose base or platform joints coincide within 1e-9 m.

    Parameters
    ----------
    robot : ResolvedRobot
        Or anything with `base_joints` and `platform_joints`, (6, 3), m.

    Returns
    -------
    tuple of (int, int)
        Positions from zero, i < j, in the order of ``itertools.combinations``.
    """
    return tuple(
        (i, j)
        for i, j in combinations(range(len(robot.base_joints)), 2)
        if any(
            np.linalg.norm(joints[i] - joints[j]) <= _SAME_POINT
            for joints in (robot.base_joints, robot.platform_joints)
        )
    )


def asymmetric_sums(platform_joints: Array) -> dict[str, float]:
    """Return the sums over the platform joints that a symmetric platform needs to be zero.

    Σ bx, Σ by [m] and Σ bx·by, Σ bx·bz, Σ by·bz [m²] are the sliders' share of lateral first
    moments and products of inertia; those below 1e-6 of their terms count as zero.
    """
    x, y, z = platform_joints.T
    terms = {"Σ bx": x, "Σ by": y, "Σ bx·by": x * y, "Σ bx·bz": x * z, "Σ by·bz": y * z}
    radius = float(np.sqrt(np.mean(np.sum(platform_joints**2, axis=1))))
    return {
        name: float(np.sum(values))
        for name, values in terms.items()
        if abs(np.sum(values)) > _VANISHING * len(values) * radius ** (2 if "·" in name else 1)
    }
