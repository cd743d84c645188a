"""Terms of the dynamics: blocks of the regressor A with the properties of their parameters.

A module of `expdesign.mechanism.terms` declares a term, with names, units, scales, bounds and
columns of its parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import casadi as ca
import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.hexapod import ACTUATORS, actuator_names
from expdesign.mechanism.strut import StrutKinematics

_STEEP = 60.0
"""Argument from which the smooth sign is 1 to the last digit, in half widths."""


class Friction(Enum):
    """Source of the signs of dry friction."""

    EXACT = "exact"
    """sign(rate), sign(0) = 0: simulation, recheck, every reported number."""
    SMOOTH = "smooth"
    """tanh(rate / width), differentiable for an optimiser; the width is an input."""
    HELD = "held"
    """The signs are an input: fixed while something else is differentiated."""


def smooth_sign(rates: ca.SX) -> ca.SX:
    """Return tanh of rates in multiples of their widths, with an error of 1e-15 at most.

    Made of exp: the C library's tanh takes four times as long, most of the time of all limits.
    """
    return 1 - 2 / (ca.exp(ca.fmin(2 * rates, _STEEP)) + 1)


@dataclass(frozen=True)
class Scale:
    """Scale of a parameter without a nominal value: share · p10ᵃ · Lᵇ · |g|ᶜ.

    L is the robot's characteristic length; mass, length and gravity are the powers a, b and c.
    """

    text: str
    mass: float = 0
    length: float = 0
    gravity: float = 0
    share: float = 1.0

    def of(self, mass: float, length: float, gravity: float) -> float:
        """Return the scale, SI; 1 instead of zero."""
        scale = self.share
        for size, power in (mass, self.mass), (length, self.length), (gravity, self.gravity):
            if size == 0 and power != 0:
                return 1.0
            scale *= size**power
        return scale


ONE = Scale("1")
FIRST_MOMENT_SCALE = Scale("p10 L", mass=1, length=1)
INERTIA_SCALE = Scale("p10 L²", mass=1, length=2)
WEIGHT_SCALE = Scale("p10 g / 6", mass=1, gravity=1, share=1 / ACTUATORS)
"""The share of the platform's weight that one actuator bears."""
DAMPING_SCALE = Scale("p10 √g / (6 √L)", mass=1, length=-0.5, gravity=0.5, share=1 / ACTUATORS)
"""The same at the speed √(g L)."""


@dataclass(frozen=True)
class Parameter:
    """One parameter, and with it one column of A."""

    name: str
    """As in files; no two terms of the catalogue share one."""
    unit: str
    """SI, as in files: ``kg m^2``."""
    meaning: str
    """The same text for parameters that differ in their number only."""
    scale: Scale = ONE
    words: str = ""
    """The meaning without a formula; empty: `meaning` has none."""
    lower: float = -np.inf
    """Smallest possible value, SI."""
    strict: bool = False
    """True if `lower` itself is impossible."""
    upper: float = np.inf
    """Largest possible value, SI."""
    default: float | None = None
    """Nominal value for a robot file without one; None: the file must give it."""

    @property
    def in_words(self) -> str:
        """The meaning without a formula."""
        return self.words or self.meaning


def per_actuator(parameter: Parameter) -> tuple[Parameter, ...]:
    """Return the parameter once for each actuator, numbered: ``r1`` … ``r6``."""
    return tuple(replace(parameter, name=name) for name in actuator_names(parameter.name))


@dataclass(frozen=True)
class Constant:
    """A number with a nonlinear effect on A, such as a pitch: an input of the graph."""

    name: str
    unit: str
    meaning: str
    default: float | None = None
    """Value for a robot file without one, SI; None: the file must give it."""
    positive: bool = False
    """True if only values above zero are valid."""


@dataclass(frozen=True)
class SlidingRate:
    """Six rates with signs of dry friction, by the name of the kinematic quantity."""

    quantity: str
    arm: str | None = None
    """Arm from an angular rate to a speed; None for a rate that is a speed."""


STRUT_SPEED = SlidingRate("strut_speed")
ALPHA_RATE = SlidingRate("alpha_rate", arm="strut_length")
BETA_RATE = SlidingRate("beta_rate", arm="strut_length")
PLATFORM_RATE = SlidingRate("platform_rate")


@dataclass(frozen=True)
class Instant:
    """Inputs of a term's columns: expressions in the base frame, SI units, rad."""

    kinematic: Mapping[str, ca.SX]
    """Named quantities of `HexapodGraph.quantities`, but the forces."""
    struts: tuple[StrutKinematics, ...]
    arms: ca.SX
    """(3, 6), from the TCP to the platform joints."""
    acceleration: ca.SX
    """(3, 1), of the TCP."""
    angular_velocity: ca.SX
    angular_acceleration: ca.SX
    gravity: ca.SX
    """(3, 1), g."""
    signs: Mapping[SlidingRate, ca.SX]
    """(6, 1) of each rate that the term names."""
    constants: Mapping[str, ca.SX]
    """The term's own, by name."""
    load: ca.SX
    """(6, 1), force of the actuators at the parameters of `HexapodGraph.nominal` by the terms
    listed before this one, without those that take signs."""


@dataclass(frozen=True)
class Columns:
    """A term's part of A, (6, k), in parts that are added; one that is None is zero."""

    wrench: ca.SX | None = None
    """Force and moment about the TCP, base frame: the graph carries them to the actuators."""
    torques: ca.SX | None = None
    """(12, k) about the cardan axes α and β of each strut; the graph makes a wrench of them."""
    along: ca.SX | None = None
    """Forces of the actuators themselves."""
    between: ca.SX | None = None
    """Forces along the struts, between their joints: those of the actuators, but on a thread."""


@dataclass(frozen=True)
class Lump:
    """A matrix that is positive semidefinite for bodies of positive density, and only then."""

    meaning: str
    """Owner of the parameters in words: ``the platform``."""
    parameters: tuple[str, ...]
    """Arguments of the matrix, from this term or others."""
    matrix: Callable[[Mapping[str, float]], Array]
    """Values by name → (n, n), symmetric and linear in them."""


def _nothing_more(_: Mapping[str, float]) -> list[str]:
    return []


@dataclass(frozen=True, eq=False)
class Term:
    """A block of the regressor; the same only as itself, as functions are."""

    name: str
    """Its key in the robot file's `terms`."""
    meaning: str
    parameters: tuple[Parameter, ...]
    """In the order of the columns."""
    columns: Callable[[Instant], Columns]
    """The columns for one of each parameter, in its unit."""
    rates: tuple[SlidingRate, ...] = ()
    """Rates with signs in the columns. A term with any is friction."""
    viscous: bool = False
    """True for friction without a sign in its columns."""
    constants: tuple[Constant, ...] = ()
    constants_of: str = ""
    """Name of another term whose constants its columns take; it must be listed before."""
    turning: bool = False
    """True if the halves of the struts turn against each other on a thread and move the coordinates
    of the actuators."""
    impossible: Callable[[Mapping[str, float]], list[str]] = _nothing_more
    """Nominal values by name → their physical inconsistencies in words, without single bounds."""
    lumps: tuple[Lump, ...] = ()
    """Matrices that test the physical consistency of estimates with their covariance."""
    place: int = 1000
    """Sorting key in the catalogue and in its tables."""

    @property
    def is_friction(self) -> bool:
        """True for a term that takes energy, and is no load of the actuators."""
        return self.viscous or bool(self.rates)

    def __hash__(self) -> int:
        """Hash the name: terms are the keys of kernels, and that is asked for in every call."""
        return hash(self.name)


def kinematic_terms(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """Return those of the terms that the motion of the struts depends on."""
    return tuple(term for term in terms if term.turning)


def parameters_of(terms: tuple[Term, ...]) -> tuple[Parameter, ...]:
    """Return the parameters of all terms, in the order of the regressor's columns."""
    return tuple(parameter for term in terms for parameter in term.parameters)


def scales_of(
    parameters: Sequence[Parameter], values: Array, mass: float, length: float, gravity: float
) -> Array:
    """Return the scale of every parameter, (m,), SI: the size of its nominal value.

    A nominal value of zero, up to rounding, has the scale of its term by mass, length and gravity
    of the robot, or 1 if that is zero.
    """
    physical = np.array([each.scale.of(abs(mass), length, gravity) for each in parameters])
    return np.where(np.abs(values) <= _ROUNDING * physical, physical, np.abs(values))


_ROUNDING = 1e-12
"""Largest rounding error of a parameter, relative to its scale."""
