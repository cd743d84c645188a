"""SDF, the format of Gazebo: links, and joints that may close loops.

Poses are x y z roll pitch yaw about fixed axes, in metres and radians; a link is given in
the model's frame, a joint in that of its child link, unless ``relative_to`` names another. Source:
the SDFormat specification, pose frame semantics.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from constraints.arrays import Array
from expdesign.configuration.errors import InputError, quote
from expdesign.machines.closed_loops import hexapod
from expdesign.machines.machine import MachineDraft, MachineFormat
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
from expdesign.mechanism.bodies import ENTRIES, RigidBody, inertia_of
from expdesign.mechanism.strut import FIXED_AXES

_KINDS: dict[str, Kind] = {
    "revolute": "rotation",
    "continuous": "rotation",
    "universal": "rotation",
    "revolute2": "rotation",
    "ball": "rotation",
    "prismatic": "slide",
    "fixed": "fixed",
}
_AXES = {"revolute": 1, "continuous": 1, "universal": 2, "revolute2": 2, "prismatic": 1}
_SLIDES = 6
_AXES_IN_JOINT = (1, 5)
"""First version with axes in the joint's frame instead of the model's."""
_NO_LIMIT = 1e15
_MODEL = "__model__"
_WORLD_NAME = "world"


def _read(name: str, files: tuple[Path, ...]) -> MachineDraft:
    root = read_xml(files[0], "sdf")
    model = _model(root)
    frames = _Frames(model, _version(root))
    links = model.all("link")
    numbers = {link.attributes.get("name", ""): i for i, link in enumerate(links)}
    bodies = [
        Link(key, frames.place(key), _mass(links[i]), _rigid(links[i], frames.place(key)))
        for key, i in numbers.items()
    ]
    numbers[_WORLD_NAME] = len(bodies)
    bodies.append(Link(_WORLD_NAME, WORLD, 0.0, NOTHING))
    joints = [_joint(element, frames, numbers) for element in model.all("joint")]
    held = any(joint.kind == "fixed" and numbers[_WORLD_NAME] in joint.bodies for joint in joints)
    base = numbers[_WORLD_NAME] if held else None
    source = f"SDF model {quote(model.attributes.get('name', ''))}, {files[0].name}"
    return hexapod(name, source, bodies, joints, base, files[0])


def _model(root: Element) -> Element:
    models = [*root.all("model"), *(m for world in root.all("world") for m in world.all("model"))]
    if not models:
        raise root.refusal("there is no <model> in it", "a model with links and joints")

    def slides(model: Element) -> int:
        return sum(j.attributes.get("type") == "prismatic" for j in model.all("joint"))

    chosen = next((model for model in models if slides(model) == _SLIDES), models[0])
    if (nested := next(iter(chosen.all("model", "include")), None)) is not None:
        message = "models in a model are not followed"
        raise nested.refusal(message, "one model with all links and joints")
    return chosen


def _version(root: Element) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in root.attributes["version"].split("."))
    except (KeyError, ValueError):
        raise root.refusal("the version is missing or none", 'version="1.9"') from None


class _Frames:
    """The frames of a model by their names: links, joints and ``<frame>``."""

    def __init__(self, model: Element, version: tuple[int, ...]) -> None:
        self.version = version
        self.elements: dict[str, Element] = {}
        for element in model.all("link", "joint", "frame"):
            name = element.attributes.get("name", "").strip()
            if not name or name in (*self.elements, _WORLD_NAME):
                raise element.refusal("its name is missing or taken", "names that differ")
            self.elements[name] = element
        self._model = _own_pose(model, _WORLD_NAME)
        self._known = {_MODEL: self._model, _WORLD_NAME: WORLD}
        self._open: set[str] = set()

    def place(self, name: str, asking: Element | None = None) -> Placement:
        """Return the placement of a frame in the world."""
        if name in self._known:
            return self._known[name]
        element = self.elements.get(name)
        if element is None or name in self._open:
            reason = "unknown" if element is None else "placed relative to itself"
            at = asking or self.elements.get(name)
            message = f"the frame {quote(name)} is {reason}"
            if at is None:
                raise InputError(message)
            raise at.refusal(message, "a link, joint or frame of the model")
        self._open.add(name)
        pose, relative = read_pose(element)
        if not relative:
            relative = _MODEL
            if element.tag == "joint":
                relative = _end(element, "child")
            elif element.tag == "frame":
                relative = element.attributes.get("attached_to") or _MODEL
        self._known[name] = self.place(relative, element).then(pose)
        self._open.discard(name)
        return self._known[name]

    def axis(self, joint: Element, tag: str) -> Array:
        """Return an axis of a joint in the world, a unit vector."""
        axis = joint.first(tag)
        given = None if axis is None else axis.first("xyz")
        if axis is None or given is None:
            raise joint.refusal(f"<{tag}><xyz> is missing", "three numbers")
        numbers = joint.numbers(given.text, f"<{tag}><xyz>", 3)
        direction = joint.direction(numbers, f"<{tag}><xyz>")
        frame = joint.attributes["name"].strip()
        parent_model = axis.first("use_parent_model_frame")
        if self.version < _AXES_IN_JOINT or (
            parent_model is not None and parent_model.text.strip() in ("1", "true")
        ):
            frame = _MODEL
        frame = given.attributes.get("expressed_in") or frame
        return self.place(frame, joint).rotation @ direction


def read_pose(element: Element) -> tuple[Placement, str]:
    """Return the pose of an element, and the name of the frame that it is relative to."""
    pose = element.first("pose")
    if pose is None:
        return WORLD, ""
    relative = pose.attributes.get("relative_to") or pose.attributes.get("frame") or ""
    if pose.attributes.get("rotation_format") == "quat_xyzw":
        numbers = element.numbers(pose.text, "<pose>", 7)
        if not np.any(numbers[3:]):
            raise element.refusal("<pose> has a quaternion of zeros", "x y z w")
        return Placement(Rotation.from_quat(numbers[3:]).as_matrix(), numbers[:3]), relative
    if not pose.text.strip():
        return WORLD, relative
    numbers = element.numbers(pose.text, "<pose>", 6)
    degrees = pose.attributes.get("degrees", "false").strip() in ("1", "true")
    turned = Rotation.from_euler(FIXED_AXES, numbers[3:], degrees)
    return Placement(turned.as_matrix(), numbers[:3]), relative


def _own_pose(element: Element, frame: str) -> Placement:
    """Return the pose of an element in a frame, the only one that it may be relative to."""
    pose, relative = read_pose(element)
    if relative not in ("", frame):
        message = f"its pose is relative to {quote(relative)}"
        raise element.refusal(message, f"a pose in the frame {quote(frame)}")
    return pose


def _joint(element: Element, frames: _Frames, numbers: dict[str, int]) -> Joint:
    title = element.attributes.get("type", "").strip()
    if title not in _KINDS:
        raise element.refusal(f"the type {quote(title)} is not read", ", ".join(_KINDS))
    ends = []
    for side in ("parent", "child"):
        name = _end(element, side)
        if name not in numbers:
            raise element.refusal(f"its {side} {quote(name)} is no link", "a link of the model")
        ends.append(numbers[name])
    point = frames.place(element.attributes["name"].strip()).origin
    # Models that split a cardan joint into two declare `revolute2` and state one axis.
    tags = [
        tag
        for tag in ("axis", "axis2")[: _AXES.get(title, 0)]
        if tag == "axis" or element.first(tag) is not None
    ]
    axes = np.array([frames.axis(element, tag) for tag in tags]).reshape(-1, 3)
    axis = element.first("axis") if title == "prismatic" else None
    limit = None if axis is None else axis.first("limit")
    low, high = (_limit(element, limit, tag) for tag in ("lower", "upper"))
    travel = (low, high) if low is not None and high is not None and low < high else None
    force, speed = (_limit(element, limit, tag) for tag in ("effort", "velocity"))
    return Joint(
        _KINDS[title],
        (ends[0], ends[1]),
        (point, point),
        axes,
        element,
        travel,
        force if force is not None and force > 0 else None,
        speed if speed is not None and speed > 0 else None,
    )


def _end(joint: Element, side: str) -> str:
    given = joint.first(side)
    name = "" if given is None else given.text.strip()
    if not name:
        raise joint.refusal(f"<{side}> is missing", "the name of a link")
    return name


def _limit(joint: Element, limit: Element | None, tag: str) -> float | None:
    """Return a limit; None for one that is missing or so large that it is none."""
    given = None if limit is None else limit.first(tag)
    if given is None or not given.text.strip():
        return None
    try:
        value = float(given.text)
    except ValueError:
        value = math.nan
    if math.isnan(value):
        raise joint.refusal(f"<{tag}> is {quote(given.text.strip())}", "a number")
    return value if abs(value) < _NO_LIMIT else None


def _mass(link: Element) -> float | None:
    inertial = link.first("inertial")
    given = None if inertial is None else inertial.first("mass")
    return None if given is None else float(link.numbers(given.text, "<mass>", 1)[0])


def _rigid(link: Element, place: Placement) -> RigidBody | None:
    """Return a link in the world; None without its mass or moments of inertia."""
    mass, inertial = _mass(link), link.first("inertial")
    inertia = None if inertial is None else inertial.first("inertia")
    if mass is None or inertial is None or inertia is None:
        return None
    moments = []
    for i, j in ENTRIES:
        tag = f"i{'xyz'[i]}{'xyz'[j]}"
        given = inertia.first(tag)
        if given is None and i == j:
            return None
        value = 0.0 if given is None else float(inertia.numbers(given.text, f"<{tag}>", 1)[0])
        moments.append(value)
    within = place.then(_own_pose(inertial, link.attributes.get("name", "")))
    body = RigidBody.of(mass, np.zeros(3), inertia_of(moments))
    return body.placed(within.rotation, within.origin)


FORMAT = MachineFormat("an SDF model", (".sdf", ".world"), _read)
