"""Bodies and joints of a simulator's model, and its XML file as elements with their lines.

Everything is in one frame, the world's, in the pose of the model as it is written; the mechanism
may have closed loops.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from xml.parsers import expat

import numpy as np
from pydantic import ValidationError
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from constraints.arrays import Array
from expdesign.configuration.bodies import Bodies, BodyDescription
from expdesign.configuration.document import read_text
from expdesign.configuration.errors import InputError, quote
from expdesign.machines.machine import Question, round_digits
from expdesign.mechanism.bodies import ENTRIES, RigidBody, together

_DEEPEST = 100


@dataclass
class Element:
    """An element of an XML file."""

    tag: str
    attributes: dict[str, str]
    file: Path
    line: int
    children: list[Element] = field(default_factory=list)
    text: str = ""

    @property
    def label(self) -> str:
        """Tag and name for messages: ``<joint name='leg1'>``."""
        name = self.attributes.get("name")
        return f"<{self.tag}>" if name is None else f"<{self.tag} name={quote(name)}>"

    def all(self, *tags: str) -> list[Element]:
        """Return the children with these tags, in the order of the file."""
        return [child for child in self.children if child.tag in tags]

    def first(self, tag: str) -> Element | None:
        """Return the first child with a tag; None without one."""
        return next(iter(self.all(tag)), None)

    def refusal(self, message: str, allowed: str | None = None) -> InputError:
        """Return an error of the element."""
        return InputError(message, self.file, self.line, self.label, allowed)

    def numbers(self, text: str, what: str, *counts: int) -> Array:
        """Return the finite numbers of a text; refuse any other text or count."""
        try:
            values = np.array([float(word) for word in text.split()])
        except ValueError:
            values = np.array([np.nan])
        if not np.all(np.isfinite(values)) or (counts and len(values) not in counts):
            many = " or ".join(str(count) for count in counts) or "some"
            raise self.refusal(f"{what} is {quote(text.strip())}", f"{many} finite numbers")
        return values

    def direction(self, vector: Array, what: str) -> Array:
        """Return the unit vector along a vector; refuse zero."""
        length = float(np.linalg.norm(vector))
        if length == 0:
            raise self.refusal(f"{what} has no direction", "numbers that are not all zero")
        return np.asarray(vector / length)


def read_xml(file: Path, root: str) -> Element:
    """Return the root element of an XML file, of the name `root`."""
    text = read_text(file, "XML in UTF-8")
    top = Element("", {}, file, 0)
    unclosed, parser = [top], expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        if len(unclosed) > _DEEPEST:
            raise InputError("the elements are nested too deeply", file, parser.CurrentLineNumber)
        element = Element(tag, attributes, file, parser.CurrentLineNumber)
        unclosed[-1].children.append(element)
        unclosed.append(element)

    def add_text(text: str) -> None:
        unclosed[-1].text += text

    def refuse_declaration(*_declared: object) -> None:
        message, line = "the file declares a document type or entities", parser.CurrentLineNumber
        raise InputError(message, file, line, allowed="XML without <!DOCTYPE …>")

    parser.buffer_text = True
    parser.StartElementHandler = start
    parser.EndElementHandler = lambda _tag: unclosed.pop()
    parser.CharacterDataHandler = add_text
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse_declaration
    try:
        parser.Parse(text.encode(), True)
    except expat.ExpatError as error:
        message = f"not valid XML: {expat.errors.messages[error.code]}"
        raise InputError(message, file, error.lineno) from None
    found = top.children[0]
    if found.tag != root:
        raise InputError(f"the file holds <{found.tag}>", file, found.line, allowed=f"<{root}>")
    return found


Kind = Literal["fixed", "rotation", "slide", "free"]


@dataclass(frozen=True)
class Placement:
    """A frame in another one."""

    rotation: Array
    """(3, 3), takes vectors of the frame into the other one."""
    origin: Array
    """(3,), m."""

    def point(self, local: Array) -> Array:
        """Return points of the frame, (3,) or (n, 3), in the other one."""
        return self.origin + local @ self.rotation.T

    def local(self, point: Array) -> Array:
        """Return points of the other frame, (3,) or (n, 3), in this one."""
        return (point - self.origin) @ self.rotation

    def then(self, inner: Placement) -> Placement:
        """Return the placement of a frame that is given in this one."""
        return Placement(self.rotation @ inner.rotation, self.point(inner.origin))


WORLD = Placement(np.eye(3), np.zeros(3))
NOTHING = together(())
"""A body without mass."""


@dataclass(frozen=True)
class Link:
    """A rigid body."""

    name: str
    place: Placement
    """In the world."""
    mass: float | None = None
    """kg; None: not stated."""
    rigid: RigidBody | None = None
    """In the world; None: not stated in full."""


@dataclass(frozen=True)
class Joint:
    """A joint between two links, given by their numbers."""

    kind: Kind
    bodies: tuple[int, int]
    """In a tree the first one carries the second."""
    points: tuple[Array, Array]
    """Location of the joint on the first and on the second body, in the world, (3,), m. They differ
    for an open loop of the model."""
    axes: Array
    """(n, 3), unit vectors in the world: one for a slide, those of a rotation in the order from the
    first body to the second; none: any axis."""
    source: Element
    travel: tuple[float, float] | None = None
    """Range of a slide from the model's pose, m; the second body moves along the axis."""
    force: float | None = None
    """Largest force of a slide, N."""
    speed: float | None = None
    """Largest speed of a slide, m/s."""


Groups = Sequence[int]
"""Number of the group of each body; bodies of a group do not move against each other."""


def rigid_groups(count: int, joints: Iterable[Joint]) -> Groups:
    """Return the groups of bodies that joints fix to each other."""
    pairs = np.array([joint.bodies for joint in joints if joint.kind == "fixed"], dtype=int)
    graph = coo_array((np.ones(len(pairs)), pairs.reshape(-1, 2).T), shape=(count, count))
    groups: list[int] = connected_components(graph, directed=False)[1].tolist()
    return groups


@dataclass(frozen=True)
class PathStep:
    """A joint on a path from one group to another."""

    joint: Joint
    forward: bool
    """True from its first body to its second."""

    @property
    def near(self) -> Array:
        """Point of the joint on the earlier body of the path, world, (3,), m."""
        return self.joint.points[0 if self.forward else 1]

    @property
    def far(self) -> Array:
        """Point of the joint on the later body."""
        return self.joint.points[1 if self.forward else 0]


class Rotations:
    """The groups as nodes of a graph, with the rotating joints as edges."""

    def __init__(self, groups: Groups, joints: Sequence[Joint]) -> None:
        self.edges: dict[int, list[tuple[int, PathStep]]] = {}
        for joint in joints:
            if joint.kind != "rotation":
                continue
            first, second = (groups[body] for body in joint.bodies)
            self.edges.setdefault(first, []).append((second, PathStep(joint, True)))
            self.edges.setdefault(second, []).append((first, PathStep(joint, False)))

    def paths(self, start: int) -> dict[int, tuple[PathStep, ...]]:
        """Return the shortest paths from a group to every connected one, itself included."""
        found: dict[int, tuple[PathStep, ...]] = {start: ()}
        waiting = [start]
        for node in waiting:
            for other, step in self.edges.get(node, []):
                if other not in found:
                    found[other] = (*found[node], step)
                    waiting.append(other)
        return found


_ALIKE = 0.01
"""Smallest relative difference between struts for a question."""
_ROUNDING = 1e-12
"""Share of a body's largest numbers that is none."""


StrutPart = tuple[Sequence[int], Array, Array]
"""Groups of links of a ring, stator or slider, with axes (3, 3) and origin (3,) of its frame in the
world, m."""


def moved_bodies(
    links: Sequence[Link],
    groups: Groups,
    struts: Sequence[Sequence[StrutPart]],
    platform: tuple[int, Placement],
    questions: list[Question],
) -> Bodies | None:
    """Return the bodies, those of a strut as the mean of all; None without a complete one.

    Each strut has its ring, stator and slider.
    """
    parts: dict[str, tuple[BodyDescription, ...]] = {}
    found = [_of_strut(links, groups, strut) for strut in struts]
    known = [one for one in found if one is not None]
    if len(known) == len(found):
        for k, part in enumerate(("ring", "stator", "slider")):
            each = [one[k] for one in known]
            parts[part] = _robot_file_body(part, _mean(each), questions)
            if parts[part] and _apart(each) > _ALIKE:
                text = f"The {part}s of the struts differ; this is their mean. Is it correct?"
                questions.append(Question("bodies", text))
    group, place = platform
    plate = _group(links, groups, (group,))
    if plate is not None:
        inverse = place.rotation.T
        moved = plate.placed(inverse, -inverse @ place.origin)
        parts["platform"] = _robot_file_body("platform", moved, questions)
    parts = {part: bodies for part, bodies in parts.items() if bodies}
    return Bodies(**parts) if parts else None


def _of_strut(
    links: Sequence[Link], groups: Groups, strut: Sequence[StrutPart]
) -> list[RigidBody] | None:
    """Return the parts of a strut in their frames; None if one is incomplete."""
    found = []
    for members, axes, at in strut:
        if (body := _group(links, groups, members)) is None:
            return None
        found.append(body.placed(axes, -axes @ at))
    return found


def _group(links: Sequence[Link], groups: Groups, members: Iterable[int]) -> RigidBody | None:
    wanted = set(members)
    found = [link.rigid for link, group in zip(links, groups, strict=True) if group in wanted]
    known = [body for body in found if body is not None]
    return together(known) if len(known) == len(found) else None


def _mean(bodies: Sequence[RigidBody]) -> RigidBody:
    whole, count = together(bodies), len(bodies)
    return RigidBody(whole.mass / count, whole.moment / count, whole.inertia / count)


def _apart(bodies: Sequence[RigidBody]) -> float:
    """Return the largest deviation from the mean body, as a share of its mass and extent."""
    mean = _mean(bodies)
    if mean.mass == 0:
        return 0.0
    largest = float(np.max(np.abs(mean.inertia)))
    sizes = {"mass": mean.mass, "moment": np.sqrt(mean.mass * largest), "inertia": largest}
    return max(
        float(np.max(np.abs(getattr(body, name) - getattr(mean, name)))) / size
        for body in bodies
        for name, size in sizes.items()
        if size > 0
    )


def _robot_file_body(
    part: str, body: RigidBody, questions: list[Question]
) -> tuple[BodyDescription, ...]:
    """Return a body of the robot file, without rounding errors.

    Empty for a body without mass, and for a physically impossible one, which becomes a question.
    """
    if body.mass <= 0:
        return ()
    centre, inertia = body.moment / body.mass, body.about_centre
    size = max(float(np.max(np.abs(body.inertia))), _ROUNDING)
    try:
        found = BodyDescription(
            mass=round_digits(body.mass),
            centre=tuple(_clean(centre, np.sqrt(size / body.mass))),
            inertia=tuple(_clean(inertia[tuple(np.transpose(ENTRIES))], size)),
        )
    except ValidationError:
        text = f"No body has the mass and the inertia of the {part} in the model: left out."
        questions.append(Question("bodies", text))
        return ()
    return (found,)


def _clean(values: Array, size: float) -> list[float]:
    return [round_digits(v) if abs(v) > _ROUNDING * size else 0.0 for v in values.tolist()]
