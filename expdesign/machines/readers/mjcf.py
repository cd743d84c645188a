"""MJCF, the format of MuJoCo: a tree of bodies, with loops closed by ``<equality>``.

Bodies have the pose of the model as written (qpos0). Source: MuJoCo's XML reference.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
from scipy.spatial.transform import Rotation

from constraints.arrays import Array
from expdesign.configuration.errors import quote
from expdesign.configuration.robot import EARTH_GRAVITY
from expdesign.machines.closed_loops import hexapod
from expdesign.machines.machine import MachineDraft, MachineFormat, Question
from expdesign.machines.mechanism_graph import (
    NOTHING,
    WORLD,
    Element,
    Joint,
    Kind,
    Link,
    Placement,
    read_xml,
)
from expdesign.mechanism.bodies import RigidBody, inertia_of, together

_NOT_FOLLOWED = ("include", "replicate", "attach", "composite", "flexcomp", "model")
_KINDS: dict[str, Kind] = {
    "hinge": "rotation",
    "ball": "rotation",
    "slide": "slide",
    "free": "free",
}
_PLACING = ["rotation"] * 3 + ["slide"] * 3
"""Joints of one body, sorted, that leave it free."""


def _read(name: str, files: tuple[Path, ...]) -> MachineDraft:
    root = read_xml(files[0], "mujoco")
    model = _Model(root)
    for closing in root.all("equality"):
        model.close_loops(closing)
    model.drive()
    source = f"MuJoCo model {quote(root.attributes.get('model', ''))}, {files[0].name}"
    machine = hexapod(name, source, model.bodies, model.joints, 0, files[0])
    gravity: tuple[float, ...] = EARTH_GRAVITY
    for option in root.all("option"):
        if (given := option.attributes.get("gravity")) is not None:
            gravity = tuple(float(value) for value in option.numbers(given, "gravity", 3))
    if not np.any(gravity):
        text = "The model has no gravity; the machine's is taken as 9.81 m/s² along -z."
        return replace(machine, questions=(*machine.questions, Question("gravity", text)))
    return machine if gravity == EARTH_GRAVITY else replace(machine, gravity=gravity)


class _Model:
    """Bodies and joints, collected from the tree."""

    def __init__(self, root: Element) -> None:
        _refuse_references(root)
        self.root = root
        self.attributes = Attributes.of(root)
        self.bodies: list[Link] = [Link("world", WORLD, 0.0, NOTHING)]
        self.joints: list[Joint] = []
        self._numbers = {"world": 0}
        self._sites: dict[str, tuple[int, Array]] = {}
        for world in root.all("worldbody"):
            self._collect(world, 0, WORLD, None)
        if self.attributes.total_mass:
            self._scale_masses(self.attributes.total_mass)

    def _scale_masses(self, total: float) -> None:
        """Scale all bodies to a total mass, kg; with an unknown one nothing of them is known."""
        masses = [body.mass for body in self.bodies if body.mass is not None]
        stated = sum(masses) if len(masses) == len(self.bodies) else 0.0
        factor = total / stated if stated > 0 else None
        for i, body in enumerate(self.bodies[1:], 1):
            mass, one = body.mass, body.rigid
            if factor is None or mass is None:
                self.bodies[i] = replace(body, mass=None, rigid=None)
                continue
            if one is not None:
                one = RigidBody(factor * one.mass, factor * one.moment, factor * one.inertia)
            self.bodies[i] = replace(body, mass=factor * mass, rigid=one)

    def _collect(
        self, element: Element, body: int, place: Placement, inherited: str | None
    ) -> None:
        """Collect the content of a body or frame; `place` is its placement in the world."""
        inherited = element.attributes.get("childclass") or inherited
        for child in element.children:
            if child.tag == "site":
                given = self.attributes.given(child, inherited)
                local = child.numbers(given.get("pos", "0 0 0"), "pos", 3)
                self._sites[given.get("name", "")] = (body, place.point(local))
            elif child.tag == "frame":
                inner = place.then(self.attributes.place(child))
                self._collect(child, body, inner, inherited)
            elif child.tag == "body":
                inner = place.then(self.attributes.place(child))
                self._add_body(child, body, inner, inherited)

    def _add_body(
        self, element: Element, parent: int, place: Placement, inherited: str | None
    ) -> None:
        inherited = element.attributes.get("childclass") or inherited
        title = element.attributes.get("name")
        name = f"the body in line {element.line}" if title is None else title
        if title in self._numbers:
            raise element.refusal("two bodies have this name", "names that differ")
        given = element.all("joint", "freejoint")
        joints = [self._joint(joint, place, inherited) for joint in given]
        free = any(joint.kind == "free" for joint in joints)
        if sorted(joint.kind for joint in joints) == _PLACING and parent == 0:
            joints, free = [], True
        # Several joints of a body are a chain of bodies without mass, at the same place.
        carrier = parent
        for k, joint in enumerate(joints[:-1]):
            link = len(self.bodies)
            between = f"{name}, between joints {k + 1} and {k + 2}"
            self.bodies.append(Link(between, place, 0.0, NOTHING))
            self.joints.append(replace(joint, bodies=(carrier, link)))
            carrier = link
        number = len(self.bodies)
        if title is not None:
            self._numbers[title] = number
        rigid = rigid_body(element, place, self.attributes, inherited)
        self.bodies.append(Link(name, place, self._mass(element, inherited), rigid))
        if joints:
            self.joints.append(replace(joints[-1], bodies=(carrier, number)))
        elif not free:
            self._add_fixed(element, parent, number, place.origin)
        self._collect(element, number, place, inherited)

    def _add_fixed(self, element: Element, first: int, second: int, point: Array) -> None:
        none = np.zeros((0, 3))
        self.joints.append(Joint("fixed", (first, second), (point, point), none, element))

    def _joint(self, element: Element, place: Placement, inherited: str | None) -> Joint:
        """Return a joint of a body placed at `place`; its links are assigned later."""
        given = self.attributes.given(element, inherited)
        title = "free" if element.tag == "freejoint" else given.get("type", "hinge")
        if title not in _KINDS:
            raise element.refusal(f"the type {quote(title)} is unknown", ", ".join(_KINDS))
        point = place.point(element.numbers(given.get("pos", "0 0 0"), "pos", 3))
        axes = np.zeros((0, 3))
        if title in ("hinge", "slide"):
            axis = element.numbers(given.get("axis", "0 0 1"), "axis", 3)
            axes = (place.rotation @ element.direction(axis, "the axis"))[None]
        travel = force = None
        if title == "slide":
            travel = self._range(element, given)
            force = self._largest(element, given, "actuatorfrc")
        return Joint(
            _KINDS[title], (0, 0), (point, point), axes, element, travel=travel, force=force
        )

    def _range(self, element: Element, given: dict[str, str]) -> tuple[float, float] | None:
        if "range" not in given or not self.attributes.is_limited(given, "limited"):
            return None
        low, high = element.numbers(given["range"], "range", 2)
        reference = float(element.numbers(given.get("ref", "0"), "ref", 1)[0])
        return (float(low) - reference, float(high) - reference) if low < high else None

    def _mass(self, element: Element, inherited: str | None) -> float | None:
        """Return a body's mass; None if it follows from shapes and densities."""
        if (inertial := self.attributes.inertial(element)) is not None:
            return float(inertial.numbers(inertial.attributes.get("mass", ""), "mass", 1)[0])
        total = 0.0
        for geom, _, given in geoms(element, WORLD, self.attributes, inherited):
            if "mass" not in given:
                return None
            total += float(geom.numbers(given["mass"], "mass", 1)[0])
        return total

    def close_loops(self, equality: Element) -> None:
        """Take the constraints that close loops as joints."""
        for element in equality.all("connect", "weld"):
            given = self.attributes.given(element)
            if given.get("active", "true") == "false":
                continue
            (first, point), (second, other) = self._ends(element, given)
            if element.tag == "weld":
                self._add_fixed(element, first, second, point)
            else:
                none = np.zeros((0, 3))
                joint = Joint("rotation", (first, second), (point, other), none, element)
                self.joints.append(joint)

    def _ends(
        self, element: Element, given: dict[str, str]
    ) -> tuple[tuple[int, Array], tuple[int, Array]]:
        if "site1" in given and "site2" in given:
            names = (given["site1"], given["site2"])
            for name in names:
                if name not in self._sites:
                    raise element.refusal(f"there is no site {quote(name)}", "a site of a body")
            return self._sites[names[0]], self._sites[names[1]]
        names = (given.get("body1", ""), given.get("body2", "world"))
        for name in names:
            if name not in self._numbers:
                raise element.refusal(f"there is no body {quote(name)}", "a body of the model")
        first, second = (self._numbers[name] for name in names)
        anchor = element.numbers(given.get("anchor", "0 0 0"), "anchor", 3)
        point = self.bodies[first].place.point(anchor)
        return (first, point), (second, point)

    def drive(self) -> None:
        """Give the slides the largest force of their actuators."""
        forces: dict[str, float] = {}
        for section in self.root.all("actuator"):
            for element in section.all(*_ACTUATORS):
                given = self.attributes.given(element)
                largest = [self._largest(element, given, "force")]
                if element.tag == "motor":
                    largest.append(self._largest(element, given, "ctrl"))
                known = [force for force in largest if force is not None]
                if known and given.get("joint"):
                    gear = element.numbers(given.get("gear", "1"), "gear")
                    forces[given["joint"]] = min(known) * abs(float(gear[0]))
        for i, joint in enumerate(self.joints):
            name = joint.source.attributes.get("name", "")
            if joint.kind == "slide" and name in forces:
                own = forces[name] if joint.force is None else min(forces[name], joint.force)
                self.joints[i] = replace(joint, force=own)

    def _largest(self, element: Element, given: dict[str, str], kind: str) -> float | None:
        """Return the largest value of a range that is the same in both directions, else None."""
        key = f"{kind}range"
        if key not in given or not self.attributes.is_limited(given, f"{kind}limited"):
            return None
        low, high = element.numbers(given[key], key, 2)
        return float(min(-low, high)) if low < 0 < high else None


def _refuse_references(element: Element) -> None:
    """Refuse elements that include others, such as those of another file."""
    for child in element.children:
        if child.tag in _NOT_FOLLOWED:
            message = f"<{child.tag}> is not followed"
            allowed = "the whole model in one file, as MuJoCo saves it (mj_saveLastXML)"
            raise child.refusal(message, allowed)
        _refuse_references(child)


FORMAT = MachineFormat("a MuJoCo model (MJCF)", (".xml", ".mjcf"), _read)


_MAIN = "main"
_ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
_ACTUATORS = ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder")


@dataclass
class Attributes:
    """Attributes of elements, completed by the defaults of their classes."""

    degrees: bool = True
    order: str = "xyz"
    """Order of Euler angles; upper case: about fixed axes."""
    autolimits: bool = True
    total_mass: float = 0.0
    """Mass that all bodies are scaled to, kg; zero: they are not."""
    by_shapes: bool = False
    """Whether bodies have the inertia of their shapes although they state another one."""
    classes: dict[str, dict[str, dict[str, str]]] = field(default_factory=lambda: {_MAIN: {}})
    """Attributes by class and by the element's tag."""

    @classmethod
    def of(cls, root: Element) -> Attributes:
        """Read the compiler's settings and the default classes of a model."""
        found = cls()
        for compiler in root.all("compiler"):
            given = compiler.attributes
            if given.get("coordinate", "local") != "local":
                raise compiler.refusal("global coordinates are not read", 'coordinate="local"')
            found.degrees = given.get("angle", "degree" if found.degrees else "radian") == "degree"
            found.order = given.get("eulerseq", found.order)
            found.autolimits = given.get("autolimits", "true") == "true"
            total = float(compiler.numbers(given.get("settotalmass", "0"), "settotalmass", 1)[0])
            found.total_mass = max(total, 0.0) or found.total_mass
            found.by_shapes = given.get("inertiafromgeom", "auto") == "true"
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

    def inertial(self, element: Element) -> Element | None:
        """Return the stated inertia of a body; None where its shapes make it."""
        return None if self.by_shapes else element.first("inertial")

    def is_limited(self, given: Mapping[str, str], flag: str) -> bool:
        """Return whether a range counts: by its flag, by default where the range is stated."""
        stated = given.get(flag, "auto")
        return stated == "true" or (stated == "auto" and self.autolimits)

    def place(
        self, element: Element, defaults: Mapping[str, str] = MappingProxyType({})
    ) -> Placement:
        """Return the placement of an element in its parent; bodies and frames have no defaults."""
        origin = np.zeros(3)
        if (pos := element.attributes.get("pos", defaults.get("pos"))) is not None:
            origin = element.numbers(pos, "pos", 3)
        return Placement(self._rotation(element, defaults), origin)

    def _rotation(self, element: Element, defaults: Mapping[str, str]) -> Array:
        own, inherited = (
            [key for key in _ORIENTATIONS if key in given]
            for given in (element.attributes, defaults)
        )
        if len(own) > 1:
            raise element.refusal(f"{' and '.join(own)} are two orientations", "one of them")
        if not (own or inherited):
            return np.eye(3)
        key = (own or inherited)[0]
        text = element.attributes.get(key, defaults.get(key, ""))
        if key == "quat":
            quaternion = element.direction(element.numbers(text, key, 4), key)
            return Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
        if key == "axisangle":
            values = element.numbers(text, key, 4)
            angle = float(np.radians(values[3]) if self.degrees else values[3])
            return Rotation.from_rotvec(angle * element.direction(values[:3], key)).as_matrix()
        if key == "euler":
            rotation = Rotation.identity()
            for letter, value in zip(self.order, element.numbers(text, key, 3), strict=True):
                one = Rotation.from_euler(letter.lower(), value, self.degrees)
                rotation = rotation * one if letter.islower() else one * rotation
            return rotation.as_matrix()
        if key == "xyaxes":
            values = element.numbers(text, key, 6)
            x = element.direction(values[:3], key)
            y = element.direction(values[3:] - x * (x @ values[3:]), key)
            return np.column_stack([x, y, np.cross(x, y)])
        return turned_to(element.direction(element.numbers(text, key, 3), key))


def turned_to(z: Array) -> Array:
    """Return the least rotation that takes the z axis to a unit vector."""
    axis = np.cross([0.0, 0.0, 1.0], z)
    sine = float(np.linalg.norm(axis))
    if sine == 0:
        return np.diag([1.0, np.sign(z[2]), np.sign(z[2])])
    return Rotation.from_rotvec(np.arctan2(sine, z[2]) * axis / sine).as_matrix()


_ALONG_Z = ("capsule", "cylinder")
_SIZES = {"sphere": 1, "box": 3, "ellipsoid": 3, "cylinder": 2, "capsule": 2}
"""Number of sizes of a shape."""


def rigid_body(
    element: Element, place: Placement, attributes: Attributes, inherited: str | None
) -> RigidBody | None:
    """Return a body in the world; None if its mass follows from unknown shapes."""
    if (inertial := attributes.inertial(element)) is not None:
        own = _inertial(inertial, attributes)
    else:
        shapes = geoms(element, WORLD, attributes, inherited)
        found = [_geom(*one, attributes) for one in shapes]
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
    element: Element, place: Placement, attributes: Attributes, inherited: str | None
) -> Iterator[tuple[Element, Placement, dict[str, str]]]:
    """Yield the geoms of a body and of its frames: with the placement of their frame, attributes.

    `inherited` is the class of the body's geoms that have none.
    """
    for geom in element.all("geom"):
        yield geom, place, attributes.given(geom, inherited)
    for frame in element.all("frame"):
        inner = place.then(attributes.place(frame))
        own = frame.attributes.get("childclass") or inherited
        yield from geoms(frame, inner, attributes, own)


def _geom(
    geom: Element, within: Placement, given: dict[str, str], attributes: Attributes
) -> RigidBody | None:
    if "mass" not in given:
        return None
    mass = float(geom.numbers(given["mass"], "mass", 1)[0])
    if mass == 0:
        return together(())
    kind = given.get("type", "sphere")
    place, size = attributes.place(geom, given), geom.numbers(given.get("size", ""), "size")
    if "fromto" in given:
        ends = geom.numbers(given["fromto"], "fromto", 6).reshape(2, 3)
        along = ends[1] - ends[0]
        length = float(np.linalg.norm(along))
        if kind not in _ALONG_Z or length == 0:
            return None
        place = Placement(turned_to(along / length), ends.mean(axis=0))
        size = np.array([*size[:1], length / 2])
    if (moments := _moments(kind, size)) is None:
        return None
    whole = within.then(place)
    body = RigidBody.of(mass, np.zeros(3), mass * np.diag(moments))
    return body.placed(whole.rotation, whole.origin)


def _moments(kind: str, size: Array) -> list[float] | None:
    """Return the moments of inertia of a shape about its centre for 1 kg, m²; None if unknown."""
    if kind not in _SIZES or len(size) < _SIZES[kind]:
        return None
    squares = np.square(size)
    if kind == "sphere":
        return [float(0.4 * size[0] ** 2)] * 3
    if kind in ("box", "ellipsoid"):
        return [float(v) / (3 if kind == "box" else 5) for v in np.sum(squares) - squares]
    radius, half = size[:2]
    across, along = float(radius**2 / 4 + half**2 / 3), float(radius**2 / 2)
    if kind == "capsule":  # a cylinder with two half spheres, masses in proportion to volumes
        ends = 2 * radius / (2 * radius + 3 * half)
        ball = 0.4 * radius**2
        away = half**2 + 0.75 * half * radius
        across = float(ends * (ball + away) + (1 - ends) * across)
        along = float(ends * ball + (1 - ends) * along)
    return [across, across, along]
