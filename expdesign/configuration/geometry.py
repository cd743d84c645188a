"""Geometry of a robot at its home pose: joint rings, default axes, and faults of the geometry."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations
from typing import Annotated, Any, Literal

import casadi as ca
import numpy as np
from pydantic import AfterValidator, BeforeValidator

from constraints.arrays import Array, Mask
from constraints.limits import attitude
from expdesign.configuration.errors import InputError, Problem, refusal
from expdesign.configuration.quantity import Angle, Length, Positive, quantity_text
from expdesign.configuration.schema import Section, ShortForm
from expdesign.mechanism.graph import hexapod_graph
from expdesign.mechanism.hexapod import ACTUATORS

# --- joints on a circle ---------------------------------------------------------------------------

PairedStruts = Literal["1-2", "2-3"]

_PAIRS = 3
_BETWEEN = 2 * math.pi / _PAIRS
_WIDEST = _BETWEEN / 2


def _check_half_angle(value: float) -> float:
    if not 0 <= value < _WIDEST:
        raise refusal(
            f"{quantity_text(value, 'rad')} is not a half-angle between two joints of a pair",
            "from 0 to below 60 deg; joints that are further apart form pairs with the next ones",
        )
    return value


HalfAngle = Annotated[Angle, AfterValidator(_check_half_angle)]


class JointRing(Section):
    """Six joints on a circle about the z axis, in three pairs at 120°.

    Joint 1 is clockwise of the direction `rotation` and joint 2 as far counterclockwise of it, seen
    from above; so are joints 3 and 4, 5 and 6 of the directions 120° and 240° further.
    """

    radius: Annotated[Length, Positive]
    """m."""
    half_angle: HalfAngle
    """Angle between a joint and the middle of its pair, seen from the centre, rad."""
    pairs: PairedStruts
    """Paired joints: 1 and 2, 3 and 4, 5 and 6; or 2 and 3, 4 and 5, 6 and 1."""
    rotation: Angle = 0.0
    """Direction in the middle of joints 1 and 2, from x towards y, rad."""
    z: Length = 0.0
    """Height of the circle, m."""

    @property
    def points(self) -> tuple[tuple[float, float, float], ...]:
        """Positions of the joints, (6, 3), m."""
        apart = self.half_angle if self.pairs == "1-2" else _WIDEST - self.half_angle
        angles = (
            self.rotation + (j // 2) * _BETWEEN + (apart if j % 2 else -apart)
            for j in range(ACTUATORS)
        )
        return tuple((self.radius * math.cos(a), self.radius * math.sin(a), self.z) for a in angles)


def _read_points(value: object) -> Any:
    return JointRing.model_validate(value).points if isinstance(value, Mapping) else value


OrRing = (BeforeValidator(_read_points), ShortForm(JointRing))
"""Accepts a `JointRing` for six points."""

# --- struts at a pose -----------------------------------------------------------------------------


@dataclass(frozen=True)
class StrutGeometry:
    """The struts at one pose, in the base frame."""

    rotation: Array
    """(3, 3), platform to base."""
    joints: Array
    """(6, 3), platform joints, m."""
    lengths: Array
    """(6,), m."""
    directions: Array
    """(6, 3), unit vectors from base to platform joint."""
    inverse_jacobian: Array
    """(6, 6), strut speeds over velocity and angular velocity of the platform, 1 and m."""

    def condition(self, characteristic_length: float) -> float:
        """Return the condition number of the inverse Jacobian, rotations divided by a length."""
        with np.errstate(all="ignore"):
            jacobian = self.inverse_jacobian / np.repeat([1.0, characteristic_length], 3)
        if not np.all(np.isfinite(jacobian)):
            return float("inf")
        values = np.linalg.svd(jacobian, compute_uv=False)
        return float(values[0] / values[-1]) if values[-1] > 0 else float("inf")


def geometry_at(pose: Array, base_joints: Array, platform_joints: Array) -> StrutGeometry:
    """Return the struts at a pose (6,), m and rad, for joints (6, 3), m.

    A strut without length has no finite direction.
    """
    rotation, joints, lengths, directions, inverse_jacobian = (
        np.array(value) for value in _struts()(pose, base_joints.T, platform_joints.T)
    )
    return StrutGeometry(rotation, joints, lengths[:, 0], directions, inverse_jacobian)


@cache
def _struts() -> ca.Function:
    graph = hexapod_graph()
    q = graph.kinematic
    joints = [graph.geometry.base_joints, graph.geometry.platform_joints]
    scaled = ca.substitute(q["inverse_jacobian"], graph.length_scale, 1)
    outputs = [q["rotation_matrix"], q["platform_joints"].T, q["strut_length"]]
    return ca.Function("struts", [graph.pose, *joints], [*outputs, q["strut_direction"].T, scaled])


# --- axes of the joints ---------------------------------------------------------------------------

Report = Callable[..., Problem]

_SAME_POINT = 1e-9
_ON_AXIS = 1e-9
_ALONG = 1e-6
_UNIT = 1e-14
_NOT_PARALLEL = "an axis that is not parallel to the strut"


def unit_vectors(vectors: Array) -> Array:
    """Normalise rows (n, 3), none of them zero; unit vectors stay the same to the last bit."""
    scaled = vectors / np.max(np.abs(vectors), axis=1, keepdims=True)
    normalised = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    off = np.abs(np.linalg.norm(vectors, axis=1, keepdims=True) - 1)
    return np.where(off > _UNIT, normalised, vectors)


def default_alpha_axes(base_joints: Array, problem: Report) -> Array:
    """Return the horizontal parts of the base joints' positions as unit vectors, (6, 3)."""
    horizontal = base_joints * [1.0, 1.0, 0.0]
    radii = np.hypot(horizontal[:, 0], horizontal[:, 1])
    on_axis = radii <= _ON_AXIS * max(1.0, float(np.max(np.abs(base_joints))))
    message = (
        "strut {}: the base joint is on the z axis, where the first cardan axis has no default"
    )
    allowed = f"alpha_axes: {ACTUATORS} directions"
    _refuse(_at_struts(on_axis, problem, "base_joints", message, allowed))
    return horizontal / radii[:, None]


def thread_axes(axes: Array, alpha_axes: Array, home: StrutGeometry, problem: Report) -> Array:
    """Return the first axes of the cardan joints at the platform, (6, 3), platform frame, unit.

    Of the two directions of an axis, the result has the one with which the second axes of a strut's
    two joints are less than 90° apart at home.
    """
    axes = unit_vectors(axes)
    upper = np.cross(axes @ home.rotation.T, home.directions)
    lower = np.cross(alpha_axes, home.directions)
    signs = np.where(np.sum(upper * lower, axis=1) < 0, -1.0, 1.0)
    along = np.linalg.norm(upper, axis=1) < _ALONG
    message = "strut {}: the axis is along the strut at home"
    _refuse(_at_struts(along, problem, "platform_cardan_axes", message, _NOT_PARALLEL))
    return axes * signs[:, None]


# --- faults ---------------------------------------------------------------------------------------

LARGEST_CONDITION = 1e6
"""Largest condition number of the inverse Jacobian at home, with scaled rotations."""


def refuse_unusable(
    geometry: StrutGeometry, alpha_axes: Array, length: float, problem: Report
) -> None:
    """Refuse faults of the home pose.

    They are struts without length, first cardan axes along a strut, a singular pose, and an
    attitude near the singularity of the pose's angles.
    """
    if not np.all(np.isfinite(geometry.lengths)):
        message = "the coordinates are too large for the computation"
        raise InputError(problem(("base_joints",), message))
    message = "strut {} has no length at home: base and platform joint are the same point"
    _refuse(_at_struts(geometry.lengths <= _SAME_POINT, problem, "base_joints", message))
    along = np.linalg.norm(np.cross(alpha_axes, geometry.directions), axis=1) < _ALONG
    message = "strut {}: the first cardan axis is along the strut at home"
    problems = _at_struts(along, problem, "alpha_axes", message, _NOT_PARALLEL)
    theta = math.asin(max(-1.0, min(float(geometry.rotation[0, 2]), 1.0)))
    if abs(theta) > attitude.LARGEST:
        message = (
            f"the angles of the pose are singular at home, or nearly so: theta is "
            f"{math.degrees(theta):.4g} deg. {attitude.LIMIT.remedy}"
        )
        most = f"{math.degrees(attitude.LARGEST):.4g} deg"
        problems.append(problem(("home",), message, f"theta within {most} of 0, or of 180 deg"))
    condition = geometry.condition(length)
    if condition > LARGEST_CONDITION:
        value = f"{condition:.3g}" if np.isfinite(condition) else "infinite"
        message = (
            "the robot is singular at home: the condition number of the inverse Jacobian is "
            f"{value} (rotations scaled by {length:g} m)"
        )
        allowed = f"a geometry and home pose with at most {LARGEST_CONDITION:g}"
        problems.append(problem(("home",), message, allowed))
    _refuse(problems)


def _refuse(problems: list[Problem]) -> None:
    if problems:
        raise InputError(problems)


def _at_struts(
    where: Mask, problem: Report, key: str, message: str, allowed: str | None = None
) -> list[Problem]:
    """Return a problem for each strut of the mask (6,), with its number in the message."""
    return [problem((key, int(j)), message.format(j + 1), allowed) for j in np.flatnonzero(where)]


_UPWARDS = 0.5
"""Smallest share of gravity along z for gravity that points up; a base on a wall has less."""


def gravity_warnings(gravity: Array, struts: Array) -> list[str]:
    """Return a warning about gravity along +z of the base frame.

    Gravity points along −z for a platform that hangs below its base, too. The struts, (6, 3), lead
    from base to platform joints at home, base frame, m.
    """
    if gravity[2] <= _UPWARDS * float(np.linalg.norm(gravity)):
        return []
    does = "hangs from" if float(np.mean(struts @ gravity)) > 0 else "stands on"
    return [
        f"gravity points along +z of the base frame ({gravity[2]:g} m/s²), where z is up: by it "
        f"the platform {does} its base. Right only where the frame is upside down"
    ]


# --- sizes and symmetry ---------------------------------------------------------------------------

VANISHING = 1e-4
"""Asymmetry of joints that are rounded to a hundredth of a millimetre, as a share."""


def shared_pairs(*joints: Array) -> tuple[tuple[int, int], ...]:
    """Return the pairs of struts i < j, from zero, with a common joint (within 1e-9 m).

    `joints` are the positions of the base joints and of the platform joints, (6, 3), m.
    """
    return tuple(
        (i, j)
        for i, j in combinations(range(ACTUATORS), 2)
        if any(np.linalg.norm(ends[i] - ends[j]) <= _SAME_POINT for ends in joints)
    )


def rms_radius(joints: Array) -> float:
    """Return the root mean square of the distances of joints (6, 3) from their origin, m."""
    return float(np.sqrt(np.mean(np.sum(joints**2, axis=1))))


def sizes(
    home: Sequence[float],
    base_joints: Sequence[Sequence[float]],
    platform_joints: Sequence[Sequence[float]],
) -> dict[str, float]:
    """Return the sizes of a robot's parts by the key of their tolerance, m.

    The size of joints is their rms distance from their middle, that of the struts the shortest
    length at home.
    """
    base, platform = np.array(base_joints), np.array(platform_joints)
    with np.errstate(all="ignore"):
        return {
            "base_joints": rms_radius(base - base.mean(axis=0)),
            "platform_joints": rms_radius(platform - platform.mean(axis=0)),
            "strut_length": float(np.min(geometry_at(np.array(home), base, platform).lengths)),
        }


def asymmetric_sums(platform_joints: Array) -> dict[str, str]:
    """Return the sums over the platform joints that vanish for a symmetric platform.

    Σ bx, Σ by [m] and Σ bx·by, Σ bx·bz, Σ by·bz [m²] are the sliders' share of lateral first
    moments and products of inertia, as text with unit. Sums below `VANISHING` of their terms are
    left out.
    """
    x, y, z = platform_joints.T
    terms = {"Σ bx": x, "Σ by": y, "Σ bx·by": x * y, "Σ bx·bz": x * z, "Σ by·bz": y * z}
    radius = rms_radius(platform_joints)
    return {
        name: f"{np.sum(values):.3g} {'m²' if '·' in name else 'm'}"
        for name, values in terms.items()
        if abs(np.sum(values)) > VANISHING * len(values) * radius ** (2 if "·" in name else 1)
    }
