"""`bodies` of the robot file: masses, centres and inertias as CAD gives them, for p1 … p10."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any

import numpy as np
import scipy
from pydantic import BeforeValidator, model_serializer, model_validator

from constraints.arrays import Array
from expdesign.configuration.errors import refusal, shown
from expdesign.configuration.fields import Point, exactly, one_of
from expdesign.configuration.geometry import VANISHING
from expdesign.configuration.quantity import Angle, Inertia, Mass, Positive
from expdesign.configuration.section import Section
from expdesign.mechanism.bodies import (
    RigidBody,
    inertia_of,
    platform_parameters,
    strut_parameters,
    together,
)
from expdesign.mechanism.catalogue import known_parameters
from expdesign.mechanism.strut import ANGLES
from expdesign.mechanism.terms.rigid_platform import LATERAL, MASS

_DIAGONAL, _WHOLE = 3, 6
_NONE = (0.0,) * _WHOLE
_ROUNDED = 1e-3
"""Share of its largest moment by which the inertia of a rounded data sheet may be of no body."""
_ASIDE = 0.01
"""Share of a part's moments that is told when the model does not have it."""


def _inertia(value: object) -> object:
    wanted = "[Ixx, Iyy, Izz] or [Ixx, Iyy, Izz, Ixy, Ixz, Iyz], products as matrix entries"
    if not isinstance(value, list | tuple):
        raise refusal(f"{shown(value)} is not a list", wanted)
    if len(value) not in (_DIAGONAL, _WHOLE):
        raise refusal(f"there are {len(value)} moments of inertia", wanted)
    return (*value, *_NONE[len(value) :])


class Body(Section):
    """A rigid body as CAD tells of it, in its own frame."""

    mass: Annotated[Mass, Positive]
    centre: Point = (0.0, 0.0, 0.0)
    """Of mass, m."""
    inertia: Annotated[tuple[Inertia, ...], BeforeValidator(_inertia)] = _NONE
    """Ixx, Iyy, Izz, Ixy, Ixz, Iyz, matrix entries, about axes parallel to the frame's, kg m²."""
    about: Annotated[str, one_of(("centre", "origin"))] = "centre"
    """The point that the inertia is about."""
    origin: Point = (0.0, 0.0, 0.0)
    """Of the body's frame, in the frame of its part, m."""
    rotation: Annotated[tuple[Angle, ...], exactly(3, "angles about the moving axes x, y, z")] = (
        0.0,
        0.0,
        0.0,
    )
    """Of the body's frame in that of its part, rad."""

    @model_validator(mode="after")
    def _possible(self) -> Body:
        given = self.about == "centre"
        moments = np.linalg.eigvalsh(self._matrix if given else self._own.about_centre)
        largest = float(np.max(np.abs(self.inertia)))
        if moments[0] < -_ROUNDED * largest or moments[2] > sum(moments[:2]) + _ROUNDED * largest:
            about = "; about the origin: with about: origin" if given else ""
            allowed = "moments of which none is more than the two others together"
            raise refusal(
                "no body has this inertia about its centre: its principal moments are "
                f"{', '.join(f'{moment:.3g}' for moment in moments)} kg m^2",
                allowed + about,
                key="inertia",
            )
        return self

    @property
    def _matrix(self) -> Array:
        return inertia_of(self.inertia)

    @property
    def _own(self) -> RigidBody:
        matrix, centre = self._matrix, np.array(self.centre)
        if self.about == "origin":
            return RigidBody(self.mass, self.mass * centre, matrix)
        return RigidBody.of(self.mass, centre, matrix)

    @property
    def in_its_part(self) -> RigidBody:
        """The body in the frame of its part."""
        rotation = scipy.spatial.transform.Rotation.from_euler(ANGLES, self.rotation).as_matrix()
        return self._own.placed(rotation, np.array(self.origin))


def _listed(value: object) -> object:
    return value if isinstance(value, list | tuple) else [value]


FixedBodies = Annotated[tuple[Body, ...], BeforeValidator(_listed)]
"""A body, or a list of bodies that are fixed to each other."""


class Bodies(Section):
    """What moves, part by part; a part that is not given has no mass."""

    ring: FixedBodies = ()
    stator: FixedBodies = ()
    slider: FixedBodies = ()
    platform: FixedBodies = ()
    payload: FixedBodies = ()

    @model_validator(mode="after")
    def _something(self) -> Bodies:
        if not any(vars(self).values()):
            raise refusal("there is no body", f"bodies of {', '.join(type(self).model_fields)}")
        return self

    @model_serializer(mode="plain")
    def _as_written(self) -> dict[str, Any]:
        return {
            name: [body.model_dump() for body in bodies]
            for name, bodies in vars(self).items()
            if name in type(self).model_fields and bodies
        }

    def part(self, *names: str) -> RigidBody:
        """Return all bodies of parts as one."""
        return together(body.in_its_part for name in names for body in getattr(self, name))

    def parameters(self, platform_joints: Array) -> dict[str, float]:
        """Return the parameters that the bodies make, SI.

        p1 … p5 where there are stators or sliders, p6 … Iyz where there is a platform or payload.

        Parameters
        ----------
        platform_joints : (6, 3)
            Platform frame, m.
        """
        found: dict[str, float] = {}
        slider = self.part("slider")
        if self.stator or self.slider:
            found |= strut_parameters(self.part("ring"), self.part("stator"), slider)
        if self.platform or self.payload:
            platform = self.part("platform", "payload")
            found |= platform_parameters(platform, slider.mass, platform_joints)
        return found

    def warnings(self, made: Mapping[str, float], *, general: bool) -> Iterator[str]:
        """Yield what the bodies have and the model has not.

        Parameters
        ----------
        made : mapping
            What `parameters` made.
        general : bool
            Whether the model has the lateral moments of the platform.
        """
        for name in ("ring", "stator", "slider"):
            yield from _aside(name, self.part(name))
        if self.ring and not (self.stator or self.slider):
            yield "bodies.ring counts beside a stator or slider only"
        if not general and (left := self.lateral(made)):
            yield (
                "the platform is declared symmetric, but its bodies are not: "
                f"{', '.join(f'{name} = {value:.3g}' for name, value in left.items())}; "
                "with `platform: general` the model is exact"
            )

    @staticmethod
    def lateral(made: Mapping[str, float]) -> dict[str, float]:
        """Return the lateral moments of a platform that do not vanish, of what was made."""
        if MASS not in made:
            return {}
        moments = max(made["p6"], made["p7"], made["p8"])
        sizes = {"s": np.sqrt(made[MASS] * moments), "I": moments}
        return {n: made[n] for n in LATERAL if abs(made[n]) > VANISHING * sizes[n[0]]}


def payload_parameters(payload: Iterable[Body]) -> dict[str, float]:
    """Return what bodies that are fixed to the platform add to its ten parameters, SI."""
    carried = together(body.in_its_part for body in payload)
    return platform_parameters(carried, 0.0, np.zeros((0, 3)))


def bodies_in_words(
    bodies: Bodies | None, platform_joints: Array, parameters: Mapping[str, float]
) -> str:
    """Say which parameters the bodies make, and which are given otherwise; empty without bodies.

    Parameters
    ----------
    platform_joints : (6, 3)
        Platform frame, m.
    parameters : mapping
        Those that count, SI.
    """
    made = {} if bodies is None else bodies.parameters(platform_joints)
    made = {name: value for name, value in made.items() if name in parameters}
    if not made:
        return ""
    units = {name: parameter.unit for name, parameter in known_parameters().items()}
    told = ", ".join(f"{name} = {value:.4g} {units[name]}" for name, value in made.items())
    others = [name for name, value in made.items() if parameters[name] != value]
    if len(others) == len(made):
        return f"the bodies do not count: `parameters` has its own {', '.join(others)}"
    instead = "; `parameters` has others for " + ", ".join(others) if others else ""
    return f"the bodies make {told}{instead}"


def _aside(name: str, body: RigidBody) -> Iterator[str]:
    """Yield by how much a part of the strut is not as the model has it."""
    if body.mass == 0:
        return
    centre = body.moment / body.mass
    # Of a ring, which does not turn with the strut, the centre in A.
    off = float(np.linalg.norm(centre if name == "ring" else centre[:2]))
    size = np.sqrt(np.max(np.diag(body.inertia)) / body.mass)
    if off > _ASIDE * size:
        where = "joint's centre" if name == "ring" else "strut's axis"
        yield (
            f"bodies.{name}: its centre is {1e3 * off:.3g} mm off the {where}, where the model has "
            "it"
        )
        return
    products = np.abs(body.inertia[np.triu_indices(3, 1)])
    if name != "ring" and np.max(products) > _ASIDE * np.max(np.diag(body.inertia)):
        yield (
            f"bodies.{name}: the model has no products of inertia of a strut, these are up to "
            f"{np.max(products):.3g} kg m^2 about its joint"
        )
