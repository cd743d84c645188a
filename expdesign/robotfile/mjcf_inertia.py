"""What MJCF says of the mass of a body: ``<inertial>``, or the masses of its geoms.

Source: MuJoCo's XML reference, body/inertial and geom.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.bodies import RigidBody, inertia_of, together
from expdesign.robotfile.mechanism_graph import WORLD, Placement
from expdesign.robotfile.mjcf_attributes import Attributes, turned_to
from expdesign.robotfile.xml_document import Element

_ALONG_Z = ("capsule", "cylinder")


def rigid_body(
    element: Element, place: Placement, attributes: Attributes, inherited: str | None
) -> RigidBody | None:
    """Return a body in the world; None where its mass follows from shapes that are not known.

    Parameters
    ----------
    element : Element
        Of the body.
    place : Placement
        Of the body in the world.
    inherited : str or None
        Class of defaults.
    """
    inertial = element.first("inertial")
    if inertial is not None:
        own = _inertial(inertial, attributes)
    else:
        found = [_geom(*one, attributes, inherited) for one in geoms(element, WORLD, attributes)]
        known = [body for body in found if body is not None]
        own = together(known) if len(known) == len(found) else None
    return None if own is None else own.placed(place.rotation, place.origin)


def _inertial(inertial: Element, attributes: Attributes) -> RigidBody | None:
    given = inertial.attributes
    mass = float(inertial.numbers(given.get("mass", ""), "mass", 1)[0])
    if "fullinertia" in given:
        matrix = inertia_of(inertial.numbers(given["fullinertia"], "fullinertia", 6))
    elif "diaginertia" in given:
        matrix = np.diag(inertial.numbers(given["diaginertia"], "diaginertia", 3))
    else:
        return None
    place = attributes.place(inertial)
    return RigidBody.of(mass, np.zeros(3), matrix).placed(place.rotation, place.origin)


def geoms(
    element: Element, place: Placement, attributes: Attributes
) -> Iterator[tuple[Element, Placement]]:
    """Yield the geoms of a body, those in its frames too, with where these stand."""
    for geom in element.all("geom"):
        yield geom, place
    for frame in element.all("frame"):
        yield from geoms(frame, place.then(attributes.place(frame)), attributes)


def _geom(
    geom: Element, within: Placement, attributes: Attributes, inherited: str | None
) -> RigidBody | None:
    given = attributes.given(geom, inherited)
    if "mass" not in given:
        return None
    mass = float(geom.numbers(given["mass"], "mass", 1)[0])
    if mass == 0:
        return together(())
    kind = given.get("type", "sphere")
    place, size = attributes.place(geom), geom.numbers(given.get("size", ""), "size")
    if "fromto" in given:
        ends = geom.numbers(given["fromto"], "fromto", 6).reshape(2, 3)
        along = ends[1] - ends[0]
        length = float(np.linalg.norm(along))
        if kind not in _ALONG_Z or length == 0:
            return None
        place = Placement(turned_to(along / length), ends.mean(axis=0))
        size = np.array([*size[:1], length / 2])
    if kind not in _SHAPES or len(size) < _SHAPES[kind][0]:
        return None
    whole = within.then(place)
    matrix = mass * np.diag(_SHAPES[kind][1](size))
    return RigidBody.of(mass, np.zeros(3), matrix).placed(whole.rotation, whole.origin)


def _sphere(size: Array) -> list[float]:
    return [float(0.4 * size[0] ** 2)] * 3


def _box(size: Array) -> list[float]:
    squares = np.square(size)
    return [float(v) / 3 for v in np.sum(squares) - squares]


def _ellipsoid(size: Array) -> list[float]:
    squares = np.square(size)
    return [float(v) / 5 for v in np.sum(squares) - squares]


def _cylinder(size: Array) -> list[float]:
    radius, half = size[:2]
    across = float(radius**2 / 4 + half**2 / 3)
    return [across, across, float(radius**2 / 2)]


def _capsule(size: Array) -> list[float]:
    """Of a cylinder with two half spheres: shares of the mass by their volumes."""
    radius, half = size[:2]
    ends = 2 * radius / (2 * radius + 3 * half)
    ball = 0.4 * radius**2
    away = half**2 + 0.75 * half * radius
    middle = _cylinder(size)
    across = float(ends * (ball + away) + (1 - ends) * middle[0])
    return [across, across, float(ends * ball + (1 - ends) * middle[2])]


_SHAPES: Mapping[str, tuple[int, Callable[[Array], list[float]]]] = {
    "sphere": (1, _sphere),
    "box": (3, _box),
    "ellipsoid": (3, _ellipsoid),
    "cylinder": (2, _cylinder),
    "capsule": (2, _capsule),
}
"""Of a shape: how many sizes it has, and its moments of inertia about its centre for 1 kg, m²."""
