"""Attributes and masses of MJCF elements: default classes, angles, orientations, inertias."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from constraints.arrays import Array
from expdesign.configuration.errors import quote
from expdesign.machines.mechanism_graph import WORLD, Placement
from expdesign.machines.xml_document import Element
from expdesign.mechanism.bodies import RigidBody, inertia_of, together

_MAIN = "main"
_ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
_ACTUATORS = ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder")


@dataclass
class Attributes:
    """Attributes of elements, completed by the defaults of their classes."""

    degrees: bool = True
    order: str = "xyz"
    """Of euler angles; upper case: about fixed axes."""
    autolimits: bool = True
    classes: dict[str, dict[str, dict[str, str]]] = field(default_factory=lambda: {_MAIN: {}})
    """Of a class by its name: attributes by the element's tag."""

    @classmethod
    def of(cls, root: Element) -> Attributes:
        """Read what the top elements of a model say."""
        found = cls()
        for compiler in root.all("compiler"):
            given = compiler.attributes
            if given.get("coordinate", "local") != "local":
                raise compiler.refusal("global coordinates are not read", 'coordinate="local"')
            found.degrees = given.get("angle", "degree" if found.degrees else "radian") == "degree"
            found.order = given.get("eulerseq", found.order)
            found.autolimits = given.get("autolimits", "true") == "true"
            if len(found.order) != len("xyz") or not set(found.order.lower()) <= set("xyz"):
                raise compiler.refusal(f"eulerseq is {quote(found.order)}", "three of x, y, z")
        for default in root.all("default"):
            # The class of elements without one; a model may give it another name.
            name = default.attributes.get("class", _MAIN)
            found.classes[_MAIN] = found._with_children(default, found.classes[_MAIN], name)
        return found

    def _with_children(
        self, default: Element, inherited: dict[str, dict[str, str]], name: str
    ) -> dict[str, dict[str, str]]:
        """Add a class and those within it; return the attributes of the class."""
        mine = {tag: dict(given) for tag, given in inherited.items()}
        for element in default.children:
            if element.tag != "default":
                tag = "general" if element.tag in _ACTUATORS else element.tag
                mine.setdefault(tag, {}).update(element.attributes)
        self.classes[name] = mine
        for child in default.all("default"):
            title = child.attributes.get("class", "")
            if not title:
                raise child.refusal("the class is missing", 'class="NAME"')
            self._with_children(child, mine, title)
        return mine

    def given(self, element: Element, inherited: str | None = None) -> dict[str, str]:
        """Return an element's attributes, over those of its class or the inherited one."""
        name = element.attributes.get("class") or inherited or _MAIN
        if name not in self.classes:
            known = ", ".join(self.classes)
            raise element.refusal(f"the class {quote(name)} is unknown", known)
        tag = "general" if element.tag in _ACTUATORS else element.tag
        return {**self.classes[name].get(tag, {}), **element.attributes}

    def place(self, element: Element) -> Placement:
        """Return the placement of a body or frame in its parent."""
        origin = np.zeros(3)
        if (pos := element.attributes.get("pos")) is not None:
            origin = element.numbers(pos, "pos", 3)
        return Placement(self._rotation(element), origin)

    def _rotation(self, element: Element) -> Array:
        given = [key for key in _ORIENTATIONS if key in element.attributes]
        if len(given) > 1:
            raise element.refusal(f"{' and '.join(given)} are two orientations", "one of them")
        if not given:
            return np.eye(3)
        key = given[0]
        text = element.attributes[key]
        if key == "quat":
            quaternion = _unit(element, element.numbers(text, key, 4), key)
            return Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        if key == "axisangle":
            values = element.numbers(text, key, 4)
            vector = self.angle(float(values[3])) * _unit(element, values[:3], key)
            return Rotation.from_rotvec(vector).as_matrix()
        if key == "euler":
            return self._of_euler(element.numbers(text, key, 3))
        if key == "xyaxes":
            values = element.numbers(text, key, 6)
            x = _unit(element, values[:3], key)
            y = _unit(element, values[3:] - x * (x @ values[3:]), key)
            return np.column_stack([x, y, np.cross(x, y)])
        return turned_to(_unit(element, element.numbers(text, key, 3), key))

    def angle(self, value: float) -> float:
        """Return an angle of the model in rad."""
        return float(np.radians(value)) if self.degrees else value

    def _of_euler(self, values: Array) -> Array:
        rotation = Rotation.identity()
        for letter, value in zip(self.order, values, strict=True):
            one = Rotation.from_euler(letter.lower(), value, self.degrees)
            rotation = rotation * one if letter.islower() else one * rotation
        return rotation.as_matrix()


def _unit(element: Element, vector: Array, what: str) -> Array:
    length = float(np.linalg.norm(vector))
    if length == 0:
        raise element.refusal(f"{what} has no direction", "numbers that are not all zero")
    return np.asarray(vector / length)


def turned_to(z: Array) -> Array:
    """Return the least rotation that takes the z axis to a unit vector."""
    axis = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(axis))
    if sine == 0:
        return np.diag([1.0, np.sign(z[2]), np.sign(z[2])])
    return Rotation.from_rotvec(np.arctan2(sine, z[2]) * axis / sine).as_matrix()


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
    """Moments of a cylinder with two half spheres, masses in proportion to volumes."""
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
