"""MJCF, the format of MuJoCo: a tree of bodies, whose loops are closed by ``<equality>``.

Bodies stand where the model is written (qpos0). Source: MuJoCo's XML reference.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.errors import quote
from expdesign.configuration.robot import EARTH_GRAVITY
from expdesign.machines.closed_loops import hexapod
from expdesign.machines.machine import MachineDraft, MachineFormat, Question
from expdesign.machines.mechanism_graph import NOTHING, WORLD, Joint, Kind, Link, Placement
from expdesign.machines.mjcf import Attributes, geoms, rigid_body
from expdesign.machines.xml_document import Element, read_xml

_NOT_FOLLOWED = ("include", "replicate", "attach", "composite", "flexcomp", "model")
_KINDS: dict[str, Kind] = {
    "hinge": "rotation",
    "ball": "rotation",
    "slide": "slide",
    "free": "free",
}
_PLACING = ["rotation"] * 3 + ["slide"] * 3
"""Joints of one body, sorted, that leave it free."""
_ACTUATED = ("motor", "position", "velocity", "intvelocity", "general", "cylinder", "damper")


def _read(name: str, files: tuple[Path, ...]) -> MachineDraft:
    root = read_xml(files[0], "mujoco")
    model = _Model(root)
    for closing in root.all("equality"):
        model.close_loops(closing)
    model.drive()
    source = f"MuJoCo model {quote(root.attributes.get('model', ''))}, {files[0].name}"
    machine = hexapod(name, source, model.bodies, model.joints, 0, files[0])
    gravity = _gravity(root)
    if not np.any(gravity):
        text = "The model has no gravity; the machine's is taken as 9.81 m/s² along -z."
        return replace(machine, questions=(*machine.questions, Question("gravity", text)))
    return machine if gravity == EARTH_GRAVITY else replace(machine, gravity=gravity)


def _gravity(root: Element) -> tuple[float, ...]:
    gravity: tuple[float, ...] = EARTH_GRAVITY
    for option in root.all("option"):
        if (text := option.attributes.get("gravity")) is not None:
            gravity = tuple(float(value) for value in option.numbers(text, "gravity", 3))
    return gravity


class _Model:
    """Bodies and joints, collected from the tree."""

    def __init__(self, root: Element) -> None:
        _refuse_what_is_not_followed(root)
        self.root = root
        self.attributes = Attributes.of(root)
        self.bodies: list[Link] = [Link("world", WORLD, 0.0, NOTHING)]
        self.joints: list[Joint] = []
        self._numbers = {"world": 0}
        self._sites: dict[str, tuple[int, Array]] = {}
        for world in root.all("worldbody"):
            self._collect(world, 0, WORLD, None)

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
        if sorted(joint.kind for joint in joints) == _PLACING and parent == 0:
            joints = []
            free = True
        else:
            free = any(joint.kind == "free" for joint in joints)
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
            length = float(np.linalg.norm(axis))
            if length == 0:
                raise element.refusal("the axis has no direction", "three numbers, not all zero")
            axes = (place.rotation @ axis / length)[None]
        travel = force = None
        if title == "slide":
            travel = self._range(element, given)
            force = _largest(element, given, "actuatorfrcrange")
        return Joint(
            _KINDS[title], (0, 0), (point, point), axes, element, travel=travel, force=force
        )

    def _range(self, element: Element, given: dict[str, str]) -> tuple[float, float] | None:
        limited = given.get("limited", "auto")
        if "range" not in given or limited == "false":
            return None
        if limited == "auto" and not self.attributes.autolimits:
            return None
        low, high = element.numbers(given["range"], "range", 2)
        reference = float(element.numbers(given.get("ref", "0"), "ref", 1)[0])
        return (float(low) - reference, float(high) - reference) if low < high else None

    def _mass(self, element: Element, inherited: str | None) -> float | None:
        """Return a body's mass; None where it follows from shapes and densities."""
        inertial = element.first("inertial")
        if inertial is not None:
            return float(inertial.numbers(inertial.attributes.get("mass", ""), "mass", 1)[0])
        total = 0.0
        for geom, _ in geoms(element, WORLD, self.attributes):
            given = self.attributes.given(geom, inherited)
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
            ends = self._ends(element, given)
            (first, point), (second, other) = ends
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
            for element in section.all(*_ACTUATED):
                given = self.attributes.given(element)
                force = _largest(element, given, "forcerange")
                if force is None and element.tag == "motor":
                    force = _largest(element, given, "ctrlrange")
                    gear = element.numbers(given.get("gear", "1"), "gear")
                    force = None if force is None else force * abs(float(gear[0]))
                if force is not None and given.get("joint"):
                    forces[given["joint"]] = force
        for i, joint in enumerate(self.joints):
            name = joint.source.attributes.get("name", "")
            if joint.kind == "slide" and joint.force is None and name in forces:
                self.joints[i] = replace(joint, force=forces[name])


def _largest(element: Element, given: dict[str, str], key: str) -> float | None:
    """Return the force of a range that is the same in both directions; None without one."""
    if key not in given:
        return None
    low, high = element.numbers(given[key], key, 2)
    return float(min(-low, high)) if low < 0 < high else None


def _refuse_what_is_not_followed(root: Element) -> None:
    waiting = [root]
    while waiting:
        element = waiting.pop()
        for child in element.children:
            if child.tag in _NOT_FOLLOWED:
                message = f"<{child.tag}> is not followed"
                allowed = "the whole model in one file, as MuJoCo saves it (mj_saveLastXML)"
                raise child.refusal(message, allowed)
        waiting += element.children


def _claims(_path: Path) -> bool:
    return True


FORMAT = MachineFormat("a MuJoCo model (MJCF)", (".xml", ".mjcf"), _claims, _read)
