"""The bodies of a hexapod out of those of a simulator's model, in the frames of docs/model.md."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import ValidationError

from constraints.arrays import Array
from expdesign.configuration.bodies import Bodies, Body
from expdesign.mechanism.bodies import ENTRIES, RigidBody, together
from expdesign.robotfile.machine import Question
from expdesign.robotfile.mechanism_graph import Body as Link
from expdesign.robotfile.mechanism_graph import Groups, Placement
from expdesign.robotfile.quantities import rounded

_ALIKE = 0.01
"""Difference of struts that is told, as a share."""
_ROUNDING = 1e-12
"""Share of a body's largest numbers that is none."""


@dataclass(frozen=True)
class StrutParts:
    """Groups of bodies of one strut, and where it stands in the world."""

    rings: tuple[int, ...]
    stator: int
    sliders: tuple[int, ...]
    """With what the joints at the platform are made of."""
    foot: Array
    """(3,), A, m."""
    head: Array
    """(3,), B on the strut, m."""
    first_axis: Array
    """(3,), e_α, unit."""
    along: Array
    """(3,), u, unit."""


def moved_bodies(
    links: Sequence[Link],
    groups: Groups,
    struts: Sequence[StrutParts],
    platform: tuple[int, Placement],
    questions: list[Question],
) -> Bodies | None:
    """Return the bodies, those of a strut as the mean of all; None where none is stated in full.

    Parameters
    ----------
    platform : group and its frame
        Of the platform.
    questions : list of Question
        To which is added what the struts do not have in common.
    """
    parts: dict[str, tuple[Body, ...]] = {}
    found = [_of_strut(links, groups, strut) for strut in struts]
    known = [one for one in found if one is not None]
    if len(known) == len(found):
        for k, part in enumerate(("ring", "stator", "slider")):
            each = [one[k] for one in known]
            parts[part] = _written(part, _mean(each), questions)
            if parts[part] and _apart(each) > _ALIKE:
                text = (
                    f"The {part}s of the struts differ: the mean of the six stands here. Is it so?"
                )
                questions.append(Question("bodies", text))
    group, place = platform
    plate = _group(links, groups, (group,))
    if plate is not None:
        inverse = place.rotation.T
        moved = plate.placed(inverse, -inverse @ place.origin)
        parts["platform"] = _written("platform", moved, questions)
    parts = {part: bodies for part, bodies in parts.items() if bodies}
    return Bodies(**parts) if parts else None


def _of_strut(
    links: Sequence[Link], groups: Groups, strut: StrutParts
) -> tuple[RigidBody, RigidBody, RigidBody] | None:
    """Return ring, stator and slider in their frames; None where one is not stated in full."""
    second = np.cross(strut.along, strut.first_axis)
    second = second / np.linalg.norm(second)
    of_strut = np.stack([np.cross(second, strut.along), second, strut.along])
    of_ring = np.stack([strut.first_axis, second, np.cross(strut.first_axis, second)])
    found = [
        None if (body := _group(links, groups, members)) is None else body.placed(axes, -axes @ at)
        for members, axes, at in (
            (strut.rings, of_ring, strut.foot),
            ((strut.stator,), of_strut, strut.foot),
            (strut.sliders, of_strut, strut.head),
        )
    ]
    ring, stator, slider = found
    if ring is None or stator is None or slider is None:
        return None
    return ring, stator, slider


def _group(links: Sequence[Link], groups: Groups, members: Iterable[int]) -> RigidBody | None:
    wanted = set(members)
    found = [link.rigid for i, link in enumerate(links) if groups.of(i) in wanted]
    known = [body for body in found if body is not None]
    return together(known) if len(known) == len(found) else None


def _mean(bodies: Sequence[RigidBody]) -> RigidBody:
    whole, count = together(bodies), len(bodies)
    return RigidBody(whole.mass / count, whole.moment / count, whole.inertia / count)


def _apart(bodies: Sequence[RigidBody]) -> float:
    """Return how much bodies differ from their mean, as a share of its mass and extent."""
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


def _written(part: str, body: RigidBody, questions: list[Question]) -> tuple[Body, ...]:
    """Return a body as it stands in a robot file, without the noise of its last digits.

    Nothing for one without mass, and for one that cannot be, which is asked about.
    """
    if body.mass <= 0:
        return ()
    centre, inertia = body.moment / body.mass, body.about_centre
    size = max(float(np.max(np.abs(body.inertia))), _ROUNDING)
    try:
        found = Body(
            mass=rounded(body.mass),
            centre=tuple(_clean(centre, np.sqrt(size / body.mass))),
            inertia=tuple(_clean(inertia[tuple(np.transpose(ENTRIES))], size)),
        )
    except ValidationError:
        text = f"No body has the mass and the inertia of the {part} in the model: left out."
        questions.append(Question("bodies", text))
        return ()
    return (found,)


def _clean(values: Array, size: float) -> list[float]:
    return [rounded(v) if abs(v) > _ROUNDING * size else 0.0 for v in values.tolist()]
