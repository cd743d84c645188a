"""What a term is: one block of the regressor A, with everything that is known of its parameters.

A term is declared by one file of `expdesign.mechanism.terms`. Names, units, scales, bounds and
columns of the parameters come from there, and from nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.strut import StrutKinematics


@dataclass(frozen=True)
class Scale:
    """What counts as one for a parameter without a nominal value: share · p10ᵃ · Lᵇ · |g|ᶜ.

    L is the robot's characteristic length, the attributes are the powers a, b and c.
    """

    mass: int = 0
    length: int = 0
    gravity: int = 0
    share: float = 1.0
    text: str = "1"

    def of(self, mass: float, length: float, gravity: float) -> float:
        """Return the scale in the parameter's unit; 1 where the machine's is zero."""
        size = self.share * mass**self.mass * length**self.length * gravity**self.gravity
        return size or 1.0


ONE = Scale()
FIRST_MOMENT_SCALE = Scale(mass=1, length=1, text="p10 L")
INERTIA_SCALE = Scale(mass=1, length=2, text="p10 L²")
WEIGHT_SCALE = Scale(mass=1, gravity=1, share=1 / ACTUATORS, text="p10 g / 6")
"""The share of the platform's weight that one actuator bears."""


@dataclass(frozen=True)
class Parameter:
    """One parameter, and with it one column of A.

    Attributes
    ----------
    name : str
        As in files; no two terms of the catalogue share one.
    unit : str
        SI, as in files: ``kg m^2``.
    meaning : str
        The same text for parameters that differ in their number only.
    scale : Scale
        What counts as one where the nominal value is zero.
    lower : float
        Below it no machine can be, SI.
    strict : bool
        Whether `lower` itself is impossible too.
    default : float or None
        Nominal value where the robot file gives none; None: the file must give it.
    """

    name: str
    unit: str
    meaning: str
    scale: Scale = ONE
    lower: float = -np.inf
    strict: bool = False
    default: float | None = None


def per_actuator(
    prefix: str,
    unit: str,
    meaning: str,
    *,
    scale: Scale = ONE,
    lower: float = -np.inf,
    default: float | None = None,
) -> tuple[Parameter, ...]:
    """Return one parameter for each actuator: ``r1`` … ``r6``."""
    return tuple(
        Parameter(f"{prefix}{j + 1}", unit, meaning, scale, lower, default=default)
        for j in range(ACTUATORS)
    )


@dataclass(frozen=True)
class Constant:
    """A number of a term in which A is not linear, such as a pitch: an input of the graph.

    Attributes
    ----------
    name, unit, meaning : str
    value : float or None
        Where the robot file gives none, SI; None: the file must give it.
    """

    name: str
    unit: str
    meaning: str
    value: float | None = None


@dataclass(frozen=True)
class SlidingRate:
    """Six rates whose signs dry friction takes.

    Attributes
    ----------
    quantity : str
        Name of the kinematic quantity (`HexapodGraph.kinematic`), (6, 1).
    arm : str or None
        Quantity that makes an angular rate a speed, m; None for what is a speed already.
    """

    quantity: str
    arm: str | None = None


STRUT_SPEED = SlidingRate("strut_speed")
ALPHA_RATE = SlidingRate("alpha_rate", arm="strut_length")
BETA_RATE = SlidingRate("beta_rate", arm="strut_length")


@dataclass(frozen=True)
class Instant:
    """What the columns of a term may depend on: symbols and expressions, SI units and radians.

    Attributes
    ----------
    kinematic : mapping
        Named quantities of `HexapodGraph.quantities`, but the forces.
    struts : tuple of StrutKinematics
        One for each strut.
    arms : (3, 6)
        From the TCP to the platform joints, base frame, m.
    acceleration : (3, 1)
        Of the TCP, base frame, m/s².
    angular_velocity, angular_acceleration : (3, 1)
        ω, ω̇ in the base frame.
    gravity : (3, 1)
        g in the base frame, m/s².
    signs : mapping
        Signs (6, 1) of the rates that the term names.
    constants : mapping
        The term's constants by name.
    load : (6, 1)
        Force of the actuators at the nominal parameters by the terms listed before this one,
        without those that take signs, N.
    """

    kinematic: Mapping[str, ca.SX]
    struts: tuple[StrutKinematics, ...]
    arms: ca.SX
    acceleration: ca.SX
    angular_velocity: ca.SX
    angular_acceleration: ca.SX
    gravity: ca.SX
    signs: Mapping[SlidingRate, ca.SX]
    constants: Mapping[str, ca.SX]
    load: ca.SX


@dataclass(frozen=True)
class Columns:
    """A term's part of A in two parts that are added; one that is None is zero.

    Attributes
    ----------
    wrench : (6, k) or None
        Force and moment about the TCP, base frame: the graph carries them to the actuators.
    along : (6, k) or None
        Forces of the actuators themselves, N.
    """

    wrench: ca.SX | None = None
    along: ca.SX | None = None


def _nothing_more(_: Mapping[str, float]) -> list[str]:
    return []


@dataclass(frozen=True)
class Term:
    """A block of the regressor.

    Attributes
    ----------
    name : str
        Its key in the robot file's `terms`, and the name of its file.
    meaning : str
    parameters : tuple of Parameter
        k of them, in the order of the columns.
    columns : callable
        `Instant` → `Columns` with k columns, per unit of each parameter.
    rates : tuple of SlidingRate
        Those whose signs the columns contain.
    constants : tuple of Constant
    impossible : callable
        Nominal values by name → what no real bodies have beyond each one's lower bound, in words.
    """

    name: str
    meaning: str
    parameters: tuple[Parameter, ...]
    columns: Callable[[Instant], Columns]
    rates: tuple[SlidingRate, ...] = ()
    constants: tuple[Constant, ...] = ()
    impossible: Callable[[Mapping[str, float]], list[str]] = _nothing_more


def parameters_of(terms: tuple[Term, ...]) -> tuple[Parameter, ...]:
    """Return the parameters of all terms, in the order of the regressor's columns."""
    return tuple(parameter for term in terms for parameter in term.parameters)
