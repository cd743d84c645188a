"""What MJCF says about the meaning of attributes: classes of defaults, angles and orientations."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from constraints.arrays import Array
from expdesign.configuration.problem import shown
from expdesign.robotfile.mechanism_graph import Placement
from expdesign.robotfile.xml_document import Element

_MAIN = "main"
_ORIENTATIONS = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
_ACTUATORS = ("general", "motor", "position", "velocity", "intvelocity", "damper", "cylinder")


@dataclass
class Attributes:
    """Attributes of elements with the defaults of their classes."""

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
                raise compiler.refusal(f"eulerseq is {shown(found.order)}", "three of x, y, z")
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
            raise element.refusal(f"the class {shown(name)} is unknown", known)
        tag = "general" if element.tag in _ACTUATORS else element.tag
        return {**self.classes[name].get(tag, {}), **element.attributes}

    def place(self, element: Element) -> Placement:
        """Return where a body or frame stands in its parent."""
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
