"""Bodies and joints of a simulator's model, as they stand where the model is written.

Everything is in one frame, the world's; the mechanism may have closed loops.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from constraints.arrays import Array
from expdesign.mechanism.bodies import RigidBody, together
from expdesign.robotfile.xml_document import Element

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
        """Return where a frame is that is placed in this one."""
        return Placement(self.rotation @ inner.rotation, self.point(inner.origin))


WORLD = Placement(np.eye(3), np.zeros(3))
NOTHING = together(())
"""A body without mass."""


@dataclass(frozen=True)
class Body:
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
    """What connects two bodies, by their numbers."""

    kind: Kind
    bodies: tuple[int, int]
    """The first of them carries the second where there is such an order."""
    points: tuple[Array, Array]
    """Where the joint is: a point of the first and one of the second body, in the world, (3,), m.
    They differ where the model is written with a loop that is not closed."""
    axes: Array
    """(n, 3), unit vectors in the world: of a slide, one; of a rotation those it turns about, in
    the order from the first body to the second; none: about any."""
    source: Element
    travel: tuple[float, float] | None = None
    """Of a slide: its ends from where it stands, m; the second body moves along the axis."""
    force: float | None = None
    """Of a slide: the largest, N."""
    speed: float | None = None
    """Of a slide: the largest, m/s."""


class Groups:
    """Bodies that do not move against each other, under the number of one of them."""

    def __init__(self, count: int, joints: Iterable[Joint]) -> None:
        self._leader = list(range(count))
        for joint in joints:
            if joint.kind == "fixed":
                first, second = (self.of(body) for body in joint.bodies)
                self._leader[max(first, second)] = min(first, second)

    def of(self, body: int) -> int:
        """Return the group of a body."""
        while self._leader[body] != body:
            body = self._leader[body]
        return body


@dataclass(frozen=True)
class Step:
    """A joint on a path from one group to another, and the way it is gone through."""

    joint: Joint
    forward: bool
    """From its first body to its second."""

    @property
    def near(self) -> Array:
        """The joint's point on the body that the path comes from."""
        return self.joint.points[0 if self.forward else 1]

    @property
    def far(self) -> Array:
        """The joint's point on the body that the path goes to."""
        return self.joint.points[1 if self.forward else 0]


class Rotations:
    """The groups as nodes of a graph whose edges are the joints that turn."""

    def __init__(self, groups: Groups, joints: Sequence[Joint]) -> None:
        self.edges: dict[int, list[tuple[int, Step]]] = {}
        for joint in joints:
            if joint.kind != "rotation":
                continue
            first, second = (groups.of(body) for body in joint.bodies)
            self.edges.setdefault(first, []).append((second, Step(joint, True)))
            self.edges.setdefault(second, []).append((first, Step(joint, False)))

    def paths(self, start: int) -> dict[int, tuple[Step, ...]]:
        """Return the shortest paths from a group to every one that is reached, itself included."""
        found: dict[int, tuple[Step, ...]] = {start: ()}
        waiting = [start]
        for node in waiting:
            for other, step in self.edges.get(node, []):
                if other not in found:
                    found[other] = (*found[node], step)
                    waiting.append(other)
        return found
