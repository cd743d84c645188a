"""Friction of the actuators and of the joints at their ends."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from expdesign.mechanism.term import (
    ALPHA_RATE,
    BETA_RATE,
    DAMPING_SCALE,
    STRUT_SPEED,
    WEIGHT_SCALE,
    Columns,
    Constant,
    Instant,
    Parameter,
    Scale,
    Term,
    per_actuator,
)

_AXES = "dry friction about the cardan axes, the same in all struts"


def _passive(instant: Instant) -> Columns:
    alpha, beta = instant.signs[ALPHA_RATE], instant.signs[BETA_RATE]
    pairs = zip(ca.vertsplit(alpha), ca.vertsplit(beta), strict=True)
    return Columns(torques=ca.vertcat(*(ca.diag(ca.vertcat(*pair)) for pair in pairs)))


PASSIVE = Term(
    name="passive_friction",
    place=40,
    meaning="dry friction about the cardan axes",
    parameters=tuple(Parameter(name, "N m", _AXES, lower=0) for name in ("r_alpha", "r_beta")),
    columns=_passive,
    rates=(ALPHA_RATE, BETA_RATE),
)


def _viscous_joints(instant: Instant) -> Columns:
    """Return the columns of base and platform: torques by the relative angular velocities."""
    torques, moment = [], ca.SX.zeros(3)
    for strut in instant.struts:
        beta_axis = ca.cross(strut.direction, strut.along_beta)
        axes = ca.horzcat(strut.alpha_axis, beta_axis)
        rates = ca.vertcat(strut.alpha_rate, strut.beta_rate)
        relative = instant.angular_velocity - axes @ rates
        torques.append(ca.horzcat(rates, -axes.T @ relative))
        moment += relative
    wrench = ca.horzcat(ca.SX.zeros(6), ca.vertcat(ca.SX.zeros(3), moment))
    return Columns(wrench=wrench, torques=ca.vertcat(*torques))


VISCOUS_JOINTS = Term(
    name="passive_viscous_friction",
    place=45,
    meaning="viscous friction of the joints at base and platform",
    parameters=tuple(
        Parameter(
            f"v_{end}",
            "N m s",
            "viscous friction of one joint at the base or at the platform, the same in all",
            Scale("p10 √(g L³)", mass=1, length=1.5, gravity=0.5),
            lower=0,
            default=0.0,
        )
        for end in ("base", "platform")
    ),
    columns=_viscous_joints,
    viscous=True,
)
"""Grease and seals of the joints: torques in proportion to their relative angular velocity.

A cardan joint at the base turns by α̇ about its first and by β̇ about its second axis, a ball joint
at the platform by ω − ω_strut about all three; the struts do not spin about themselves.
"""


def _actuators(instant: Instant) -> Columns:
    dry = ca.diag(instant.signs[STRUT_SPEED])
    return Columns(along=ca.horzcat(dry, ca.diag(instant.kinematic["strut_speed"])))


ACTUATOR = Term(
    name="actuator_friction",
    place=50,
    meaning="dry and viscous friction of the actuators",
    parameters=(
        *per_actuator(Parameter("r", "N", "dry friction of the actuators", lower=0)),
        *per_actuator(Parameter("v", "N s/m", "viscous friction of the actuators", lower=0)),
    ),
    columns=_actuators,
    rates=(STRUT_SPEED,),
)


def _friction_of_actuators(
    name: str,
    place: int,
    meaning: str,
    parameter: Parameter,
    force: Callable[[Instant], ca.SX],
    constants: tuple[Constant, ...] = (),
) -> Term:
    """Return a friction term with one parameter per actuator, for the force (6, 1) of one each."""
    return Term(
        name=name,
        place=place,
        meaning=meaning,
        parameters=per_actuator(parameter),
        columns=lambda instant: Columns(along=ca.diag(force(instant))),
        # Also for a force without any sign: it marks the term as friction.
        rates=(STRUT_SPEED,),
        constants=constants,
    )


ASYMMETRIC = _friction_of_actuators(
    "asymmetric_friction",
    60,
    "viscous friction of the actuators that differs between extending and retracting",
    Parameter(
        "a",
        "N s/m",
        "half the difference of viscous friction between extending and retracting",
        DAMPING_SCALE,
        default=0.0,
    ),
    # |q̇| by the sign, which an optimiser sees smoothed.
    lambda instant: instant.signs[STRUT_SPEED] * instant.kinematic["strut_speed"],
)
"""Viscous friction that differs between extension and retraction.

Separate dry and viscous friction for each direction, r⁺ + v⁺ q̇ for q̇ > 0 and −r⁻ + v⁻ q̇ for
q̇ < 0, are

    r sign q̇ + v q̇  +  ½ (r⁺ − r⁻) |sign q̇|  +  ½ (v⁺ − v⁻) |q̇|

with the means r and v of `actuator_friction`. While the actuator moves, the third part is a
constant force, which cannot be separated from the zero of the force: `force_offset` has their sum
(so also Gautier, Janot, Vandanjon, IEEE Transactions on Control Systems Technology 21, 2013). This
term is the fourth part, a = ½ (v⁺ − v⁻). Friction that depends on the direction of the load is
that of `load_friction`.
"""
QUADRATIC = _friction_of_actuators(
    "quadratic_friction",
    70,
    "friction of the actuators with the square of their speed",
    Parameter(
        "w",
        "N s^2/m^2",
        "friction of the actuators per square of the speed",
        Scale("p10 / (6 L)", mass=1, length=-1, share=1 / 6),
        default=0.0,
    ),
    lambda instant: instant.signs[STRUT_SPEED] * instant.kinematic["strut_speed"] ** 2,
)
"""Displaced oil and air: F_v |q̇|^δ sign q̇ with δ = 2.

The nonlinear viscous friction of Olsson, Åström, Canudas de Wit, Gäfvert and Lischinsky (European
Journal of Control 4, 1998). With an integer δ, 3 in `cubic_friction`, the model stays linear in
its parameters, and both together make a polynomial of the speed.
"""
CUBIC = _friction_of_actuators(
    "cubic_friction",
    80,
    "friction of the actuators with the third power of their speed",
    Parameter(
        "c",
        "N s^3/m^3",
        "friction of the actuators per third power of the speed",
        Scale("p10 / (6 √(g L³))", mass=1, length=-1.5, gravity=-0.5, share=1 / 6),
        default=0.0,
    ),
    lambda instant: instant.kinematic["strut_speed"] ** 3,
)
"""Above zero: friction grows faster than the speed; below: a lubricant shears or warms up."""
STRIBECK = _friction_of_actuators(
    "stribeck",
    100,
    "friction of the actuators near standstill, beyond the dry one",
    Parameter(
        "s",
        "N",
        "friction of the actuators at standstill, beyond the dry one",
        WEIGHT_SCALE,
        default=0.0,
    ),
    lambda instant: (
        instant.signs[STRUT_SPEED]
        * ca.exp(-((instant.kinematic["strut_speed"] / instant.constants["velocity"]) ** 2))
    ),
    (Constant("velocity", "m/s", "speed at which it has fallen to 1/e", positive=True),),
)
"""The Gaussian form, s exp(−(v/v_s)²) sign(v), of Armstrong-Hélouvry, Dupont and Canudas de Wit
(Automatica 30, 1994)."""
LOAD = _friction_of_actuators(
    "load_friction",
    110,
    "friction of the actuators in proportion to their load",
    Parameter(
        "mu",
        "1",
        "friction of the actuators as a share of their load",
        Scale("0.1", share=0.1),
        lower=0,
        default=0.0,
    ),
    lambda instant: instant.signs[STRUT_SPEED] * ca.fabs(instant.load),
)
"""Friction of screws, belts and guides under load.

The load is the frictionless force of the terms listed before this one at the parameters of
`HexapodGraph.nominal`. The forces are not linear in all parameters together: an estimate repeats
the computation with the load of its result.
"""
SATURATION = _friction_of_actuators(
    "force_saturation",
    118,
    "excess of the actuators' forces with the third power of their load",
    Parameter(
        "sat",
        "1",
        "excess of the actuators' forces, as a share, at the load `force`",
        Scale("0.01", share=0.01),
        default=0.0,
    ),
    lambda instant: instant.load * (instant.load / instant.constants["force"]) ** 2,
    (Constant("force", "N", "load at which the excess is that share", positive=True),),
)
"""Motors that saturate: a force that is computed from the current is too large at large loads.

The load is that of `load_friction`.
"""


def _by_position(instant: Instant) -> Columns:
    offset = instant.kinematic["strut_length"] - instant.constants["length"]
    dry, viscous = instant.signs[STRUT_SPEED], instant.kinematic["strut_speed"]
    return Columns(along=ca.horzcat(ca.diag(offset * dry), ca.diag(offset * viscous)))


POSITION = Term(
    name="position_friction",
    place=115,
    meaning="change of the actuators' friction along their stroke",
    parameters=(
        *per_actuator(
            Parameter(
                "rl",
                "N/m",
                "change of the actuators' dry friction with their length",
                Scale("p10 g / (6 L)", mass=1, gravity=1, length=-1, share=1 / 6),
                default=0.0,
            )
        ),
        *per_actuator(
            Parameter(
                "vl",
                "N s/m^2",
                "change of the actuators' viscous friction with their length",
                Scale("p10 √g / (6 √(L³))", mass=1, length=-1.5, gravity=0.5, share=1 / 6),
                default=0.0,
            )
        ),
    ),
    columns=_by_position,
    rates=(STRUT_SPEED,),
    constants=(
        Constant("length", "m", "length of a strut at which r1 … v6 are its whole friction"),
    ),
)
"""Guides, seals and screws that run harder at one end of the stroke.

(l − l₀) (rl sign l̇ + vl l̇): another l₀ only changes the parameters of `actuator_friction`.
"""
TERMS = (
    PASSIVE,
    VISCOUS_JOINTS,
    ACTUATOR,
    ASYMMETRIC,
    QUADRATIC,
    CUBIC,
    STRIBECK,
    LOAD,
    POSITION,
    SATURATION,
)
