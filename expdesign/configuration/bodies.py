"""`bodies` of the robot file: masses, centres and inertias from CAD, for parameters p1 … p10."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Literal

import numpy as np
import scipy
from pydantic import BeforeValidator, model_serializer, model_validator

from constraints.arrays import Array
from expdesign.configuration.errors import quote, refusal
from expdesign.configuration.geometry import VANISHING
from expdesign.configuration.quantity import Angle, Inertia, Mass, Positive
from expdesign.configuration.schema import Point, Section, exactly
from expdesign.mechanism.bodies import (
    RigidBody,
    inertia_of,
    platform_parameters,
    strut_parameters,
    together,
)
from expdesign.mechanism.strut import ANGLES
from expdesign.mechanism.terms import known_parameters
from expdesign.mechanism.terms.rigid_platform import LATERAL, MASS

_DIAGONAL, _WHOLE = 3, 6
_ZERO = (0.0,) * _WHOLE
_ROUNDING = 1e-3
"""Allowed violation of the triangle inequality of rounded moments, as a share of the largest."""
_SUM_ROUNDING = 1e-13
"""Largest rounding error of sums over bodies and symmetric joints, relative to the largest sum."""
_RELEVANT = 0.01
"""Smallest reported deviation of a part from the model, as a share of the part's moments."""


def _read_inertia(value: object) -> object:
    wanted = "[Ixx, Iyy, Izz] or [Ixx, Iyy, Izz, Ixy, Ixz, Iyz], products as matrix entries"
    if not isinstance(value, list | tuple):
        raise refusal(f"{quote(value)} is not a list", wanted)
    if len(value) not in (_DIAGONAL, _WHOLE):
        raise refusal(f"there are {len(value)} moments of inertia", wanted)
    return (*value, *_ZERO[len(value) :])


class BodyDescription(Section):
    """A rigid body with the data of a CAD program, in the body's frame."""

    mass: Annotated[Mass, Positive]
    centre: Point = (0.0, 0.0, 0.0)
    """Centre of mass, m."""
    inertia: Annotated[tuple[Inertia, ...], BeforeValidator(_read_inertia)] = _ZERO
    """Ixx, Iyy, Izz, Ixy, Ixz, Iyz, matrix entries, about axes parallel to the frame's, kg m²."""
    about: Literal["centre", "origin"] = "centre"
    """Reference point of the inertia."""
    origin: Point = (0.0, 0.0, 0.0)
    """Origin of the body's frame in the frame of its part, m."""
    rotation: Annotated[tuple[Angle, ...], exactly(3, "angles about the moving axes x, y, z")] = (
        0.0,
        0.0,
        0.0,
    )
    """Rotation of the body's frame in the frame of its part, rad."""

    @model_validator(mode="after")
    def _check_inertia(self) -> BodyDescription:
        about_centre = self.about == "centre"
        inertia = inertia_of(self.inertia) if about_centre else self._own.about_centre
        moments = np.linalg.eigvalsh(inertia)
        slack = _ROUNDING * float(np.max(np.abs(self.inertia)))
        if moments[0] < -slack or moments[2] > sum(moments[:2]) + slack:
            allowed = "moments of which none is larger than the sum of the two others"
            raise refusal(
                "a body cannot have this inertia about its centre: the principal moments are "
                f"{', '.join(f'{moment:.3g}' for moment in moments)} kg m^2",
                allowed + ("; about the origin: with about: origin" if about_centre else ""),
                key="inertia",
            )
        return self

    @property
    def _own(self) -> RigidBody:
        matrix, centre = inertia_of(self.inertia), np.array(self.centre)
        if self.about == "origin":
            return RigidBody(self.mass, self.mass * centre, matrix)
        return RigidBody.of(self.mass, centre, matrix)

    @property
    def in_its_part(self) -> RigidBody:
        """The body in the frame of its part."""
        rotation = scipy.spatial.transform.Rotation.from_euler(ANGLES, self.rotation).as_matrix()
        return self._own.placed(rotation, np.array(self.origin))


FixedBodies = Annotated[
    tuple[BodyDescription, ...],
    BeforeValidator(lambda value: value if isinstance(value, list | tuple) else [value]),
]
"""A body, or a list of bodies that are fixed to each other."""


class Bodies(Section):
    """The moving bodies by part; a part that is not given has no mass."""

    ring: FixedBodies = ()
    stator: FixedBodies = ()
    slider: FixedBodies = ()
    platform: FixedBodies = ()
    payload: FixedBodies = ()

    @model_validator(mode="after")
    def _check_filled(self) -> Bodies:
        if not any(vars(self).values()):
            raise refusal("there is no body", f"bodies of {', '.join(type(self).model_fields)}")
        return self

    @model_serializer(mode="plain")
    def _serialize(self) -> dict[str, Any]:
        return {
            name: [body.model_dump() for body in bodies]
            for name, bodies in vars(self).items()
            if name in type(self).model_fields and bodies
        }

    def part(self, *names: str) -> RigidBody:
        """Return all bodies of some parts as one."""
        return together(body.in_its_part for name in names for body in getattr(self, name))

    def parameters(self, platform_joints: Array) -> dict[str, float]:
        """Return the parameters that follow from the bodies, SI.

        p1 … p5 with stators or sliders, p6 … Iyz with a platform or payload. The platform joints,
        (6, 3), are in its frame, m.
        """
        found: dict[str, float] = {}
        slider = self.part("slider")
        if self.stator or self.slider:
            found |= strut_parameters(self.part("ring"), self.part("stator"), slider)
        if self.platform or self.payload:
            platform = self.part("platform", "payload")
            found |= _platform_parameters(platform, slider.mass, platform_joints)
        return found

    def carried(self, platform_joints: Array) -> dict[str, float]:
        """Return the share of payload and sliders in p6 … Iyz, SI; arguments of `parameters`."""
        slider = self.part("slider")
        return _platform_parameters(self.part("payload"), slider.mass, platform_joints)

    def warnings(self, implied: Mapping[str, float], *, general: bool) -> Iterator[str]:
        """Yield properties of the bodies that the model neglects; `implied`: see `parameters`."""
        for name in ("ring", "stator", "slider"):
            yield from _neglected(name, self.part(name))
        if self.ring and not (self.stator or self.slider):
            yield "bodies.ring has an effect only together with a stator or slider"
        if not general and (lateral := self.lateral(implied)):
            yield (
                "the platform is declared symmetric, but its bodies are not: "
                f"{', '.join(f'{name} = {value:.3g}' for name, value in lateral.items())}; "
                "with `platform: general` the model is exact"
            )

    @staticmethod
    def lateral(implied: Mapping[str, float]) -> dict[str, float]:
        """Return the lateral moments of a platform that do not vanish."""
        if MASS not in implied:
            return {}
        moments = max(implied["p6"], implied["p7"], implied["p8"])
        sizes = {"s": np.sqrt(implied[MASS] * moments), "I": moments}
        return {n: implied[n] for n in LATERAL if abs(implied[n]) > VANISHING * sizes[n[0]]}


def _neglected(name: str, body: RigidBody) -> Iterator[str]:
    """Yield deviations of a part of the strut from the model."""
    if body.mass == 0:
        return
    centre = body.moment / body.mass
    # A ring does not turn with the strut: the model has its centre in the joint A.
    offset = float(np.linalg.norm(centre if name == "ring" else centre[:2]))
    size = np.sqrt(np.max(np.diag(body.inertia)) / body.mass)
    if offset > _RELEVANT * size:
        where = "joint's centre" if name == "ring" else "strut's axis"
        yield (
            f"bodies.{name}: the centre of mass is {1e3 * offset:.3g} mm off the {where}, which "
            "the model neglects"
        )
        return
    products = np.abs(body.inertia[np.triu_indices(3, 1)])
    if name != "ring" and np.max(products) > _RELEVANT * np.max(np.diag(body.inertia)):
        yield (
            f"bodies.{name}: the model neglects products of inertia of a strut, here up to "
            f"{np.max(products):.3g} kg m^2 about its joint"
        )


def payload_parameters(payload: Iterable[BodyDescription]) -> dict[str, float]:
    """Return the additions of bodies on the platform to its ten parameters, SI."""
    carried = together(body.in_its_part for body in payload)
    return _platform_parameters(carried, 0.0, np.zeros((0, 3)))


def _platform_parameters(
    platform: RigidBody, slider_mass: float, joints: Array
) -> dict[str, float]:
    """Return `platform_parameters`, with sums that are zero up to rounding as zero."""
    found = platform_parameters(platform, slider_mass, joints)
    least = _SUM_ROUNDING * max(abs(value) for name, value in found.items() if name != MASS)
    return {n: value if n == MASS or abs(value) > least else 0.0 for n, value in found.items()}


def bodies_in_words(
    bodies: Bodies | None, platform_joints: Array, parameters: Mapping[str, float]
) -> str:
    """Describe the parameters from the bodies; those of the robot, SI, override them."""
    implied = {} if bodies is None else bodies.parameters(platform_joints)
    implied = {name: value for name, value in implied.items() if name in parameters}
    if not implied:
        return ""
    units = {name: parameter.unit for name, parameter in known_parameters().items()}
    listed = ", ".join(f"{name} = {value:.4g} {units[name]}" for name, value in implied.items())
    others = [name for name, value in implied.items() if parameters[name] != value]
    if len(others) == len(implied):
        return f"`parameters` overrides all values from the bodies: {', '.join(others)}"
    override = f"; `parameters` overrides {', '.join(others)}" if others else ""
    return f"from the bodies: {listed}{override}"
