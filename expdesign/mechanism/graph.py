"""The symbolic graph of a 6-UPS hexapod: built once, evaluated by everything else.

Inputs are the state (pose, rate, acceleration), the geometry, the parameters and the signs of
dry friction. Design, recheck, simulation and estimation take their functions from here; only the
friction signs differ between them (`Friction`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cache
from types import MappingProxyType

import casadi as ca

from expdesign.mechanism.geometry import GeometrySymbols, geometry_symbols
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.platform import GENERAL, SYMMETRIC, platform_wrench_regressor
from expdesign.mechanism.rotation import angular_acceleration, angular_velocity, rotation_matrix
from expdesign.mechanism.strut import (
    StrutKinematics,
    generalized_force_regressor,
    strut_kinematics,
)

STRUT_PARAMETERS = ("p1", "p2", "p3", "p4", "p5")
PASSIVE_FRICTION = ("r_alpha", "r_beta")


class Friction(Enum):
    """Where the signs of dry friction come from."""

    EXACT = "exact"
    """sign(rate), sign(0) = 0: simulation, recheck, every reported number."""
    SMOOTH = "smooth"
    """tanh(rate / width), the width being an input: what an optimiser can differentiate."""
    HELD = "held"
    """An input of 3 × 6 signs: fixed while something else is differentiated."""


def parameter_names(*, general: bool) -> tuple[str, ...]:
    """Return the names of the regressor's columns: 24, or 29 for a general platform."""
    actuators = range(1, ACTUATORS + 1)
    return (
        *STRUT_PARAMETERS,
        *(GENERAL if general else SYMMETRIC),
        *PASSIVE_FRICTION,
        *(f"r{j}" for j in actuators),
        *(f"v{j}" for j in actuators),
    )


def parameter_unit(name: str) -> str:
    """Return the SI unit of a parameter by its name."""
    if name in {"p4", "p5", "p9", "sx", "sy"}:
        return "kg m"
    if name == "p10":
        return "kg"
    if name.startswith(("p", "I")):
        return "kg m^2"
    if name in PASSIVE_FRICTION:
        return "N m"
    return "N" if name.startswith("r") else "N s/m"


@dataclass(frozen=True)
class HexapodGraph:
    """Symbols and expressions of one instant. SI units and radians.

    Attributes
    ----------
    pose, rate, acceleration : (6, 1)
        λ, λ̇, λ̈.
    geometry : GeometrySymbols
    signs : (18, 1)
        Friction signs of l̇ (6), α̇ (6) and β̇ (6).
    sliding : (18, 1)
        The rates l̇, α̇, β̇ whose signs they are.
    parameters : (m, 1)
    length_scale : scalar
        Characteristic length that makes rotations comparable with translations, m.
    regressor : (6, m)
        A with `signs` in place of the sign functions.
    kinematic : mapping
        Quantities that depend on no parameter, by name (see `quantities`).
    """

    pose: ca.SX
    rate: ca.SX
    acceleration: ca.SX
    geometry: GeometrySymbols
    signs: ca.SX
    sliding: ca.SX
    width: ca.SX
    parameters: ca.SX
    length_scale: ca.SX
    regressor: ca.SX
    kinematic: Mapping[str, ca.SX]

    @property
    def state(self) -> ca.SX:
        """(18, 1): pose, rate and acceleration."""
        return ca.vertcat(self.pose, self.rate, self.acceleration)

    def friction_signs(self, friction: Friction) -> ca.SX:
        """Return the 18 signs as expressions of the state, or as the symbols themselves."""
        if friction is Friction.EXACT:
            return ca.sign(self.sliding)
        if friction is Friction.SMOOTH:
            # One width in m/s for the actuators; a passive joint slides by the angle that a
            # strut of the present length turns, so that its width is the same at the strut's end.
            length = self.kinematic["strut_length"]
            arm = ca.vertcat(ca.SX.ones(ACTUATORS), length, length)
            return ca.tanh(self.sliding * arm / self.width)
        return self.signs

    def regressor_with(self, friction: Friction) -> ca.SX:
        """Return A (6, m) with the friction signs of the kind asked for."""
        if friction is Friction.HELD:
            return self.regressor
        signs = self.friction_signs(friction)
        return ca.cse(ca.substitute(self.regressor, self.signs, signs))

    def quantities(self, friction: Friction) -> Mapping[str, ca.SX]:
        """Return all named quantities that limits may bound.

        ``position`` (3), ``rotation_angles`` (3), ``rotation_matrix`` (3, 3), ``strut_length``,
        ``strut_speed``, ``strut_acceleration``, ``alpha``, ``beta``, ``sin_beta``,
        ``alpha_rate``, ``beta_rate`` (6 each), ``strut_direction`` (3, 6), ``base_joints``,
        ``platform_joints`` (3, 6, base frame), ``platform_joint_axes`` (3, 6, base frame),
        ``inverse_jacobian`` (6, 6, rotations divided by the characteristic length) and
        ``actuator_force`` (6).
        """
        force = self.regressor_with(friction) @ self.parameters
        return MappingProxyType({**self.kinematic, "actuator_force": force})

    def inputs(self, friction: Friction) -> list[ca.SX]:
        """Return state, geometry, parameters, characteristic length and the friction's input."""
        extra = {
            Friction.EXACT: ca.SX(0, 1),
            Friction.SMOOTH: self.width,
            Friction.HELD: self.signs,
        }[friction]
        return [self.state, self.geometry.vector, self.parameters, self.length_scale, extra]


@cache
def hexapod_graph(*, general: bool) -> HexapodGraph:
    """Build the graph for a symmetric (24) or general (29 parameters) platform; cached."""
    pose, rate, acceleration = (ca.SX.sym(name, 6) for name in ("pose", "rate", "acceleration"))
    geometry = geometry_symbols()
    length_scale = ca.SX.sym("characteristic_length")
    signs = ca.SX.sym("sign", 3 * ACTUATORS)
    rotation = rotation_matrix(pose[3:])
    omega = angular_velocity(pose[3:], rate[3:])
    domega = angular_acceleration(pose[3:], rate[3:], acceleration[3:])
    arms = rotation @ geometry.platform_joints
    struts = []
    for j in range(ACTUATORS):
        arm = arms[:, j]
        turning = ca.cross(omega, arm)
        struts.append(
            strut_kinematics(
                geometry.base_joints[:, j],
                geometry.cardan_frames[j],
                pose[:3] + arm,
                rate[:3] + turning,
                acceleration[:3] + ca.cross(domega, arm) + ca.cross(omega, turning),
            )
        )
    kinematic = {
        "position": pose[:3],
        "rotation_angles": pose[3:],
        "rotation_matrix": rotation,
        "strut_length": _column(struts, "length"),
        "strut_speed": _column(struts, "length_rate"),
        "strut_acceleration": _column(struts, "length_acceleration"),
        "alpha": _column(struts, "alpha"),
        "beta": _column(struts, "beta"),
        "sin_beta": _column(struts, "sin_beta"),
        "alpha_rate": _column(struts, "alpha_rate"),
        "beta_rate": _column(struts, "beta_rate"),
        "strut_direction": ca.horzcat(*(strut.direction for strut in struts)),
        "base_joints": geometry.base_joints,
        "platform_joints": ca.repmat(pose[:3], 1, ACTUATORS) + arms,
        "platform_joint_axes": rotation @ geometry.platform_joint_axes,
    }
    # Columns of Gᵀ: the wrench of a unit force along each strut (l̇ = G V).
    transposed = ca.horzcat(
        *(
            ca.vertcat(strut.direction, ca.cross(arms[:, j], strut.direction))
            for j, strut in enumerate(struts)
        )
    )
    scale = ca.vertcat(ca.SX.ones(3), ca.repmat(1 / length_scale, 3, 1))
    kinematic["inverse_jacobian"] = (ca.diag(scale) @ transposed).T
    platform = platform_wrench_regressor(
        rotation, acceleration[:3], omega, domega, geometry.gravity, general=general
    )
    regressor = _close(struts, arms, transposed, platform, signs, geometry.gravity)
    names = parameter_names(general=general)
    return HexapodGraph(
        pose=pose,
        rate=rate,
        acceleration=acceleration,
        geometry=geometry,
        signs=signs,
        sliding=ca.vertcat(
            kinematic["strut_speed"], kinematic["alpha_rate"], kinematic["beta_rate"]
        ),
        width=ca.SX.sym("width"),
        parameters=ca.SX.sym("p", len(names)),
        length_scale=length_scale,
        regressor=ca.cse(regressor),
        kinematic=MappingProxyType(kinematic),
    )


def _column(struts: list[StrutKinematics], name: str) -> ca.SX:
    return ca.vertcat(*(getattr(strut, name) for strut in struts))


def _close(
    struts: list[StrutKinematics],
    arms: ca.SX,
    transposed: ca.SX,
    platform: ca.SX,
    signs: ca.SX,
    gravity: ca.SX,
) -> ca.SX:
    """Carry every wrench to the actuators, Q = G⁻ᵀ W, and add the friction along the struts."""
    inertial: ca.SX = ca.SX.zeros(6, len(STRUT_PARAMETERS))
    passive: ca.SX = ca.SX.zeros(6, len(PASSIVE_FRICTION))
    along = []
    for j, strut in enumerate(struts):
        torque = generalized_force_regressor(strut, gravity)
        along.append(torque[2, :])
        # A torque about a cardan axis is a transverse force at B.
        per_alpha = strut.along_alpha / (strut.length * strut.cos_beta)
        per_beta = strut.along_beta / strut.length
        inertial += _wrench(arms[:, j], per_alpha @ torque[0, :] + per_beta @ torque[1, :])
        sign_alpha, sign_beta = signs[ACTUATORS + j], signs[2 * ACTUATORS + j]
        passive += _wrench(arms[:, j], ca.horzcat(per_alpha * sign_alpha, per_beta * sign_beta))
    # ca.inv on SX is a QR factorisation: as accurate as the Jacobian's condition allows.
    carried = ca.inv(transposed) @ ca.horzcat(inertial, platform, passive)
    carried[:, : len(STRUT_PARAMETERS)] += ca.vertcat(*along)
    sliding = ca.diag(_column(struts, "length_rate"))
    return ca.densify(ca.horzcat(carried, ca.diag(signs[:ACTUATORS]), sliding))


def _wrench(arm: ca.SX, forces: ca.SX) -> ca.SX:
    moments = ca.horzcat(*(ca.cross(arm, forces[:, k]) for k in range(forces.shape[1])))
    return ca.vertcat(forces, moments)
