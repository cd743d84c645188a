"""The platform with the sliders' masses lumped at its joints: wrench linear in its parameters.

Two blocks of the same name, between which the robot file's `platform` chooses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca
import numpy as np

from constraints.arrays import Array
from expdesign.mechanism import term
from expdesign.mechanism.bodies import pseudo_inertia

MASS = "p10"
"""Parameter in the scales of others."""

_PRODUCTS = {"Ixy": (0, 1), "Ixz": (0, 2), "Iyz": (1, 2)}


def _symmetric(instant: term.Instant) -> term.Columns:
    return term.Columns(ca.horzcat(*_always(instant)))


def _general(instant: term.Instant) -> term.Columns:
    lateral = [_first_moment(instant, axis) for axis in (0, 1)]
    products = [_inertia(instant, row, column) for row, column in _PRODUCTS.values()]
    return term.Columns(ca.horzcat(*_always(instant), *lateral, *products))


def _always(instant: term.Instant) -> list[ca.SX]:
    weight = ca.vertcat(instant.acceleration - instant.gravity, ca.SX.zeros(3, 1))
    moments = [_inertia(instant, axis, axis) for axis in range(3)]
    return [*moments, _first_moment(instant, 2), weight]


def _inertia(instant: term.Instant, row: int, column: int) -> ca.SX:
    """Return the wrench of one entry of I about the TCP, platform frame."""
    rotation = instant.kinematic["rotation_matrix"]
    omega = rotation.T @ instant.angular_velocity
    matrix = ca.DM.zeros(3, 3)
    matrix[row, column] = matrix[column, row] = 1
    momentum_rate = matrix @ (rotation.T @ instant.angular_acceleration)
    momentum_rate += ca.cross(omega, matrix @ omega)
    return ca.vertcat(ca.SX.zeros(3, 1), rotation @ momentum_rate)


def _first_moment(instant: term.Instant, axis: int) -> ca.SX:
    """Return the wrench of one component of the first moment s, platform frame."""
    arm = instant.kinematic["rotation_matrix"][:, axis]
    omega = instant.angular_velocity
    force = ca.cross(instant.angular_acceleration, arm) + ca.cross(omega, ca.cross(omega, arm))
    return ca.vertcat(force, ca.cross(arm, instant.acceleration - instant.gravity))


def platform_pseudo_inertia(p: Mapping[str, float]) -> Array:
    """Return the pseudo-inertia, (4, 4), of the platform with the sliders' masses."""
    inertia = np.diag([p["p6"], p["p7"], p["p8"]])
    for name, (i, j) in _PRODUCTS.items():
        inertia[i, j] = inertia[j, i] = p.get(name, 0.0)
    moment = np.array([p.get("sx", 0.0), p.get("sy", 0.0), p["p9"]])
    return pseudo_inertia(p[MASS], moment, inertia)


def _impossible(p: Mapping[str, float]) -> list[str]:
    """Judge mass, first moments and inertia together."""
    if any(p[parameter.name] <= parameter.lower for parameter in SYMMETRIC.parameters):
        return []
    whole = platform_pseudo_inertia(p)
    with np.errstate(all="ignore"):
        about_centre = whole[:3, :3] - np.outer(whole[3, :3], whole[3, :3]) / p[MASS]
    if not np.all(np.isfinite(about_centre)):
        return ["the platform's parameters are too large to be judged"]
    if np.linalg.eigvalsh(about_centre)[0] < 0:
        return ["no body has the platform's mass, first moments and moments of inertia (p6…p10)"]
    return []


def _lump(parameters: tuple[term.Parameter, ...]) -> term.Lump:
    names = tuple(parameter.name for parameter in parameters)
    meaning = "the platform's mass, first moments and moments of inertia"
    return term.Lump(meaning, names, platform_pseudo_inertia)


def _moment_of_inertia(name: str, axis: str, first: str, second: str) -> term.Parameter:
    meaning = f"$I_{{{axis}{axis}E}} + m_3 \\sum (b_{first}^2 + b_{second}^2)$"
    words = f"inertia of the platform about {axis}, through the TCP, with the sliders"
    return term.Parameter(name, "kg m^2", meaning, term.INERTIA_SCALE, words, lower=0, strict=True)


_LATERAL = term.Parameter(
    "s",
    "kg m",
    "lateral first moments; general platform only",
    term.FIRST_MOMENT_SCALE,
    default=0.0,
)
_PRODUCT = term.Parameter(
    "I",
    "kg m^2",
    "products of inertia as matrix entries; general platform only",
    term.INERTIA_SCALE,
    default=0.0,
)
_FIVE = (
    _moment_of_inertia("p6", "x", "y", "z"),
    _moment_of_inertia("p7", "y", "x", "z"),
    _moment_of_inertia("p8", "z", "x", "y"),
    term.Parameter(
        "p9",
        "kg m",
        "$s_{zE} + m_3 \\sum b_z$",
        term.FIRST_MOMENT_SCALE,
        words="first moment of the platform: mass times its centre's height over the TCP, with "
        "the sliders",
    ),
    term.Parameter(
        MASS,
        "kg",
        "$m_E + 6\\,m_3$",
        words="mass of the platform and the six sliders",
        lower=0,
        strict=True,
    ),
)
_TEN = (
    *_FIVE,
    *(replace(_LATERAL, name=name) for name in ("sx", "sy")),
    *(replace(_PRODUCT, name=name) for name in _PRODUCTS),
)
SYMMETRIC = term.Term(
    name="rigid_platform",
    place=20,
    meaning="the platform as a rigid body, with the sliders' masses at its joints",
    parameters=_FIVE,
    columns=_symmetric,
    impossible=_impossible,
    lumps=(_lump(_FIVE),),
)
GENERAL = replace(SYMMETRIC, parameters=_TEN, columns=_general, lumps=(_lump(_TEN),))
TERM = GENERAL
LATERAL = tuple(one.name for one in GENERAL.parameters[len(SYMMETRIC.parameters) :])
"""Parameters that the general platform has and the symmetric one has not."""
OF_A_BODY = {
    "mass": MASS,
    "sx": "sx",
    "sy": "sy",
    "sz": "p9",
    "Ixx": "p6",
    "Iyy": "p7",
    "Izz": "p8",
    **{name: name for name in _PRODUCTS},
}
"""Parameters of the general platform by the property of a body on it: mass, first moments and
inertia about the TCP, in the axes of the platform frame; products as matrix entries."""
