"""Physically consistent parameters, and their bodies.

Bodies of positive density are those whose pseudo-inertia is positive semidefinite (Wensing, Kim,
Slotine 2018). The parameters are linear in the pseudo-inertias of ring, stator, slider and
platform: the consistent ones are a convex cone. docs/consistency.md derives the matrices.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import scipy

from constraints.arrays import Array
from expdesign.mechanism.bodies import (
    MachineBodies,
    RigidBody,
    platform_parameters,
    point_masses,
    together,
)
from expdesign.mechanism.term import Lump, Parameter
from expdesign.mechanism.terms.rigid_platform import GENERAL, MASS, platform_pseudo_inertia
from expdesign.mechanism.terms.struts import along, breadth, thickness

HEAVIEST = 1e3
"""Largest mass of a stator, in multiples of p10. Its mass is in no parameter: without a bound the
nearest bodies would have infinite mass."""

SLIDER_MASS = "slider mass"
"""Mass of a slider, kg; no parameter equals it."""

ROUNDING = 1e-12
"""Tolerated inconsistency of parameters, as a share of the scales."""

_NOTHING = together(())
_PLATFORM = frozenset(parameter.name for parameter in GENERAL.parameters)
_STRUTS = ("p1", "p2", "p3", "p4", "p5")
_MOMENTS = ("p6", "p7", "p8")


@dataclass(frozen=True, eq=False)
class Realisable:
    """The physically consistent parameters of a machine, (m,), within their own bounds."""

    parameters: tuple[Parameter, ...]
    scales: Array
    """(m,), scales of the parameters, SI."""
    lower: Array
    upper: Array
    """(m,), bounds of the single parameters."""
    joints: Array
    """(6, 3), of the platform, platform frame, m."""

    @classmethod
    def of(cls, parameters: Sequence[Parameter], scales: Array, joints: Array) -> Realisable:
        """Return the set for these parameters, within the bounds of each."""
        lower, upper = np.transpose([(one.lower, one.upper) for one in parameters])
        return cls(tuple(parameters), scales, lower, upper, joints)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @cached_property
    def struts(self) -> bool:
        """True if the parameters of the struts are among them."""
        return set(_STRUTS) <= set(self.names)

    @cached_property
    def platform(self) -> bool:
        """True if those of the platform are."""
        return MASS in self.names

    @cached_property
    def sliders(self) -> Array:
        """(4, 4), pseudo-inertia of a mass of one at every platform joint."""
        return point_masses(self.joints) if self.struts else np.zeros((4, 4))

    @cached_property
    def sizes(self) -> dict[str, float]:
        """Scales of the inertias along the struts and of the platform, and of masses."""
        scale = dict(zip(self.names, self.scales.tolist(), strict=True))
        return {
            "strut": max((scale[name] for name in ("p2", "p3") if self.struts), default=1.0),
            "platform": sum(scale[name] for name in _MOMENTS) / 6 if self.platform else 1.0,
            "mass": scale.get(MASS, 1.0),
        }

    @cached_property
    def conditions(self) -> tuple[Lump, ...]:
        """The matrices that are positive semidefinite for some `SLIDER_MASS`, and only then.

        Linear in the parameters and that mass together.
        """
        found: list[Lump] = []
        own = tuple(name for name in self.names if name in _PLATFORM)
        if self.struts:
            found += [
                Lump("the struts' inertia about their axis", ("p2", "p3"), thickness),
                Lump("the struts' moments of inertia", ("p1", "p2", "p3"), breadth),
                Lump(
                    "the struts' first moments, inertia and the sliders' mass",
                    ("p2", "p3", "p4", "p5", MASS, SLIDER_MASS) if self.platform else ("p2", "p3"),
                    _along if self.platform else _depth,
                ),
            ]
        if self.platform:
            having = (*own, SLIDER_MASS) if self.struts else own
            meaning = "the platform's mass, first moments and moments of inertia"
            found.append(Lump(meaning, having, partial(_platform, sliders=self.sliders)))
        return tuple(found)

    def bodies(self, values: Array, rounding: float = ROUNDING) -> MachineBodies | None:
        """Return bodies with given parameters, (m,); None for physically inconsistent ones.

        The slider's mass, and the stator's share of the inertia along the struts, are in the middle
        of their ranges. Properties without a parameter, such as the ring's mass, are chosen.
        """
        with np.errstate(all="ignore"):
            parts = self._parts(values, rounding)
            if parts is None:
                return None
            strut, whole = parts
            if whole is None:
                return MachineBodies(*strut.bodies(4 * strut.least or 1.0), _NOTHING)
            mass = self._slider_mass(whole, strut.least)
            platform = RigidBody.of_pseudo_inertia(whole - mass * self.sliders)
            return MachineBodies(*strut.bodies(mass), platform)

    def consistent(self, values: Array, rounding: float = ROUNDING) -> bool:
        """Test whether there are bodies with given parameters, (m,)."""
        with np.errstate(all="ignore"):
            return self._parts(values, rounding) is not None

    def _parts(self, values: Array, rounding: float) -> tuple[_Strut, Array | None] | None:
        """Return strut and platform with sliders, (4, 4), or None for inconsistent parameters."""
        slack = rounding * self.scales
        if not np.all((values >= self.lower - slack) & (values <= self.upper + slack)):
            return None
        p = dict(zip(self.names, values.tolist(), strict=True))
        strut = _Strut.of(p, rounding * self.sizes["strut"]) if self.struts else _Strut()
        if strut is None:
            return None
        if not self.platform:
            return strut, None
        whole = platform_pseudo_inertia(p)
        rest = whole / self._unit - strut.least * (self.sliders / self._unit)
        if not np.all(np.isfinite(rest)) or np.linalg.eigvalsh(rest)[0] < -rounding:
            return None
        return strut, whole

    def _slider_mass(self, whole: Array, least: float) -> float:
        """Return a mass of a slider, kg, that leaves a platform of the pseudo-inertia `whole`."""
        try:
            own, whole = self.sliders / self._unit, whole / self._unit
            share = float(scipy.linalg.eigh(own, whole, eigvals_only=True)[-1])
        except np.linalg.LinAlgError:
            return least  # a platform at the limit of what a body is
        return (least + max(least, 1 / share)) / 2 if share > 0 else least

    @cached_property
    def _unit(self) -> Array:
        """(4, 4), scales of the platform's pseudo-inertia."""
        size = np.sqrt([self.sizes["platform"]] * 3 + [self.sizes["mass"]])
        return np.multiply.outer(size, size)

    def with_lightest_sliders(self, values: Array) -> Array | None:
        """Return the platform's scaled pseudo-inertia with the lightest sliders, (4, 4).

        None without a platform, or where the struts are none.
        """
        p = dict(zip(self.names, values.tolist(), strict=True))
        strut = _Strut.of(p, np.inf) if self.struts else _Strut()
        if not self.platform or strut is None:
            return None
        return (platform_pseudo_inertia(p) - strut.least * self.sliders) / self._unit

    def of_platform(self, matrix: Array) -> Array:
        """Return the parameters, (m,), of a platform's pseudo-inertia, (4, 4), in its scales."""
        body = RigidBody.of_pseudo_inertia(matrix * self._unit)
        made = platform_parameters(body, 0.0, self.joints)
        return np.array([made.get(name, 0.0) for name in self.names])

    @cached_property
    def thin(self) -> tuple[tuple[Array, Array], ...]:
        """The two combinations, (m,), of p1, p2 and p3 that bodies have not less than none of.

        Each with the parameters of a body that has one of it and none of the other.
        """
        if not self.struts:
            return ()
        numbers = (
            ({"p2": -0.5, "p3": 0.5}, {"p1": 1.0, "p2": -1.0, "p3": 1.0}),
            ({"p1": 1.0, "p2": 0.5, "p3": -0.5}, {"p1": 1.0}),
        )
        return tuple(
            (self._vector(combination), self._vector(removed)) for combination, removed in numbers
        )

    def _vector(self, numbers: Mapping[str, float]) -> Array:
        return np.array([numbers.get(name, 0.0) for name in self.names])

    def inside(self, values: Array, share: float) -> Array:
        """Return parameters with small bodies added to each body, and within their bounds."""
        sizes = self.sizes
        added = dict.fromkeys(("p1", "p3"), 2 * sizes["strut"])
        added |= dict.fromkeys(_MOMENTS, 2 * sizes["platform"]) | {MASS: sizes["mass"]}
        return np.clip(values + share * self._vector(added), self.lower, self.upper)


def _depth(p: Mapping[str, float]) -> Array:
    """Return ∫ z² dm of stator and slider, (1, 1), kg m²."""
    return along(p, 0.0)[:1, :1]


def _along(p: Mapping[str, float]) -> Array:
    """Return the pseudo-inertia of slider and stator along u, (3, 3): kg m², kg m, kg.

    Where it is positive semidefinite ½ (p2 + p3) is enough for p5² / m3 of the slider and p4² / m2
    of a stator of all mass that it can have.
    """
    found = np.zeros((3, 3))
    found[:2, :2] = along(p, p[SLIDER_MASS])
    found[0, 2] = found[2, 0] = p["p4"]
    found[2, 2] = HEAVIEST * p[MASS]
    return found


def _platform(p: Mapping[str, float], sliders: Array) -> Array:
    return platform_pseudo_inertia(p) - p.get(SLIDER_MASS, 0.0) * sliders


@dataclass(frozen=True)
class _Strut:
    """Properties of ring, stator and slider by p1 … p5; empty without these parameters."""

    width: float = 0.0
    """∫ x² dm of stator and slider, kg m²."""
    height: float = 0.0
    """∫ y² dm of stator and slider, and the ring's inertia about α."""
    depth: float = 0.0
    """∫ z² dm of stator and slider."""
    p4: float = 0.0
    p5: float = 0.0
    heaviest: float = np.inf
    """A stator can be, kg."""

    @classmethod
    def of(cls, p: Mapping[str, float], slack: float) -> _Strut | None:
        """Return the properties by the parameters; None: these are physically inconsistent."""
        heaviest = HEAVIEST * p[MASS] if MASS in p else np.inf
        depth = (p["p2"] + p["p3"]) / 2
        found = cls(
            float(thickness(p)[0, 0]), float(breadth(p)[0, 0]), depth, p["p4"], p["p5"], heaviest
        )
        spare = found.spare
        enough = min(found.width, found.height, spare) >= -slack
        if not enough or (spare <= 0 and (p["p5"] != 0 or p["p4"] != 0)):
            return None
        return found

    @property
    def reserved(self) -> float:
        """Least ∫ z² dm of the stator, kg m²: of all mass that it can have, in one point."""
        if self.p4 == 0:
            return 0.0
        return self.p4 * (self.p4 / self.heaviest) if self.heaviest > 0 else np.inf

    @property
    def spare(self) -> float:
        """Largest ∫ z² dm of the slider."""
        return self.depth - self.reserved

    @property
    def least(self) -> float:
        """Least mass of the slider, kg."""
        return self.p5 * (self.p5 / self.spare) if self.p5 else 0.0

    def bodies(self, mass: float) -> tuple[RigidBody, RigidBody, RigidBody]:
        """Return ring, stator and slider with a mass of the slider, kg."""
        needed = self.p5 * (self.p5 / mass) if self.p5 else 0.0
        of_stator = self.reserved + max(self.spare - needed, 0.0) / 2
        heavy = min(2 * self.p4 * (self.p4 / of_stator), self.heaviest) if self.p4 else mass
        across, quarter = self.width / 2, self.height / 4
        ring = np.diag([quarter, quarter, quarter, mass])
        stator = np.diag([across, quarter, of_stator, heavy])
        slider = np.diag([across, quarter, self.depth - of_stator, mass])
        stator[2, 3] = stator[3, 2] = self.p4
        slider[2, 3] = slider[3, 2] = self.p5
        return (
            RigidBody.of_pseudo_inertia(ring),
            RigidBody.of_pseudo_inertia(stator),
            RigidBody.of_pseudo_inertia(slider),
        )
