"""URDF, the format of ROS: a tree of links whose loops are open, or closed by an extension.

A link has the frame of the joint that carries it. Loops are closed by ``<loop_joint>``, or by a
``<joint>`` of SDF inside ``<gazebo>``; else the open ends of the six legs are the joints of the
platform. Source: ROS 2, urdf/XML.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from constraints.arrays import Array
from expdesign.configuration.errors import quote
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
from expdesign.machines.readers.sdf import read_pose
from expdesign.mechanism.bodies import ENTRIES, RigidBody, inertia_of
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.strut import FIXED_AXES

_KINDS: dict[str, Kind] = {
    "revolute": "rotation",
    "continuous": "rotation",
    "spherical": "rotation",
    "ball": "rotation",
    "universal": "rotation",
    "prismatic": "slide",
    "fixed": "fixed",
    "floating": "free",
}
_AXES = {"revolute": 1, "continuous": 1, "prismatic": 1, "universal": 2}
"""Number of axes; the other types have none."""
_DEEPEST = 100
"""Largest number of links in a chain."""
_LIGHT = 0.1
"""Largest mass of a frame without a body, as a share of the heaviest link that it is fixed to."""
_PARALLEL = 1e-3
"""Largest sine of the angle between legs that are parallel."""


def _read(name: str, files: tuple[Path, ...]) -> MachineDraft:
    root = read_xml(files[0], "robot")
    for element in root.children:
        if element.tag.startswith("xacro:"):
            message = f"<{element.tag}> is a macro of xacro, which is not expanded"
            raise element.refusal(message, "the output of `xacro FILE.xacro > FILE.urdf`")
    model = _Tree(root)
    joints = [*model.joints, *model.closures()]
    source = f"URDF model {quote(root.attributes.get('name', ''))}, {files[0].name}"
    slides = [joint for joint in joints if joint.kind == "slide"]
    loops = len(joints) - len(model.links) + 1
    if loops >= ACTUATORS - 1 or len(slides) != ACTUATORS:
        return hexapod(name, source, model.links, joints, model.base, files[0])
    links, closed = model.close_legs(slides)
    machine = hexapod(name, source, links, joints, model.base, files[0], closed)
    axes = np.array([joint.axes[0] for joint in slides])
    if np.max(np.linalg.norm(np.cross(axes, axes[0]), axis=1)) < _PARALLEL:
        text = "The model's legs are parallel and their ends open: where are the platform's joints?"
        questions = (*machine.questions, Question("platform_joints", text))
        return replace(machine, platform_joints=None, home=None, questions=questions)
    text = (
        "The model's legs have open ends: they are the joints of the platform, as they lie where "
        "every joint of the model is zero. Is that home?"
    )
    return replace(machine, questions=(*machine.questions, Question("home", text)))


class _Tree:
    """Links in the world, with all joints at zero, and the joints that carry them."""

    def __init__(self, root: Element) -> None:
        self.root = root
        elements = root.all("link")
        self.numbers = {element.attributes.get("name", ""): i for i, element in enumerate(elements)}
        if "" in self.numbers or len(self.numbers) < len(elements):
            raise root.refusal("a link has no name or one that is taken", "names that differ")
        self._carriers: dict[int, Element] = {}
        for element in root.all("joint"):
            child = self._link(element, "child")
            if child in self._carriers:
                raise element.refusal("two joints carry its child", "one joint for each link")
            self._carriers[child] = element
        places = [self._place(i) for i in range(len(elements))]
        self.links = [
            Link(key, places[i], *_rigid(elements[i], places[i])) for key, i in self.numbers.items()
        ]
        self.joints = [self._joint(element) for element in root.all("joint")]
        roots = [i for i in range(len(elements)) if i not in self._carriers]
        held = len(roots) == 1 and any(
            joint.bodies[0] == roots[0] and joint.kind != "free" for joint in self.joints
        )
        self.base = roots[0] if held else None

    def _link(self, element: Element, side: str) -> int:
        given = element.first(side)
        # Joints of SDF name the link as text.
        name = "" if given is None else given.attributes.get("link", given.text.strip())
        if name not in self.numbers:
            raise element.refusal(f"its {side} {quote(name)} is no link", "a link of the model")
        return self.numbers[name]

    def _place(self, number: int) -> Placement:
        chain: list[Element] = []
        while (carrier := self._carriers.get(number)) is not None:
            chain.append(carrier)
            if len(chain) > _DEEPEST:
                message = f"it carries itself, or is in a chain of more than {_DEEPEST} links"
                raise carrier.refusal(message, "a tree of links")
            number = self._link(carrier, "parent")
        place = WORLD
        for carrier in reversed(chain):
            place = place.then(_pose(carrier, carrier.first("origin")))
        return place

    def _joint(self, element: Element, frame: Placement = WORLD, relative: str = "") -> Joint:
        """Return a joint whose frame is given in that of a link, by default its child."""
        title = element.attributes.get("type", "").strip()
        if title not in _KINDS:
            raise element.refusal(f"the type {quote(title)} is not read", ", ".join(_KINDS))
        ends = self._link(element, "parent"), self._link(element, "child")
        if relative and relative not in self.numbers:
            message = f"its pose is relative to {quote(relative)}"
            raise element.refusal(message, "relative_to a link of the model, or without it")
        place = self.links[self.numbers.get(relative, ends[1])].place.then(frame)
        axes = [_axis(element, tag) for tag in ("axis", "axis2")[: _AXES.get(title, 0)]]
        world = np.array(axes).reshape(-1, 3) @ place.rotation.T
        point = place.origin
        if _KINDS[title] != "slide":
            return Joint(_KINDS[title], ends, (point, point), world, element)
        limit = element.first("limit") or Element("limit", {}, element.file, element.line)
        low, high, force, speed = (
            float(limit.numbers(limit.attributes.get(key, "0"), key, 1)[0])
            for key in ("lower", "upper", "effort", "velocity")
        )
        return Joint(
            "slide",
            ends,
            (point, point),
            world,
            element,
            (low, high) if low < high else None,
            force if force > 0 else None,
            speed if speed > 0 else None,
        )

    def closures(self) -> Iterator[Joint]:
        """Yield the joints of the extensions that close loops."""
        for element in self.root.all("loop_joint"):
            ends = [element.first(tag) for tag in ("link1", "link2")]
            names = ["" if end is None else end.attributes.get("link", "") for end in ends]
            if not set(names) <= set(self.numbers):
                raise element.refusal("it does not name two links", "link1 and link2")
            bodies = self.numbers[names[0]], self.numbers[names[1]]
            points = [
                self.links[body].place.then(_pose(element, end)).origin
                for body, end in zip(bodies, ends, strict=True)
            ]
            kind: Kind = "fixed" if element.attributes.get("type") == "fixed" else "rotation"
            yield Joint(kind, bodies, (points[0], points[1]), np.zeros((0, 3)), element)
        for extension in self.root.all("gazebo"):
            for element in extension.all("joint"):
                yield self._joint(element, *read_pose(element))

    def close_legs(self, slides: list[Joint]) -> tuple[list[Link], list[Joint]]:
        """Return the links with the platform, and joints between it and the legs' open ends.

        The platform is the link that one leg carries and the others do not, or the one that floats;
        without either it is a new link amid the ends.
        """
        chains = [_most_moving(self._chains(slide.bodies[1])) for slide in slides]
        most = min(_count_moving(each[0]) for each in chains)
        depth = min(len(each[-1]) for each in chains if _count_moving(each[0]) == most)
        carried = [
            [one[-1].bodies[1] for one in each if self._reaches_platform(one, most, depth)]
            for each in chains
        ]
        floating = [joint.bodies[1] for joint in self.joints if joint.kind == "free"]
        carriers = [j for j, links in enumerate(carried) if links]
        links, platform = list(self.links), len(self.links)
        if len(carriers) == 1:
            platform = self._main_link(carried[carriers[0]])
        elif floating and self.base is not None:
            platform = floating[0]
        closed, ends = [], list[int]()
        for j, slide in enumerate(slides):
            if [j] == carriers:
                continue
            # A frame that is fixed to one leg only, as that of a sensor, is no end.
            tips = [chain for chain in chains[j] if len(chain) == depth] or chains[j][:1]
            path = min(tips, key=lambda chain: self._distance(slide, chain))
            end = path[-1].bodies[1] if path else slide.bodies[1]
            point, none = links[end].place.origin, np.zeros((0, 3))
            kind: Kind = "fixed" if _turns_fully(path) else "rotation"
            closed.append(Joint(kind, (end, platform), (point, point), none, slide.source))
            ends.append(end)
        if platform == len(links):
            middle = np.mean([links[end].place.origin for end in ends], axis=0)
            links.append(Link("the open ends of the legs", Placement(np.eye(3), middle)))
        return links, closed

    def _chains(self, number: int) -> list[list[Joint]]:
        """Return all chains of joints that a link carries, the empty one included."""
        carried = [joint for joint in self.joints if joint.bodies[0] == number]
        return [[]] + [[one, *chain] for one in carried for chain in self._chains(one.bodies[1])]

    def _reaches_platform(self, chain: list[Joint], most: int, depth: int) -> bool:
        """Return whether a leg's chain of joints goes on where those of the others end.

        A body that is fixed there belongs to the platform if the leg turns at this end.
        """
        if _count_moving(chain) > most:
            return True
        further = len(chain) > depth and self.links[chain[-1].bodies[1]].mass != 0
        return further and _turns_fully(chain)

    def _main_link(self, fixed: list[int]) -> int:
        """Return the first of links that are fixed together which is more than an empty frame."""
        masses = [self.links[link].mass for link in fixed]
        least = _LIGHT * max((mass for mass in masses if mass is not None), default=0.0)
        real = [link for link, m in zip(fixed, masses, strict=True) if m is None or m > least]
        return [*real, fixed[-1]][0]

    def _distance(self, slide: Joint, chain: list[Joint]) -> float:
        """Return the distance of a chain's last link from the axis of a slide, m."""
        end = self.links[chain[-1].bodies[1] if chain else slide.bodies[1]].place.origin
        return float(np.linalg.norm(np.cross(end - slide.points[0], slide.axes[0])))


def _count_moving(chain: list[Joint]) -> int:
    return sum(joint.kind != "fixed" for joint in chain)


def _turns_fully(chain: list[Joint]) -> bool:
    """Return whether a chain of joints turns about more than one direction."""
    axes = np.concatenate([joint.axes for joint in chain] or [np.zeros((0, 3))])
    return len(axes) > 0 and bool(np.linalg.matrix_rank(axes, tol=_PARALLEL) > 1)


def _most_moving(chains: list[list[Joint]]) -> list[list[Joint]]:
    """Return the chains with the most joints that move, the shortest first."""
    most = max(map(_count_moving, chains))
    return sorted((chain for chain in chains if _count_moving(chain) == most), key=len)


def _pose(element: Element, origin: Element | None) -> Placement:
    """Return the placement by the attributes ``xyz`` and ``rpy``."""
    given = {} if origin is None else origin.attributes
    shift, angles = (element.numbers(given.get(k, "0 0 0"), k, 3) for k in ("xyz", "rpy"))
    return Placement(Rotation.from_euler(FIXED_AXES, angles).as_matrix(), shift)


def _axis(element: Element, tag: str) -> Array:
    """Return an axis in the joint's frame, a unit vector; x is URDF's default."""
    given = element.first(tag)
    inner = None if given is None else given.first("xyz")
    text = "1 0 0" if given is None else given.attributes.get("xyz", inner.text if inner else "")
    return element.direction(element.numbers(text, f"<{tag}>", 3), f"<{tag}>")


def _rigid(link: Element, place: Placement) -> tuple[float | None, RigidBody | None]:
    """Return mass and body of a link in the world; None for those that it does not state."""
    inertial = link.first("inertial")
    if inertial is None:
        return (0.0, NOTHING) if not link.children else (None, None)
    mass_of, inertia = inertial.first("mass"), inertial.first("inertia")
    if mass_of is None:
        return None, None
    mass = float(link.numbers(mass_of.attributes.get("value", ""), "<mass>", 1)[0])
    if inertia is None:
        return mass, None
    moments = [
        float(link.numbers(inertia.attributes.get(tag, "0"), tag, 1)[0])
        for tag in (f"i{'xyz'[i]}{'xyz'[j]}" for i, j in ENTRIES)
    ]
    within = place.then(_pose(link, inertial.first("origin")))
    body = RigidBody.of(mass, np.zeros(3), inertia_of(moments))
    return mass, body.placed(within.rotation, within.origin)


FORMAT = MachineFormat("a URDF model", (".urdf",), _read)
