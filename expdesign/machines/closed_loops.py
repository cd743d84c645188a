"""A hexapod in a mechanism of bodies and joints: six slides between a base and a platform.

At each of its ends a slide is held by joints that turn about axes through one point: a cardan or a
ball joint, put together from whatever joints the model has there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from constraints.arrays import Array
from expdesign.configuration.errors import InputError
from expdesign.machines.machine import MachineDraft, Question, rows
from expdesign.machines.mechanism_graph import (
    Groups,
    Joint,
    Link,
    PathStep,
    Rotations,
    StrutParts,
    moved_bodies,
)
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.strut import ANGLES

_ALLOWED = (
    "six struts, each with one sliding joint between a cardan or ball joint on the base and one on "
    "the platform"
)
_MISSED = 1e-4
"""Distance of axes that count as meeting, of the machine's size: what round_digits files leave."""
_FAR_APART = 2e-2
"""Largest such distance that is accepted; the robot file then has a question."""
_PARALLEL = 1e-6
"""Smallest eigenvalue of the sum of projectors along which a point is not determined."""
_ASIDE = 2e-2
"""Sine of the angle between a slide and the line between the joints that counts as none."""
_OPEN = 1e-4
"""Distance of a loop's ends that counts as closed, of the length at home: round_digits files."""


@dataclass(frozen=True)
class _End:
    """One end of a strut."""

    hub: Array
    """The joint's point on the base or the platform, world, (3,), m."""
    leg: Array
    """The same on the strut."""
    first_axis: Array | None
    """The axis that is fixed in base or platform, world, (3,); None for a ball joint."""
    missed: float
    """How far the axes of its joints are from meeting, m."""


def hexapod(
    name: str,
    source: str,
    bodies: Sequence[Link],
    joints: Sequence[Joint],
    base: int | None,
    file: Path,
) -> MachineDraft:
    """Return the hexapod that a mechanism is; struts are numbered in the order of their slides."""
    groups = Groups(len(bodies), joints)
    slides = [joint for joint in joints if joint.kind == "slide"]
    if len(slides) != ACTUATORS:
        message = f"the model has {len(slides)} sliding joints beside those that place the platform"
        raise InputError(message, file, allowed=_ALLOWED)
    rotations = Rotations(groups, joints)
    below = rotations.paths(groups.of(slides[0].bodies[0]) if base is None else groups.of(base))
    base_group = _hub(below, rotations) if base is None else groups.of(base)
    below = rotations.paths(base_group)
    lower = [_inner(slide, groups, below) for slide in slides]
    above = rotations.paths(groups.of(slides[0].bodies[1 - lower[0]]))
    platform_group = _hub(above, rotations)
    above = rotations.paths(platform_group)
    feet, heads = [], []
    for slide, end in zip(slides, lower, strict=True):
        tip = groups.of(slide.bodies[1 - end])
        if tip not in above or tip in below:
            raise slide.source.refusal("it does not connect base and platform", _ALLOWED)
        feet.append(_end(slide, below[groups.of(slide.bodies[end])], "base"))
        heads.append(_end(slide, above[tip], "platform"))
    platform = _platform_body(platform_group, groups, bodies, joints)
    place = bodies[platform].place
    questions = [
        Question(
            "",
            f"Taken as base: {_names_of(base_group, groups, bodies)}; as platform: "
            f"{bodies[platform].name}, whose frame is the TCP's. Strut 1 is "
            f"{slides[0].source.label} in line {slides[0].source.line}; the others follow as in "
            "the file.",
        )
    ]
    _ask_missed(slides, feet, heads, questions)
    limits = _limits(slides, lower, feet, heads, questions)
    closed = _are_loops_closed(feet, heads, questions)
    mass = _mass(platform_group, groups, bodies, questions)
    struts = [
        _parts(slide, end, (foot, head), (below, above), groups)
        for slide, end, foot, head in zip(slides, lower, feet, heads, strict=True)
    ]
    moved = moved_bodies(bodies, groups, struts, (platform_group, place), questions)
    angles = Rotation.from_matrix(place.rotation).as_euler(ANGLES) + 0.0
    return MachineDraft(
        name=name,
        source=source,
        base_joints=rows(np.array([end.hub for end in feet])),
        platform_joints=rows(place.local(np.array([end.hub for end in heads]))),
        home=(*rows(place.origin[None])[0], *angles.tolist()) if closed else None,
        alpha_axes=_alpha_axes(feet),
        limits=limits,
        moved_mass=mass,
        bodies=moved,
        questions=tuple(questions),
    )


def _hub(paths: dict[int, tuple[PathStep, ...]], rotations: Rotations) -> int:
    """Return the group that most joints hold."""
    return max(paths, key=lambda group: len(rotations.edges.get(group, [])))


def _inner(slide: Joint, groups: Groups, below: dict[int, tuple[PathStep, ...]]) -> int:
    """Return which of a slide's two bodies is on the side of the base."""
    for end in (0, 1):
        if groups.of(slide.bodies[end]) in below:
            return end
    raise slide.source.refusal("no joints that turn connect it with the base", _ALLOWED)


def _end(slide: Joint, path: tuple[PathStep, ...], where: str) -> _End:
    """Return the end of a strut that a path of joints from base or platform leads to."""
    if not path:
        raise slide.source.refusal(f"it is fixed to the {where}", _ALLOWED)
    (hub, missed), (leg, _) = (_meeting(slide, path, where, on_hub) for on_hub in (True, False))
    axes = path[0].joint.axes
    first = axes[0 if path[0].forward else -1] if len(axes) else None
    return _End(hub, leg, first, missed)


def _meeting(
    slide: Joint, path: tuple[PathStep, ...], where: str, on_hub: bool
) -> tuple[Array, float]:
    """Return the point that the axes of joints meet in, (3,), m, by least squares of distances.

    The largest of these distances, m, comes with it.
    """
    matrix, right = np.zeros((3, 3)), np.zeros(3)
    lines = []
    for step in path:
        point = step.near if on_hub else step.far
        across: Array = np.eye(3)
        if len(step.joint.axes) == 1:
            across = across - np.outer(step.joint.axes[0], step.joint.axes[0])
        lines.append((point, across))
        matrix += across
        right += across @ point
    if np.linalg.eigvalsh(matrix)[0] < _PARALLEL:
        message = f"its joints at the {where} turn about one direction only"
        raise slide.source.refusal(message, _ALLOWED)
    meeting: Array = np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    missed = max(float(np.linalg.norm(across @ (meeting - point))) for point, across in lines)
    return meeting, missed


def _parts(
    slide: Joint,
    end: int,
    ends: tuple[_End, _End],
    paths: tuple[dict[int, tuple[PathStep, ...]], dict[int, tuple[PathStep, ...]]],
    groups: Groups,
) -> StrutParts:
    """Return what a strut is made of; `end` is which of the slide's bodies is at the base."""
    (foot, head), (below, above) = ends, paths
    stator, slider = (groups.of(slide.bodies[k]) for k in (end, 1 - end))
    rings, lugs = (
        [groups.of(step.joint.bodies[1 if step.forward else 0]) for step in path[:-1]]
        for path in (below[stator], above[slider])
    )
    along, _ = _direction(slide, end, foot, head)
    first = foot.first_axis
    if first is None or np.linalg.norm(np.cross(first, along)) < _PARALLEL:
        first = foot.hub * [1.0, 1.0, 0.0]
    if np.linalg.norm(np.cross(first, along)) < _PARALLEL:
        first = np.eye(3)[int(np.argmin(np.abs(along)))]
    first = first / np.linalg.norm(first)
    return StrutParts(tuple(rings), stator, (slider, *lugs), foot.leg, head.leg, first, along)


def _direction(slide: Joint, end: int, foot: _End, head: _End) -> tuple[Array, int]:
    """Return the slide's axis from the base to the platform, and 1 where it extends the strut.

    -1 where it shortens it. One that is written without length extends along the axis.
    """
    axis = slide.axes[0] * (1 if end == 0 else -1)
    backwards = axis @ (head.leg - foot.leg) < -_OPEN * np.linalg.norm(head.hub - foot.hub)
    return (-axis, -1) if backwards else (axis, 1)


def _limits(
    slides: list[Joint],
    lower: list[int],
    feet: list[_End],
    heads: list[_End],
    questions: list[Question],
) -> dict[str, object]:
    """Return the limits of the struts; what is missing for one of them is asked for all."""
    lengths: list[tuple[float, float]] = []
    for slide, end, foot, head in zip(slides, lower, feet, heads, strict=True):
        along = head.leg - foot.leg
        apart = max(float(np.linalg.norm(v)) for v in (along, head.hub - foot.hub))
        axis, outward = _direction(slide, end, foot, head)
        if np.linalg.norm(np.cross(axis, along)) > _ASIDE * apart:
            message = "it does not slide along the line between the strut's joints"
            raise slide.source.refusal(message, _ALLOWED)
        if slide.travel is None:
            continue
        travel = np.array(slide.travel) * outward
        ends = axis @ along + np.sort(travel)
        if ends[1] > 0:
            lengths.append((max(float(ends[0]), 0.0), float(ends[1])))
    limits: dict[str, object] = {}
    found: tuple[tuple[str, list[object], str], ...] = (
        ("strut_length", list(lengths), "range"),
        ("actuator_force", [s.force for s in slides if s.force is not None], "largest force"),
        ("strut_speed", [s.speed for s in slides if s.speed is not None], "largest speed"),
    )
    for key, values, words in found:
        if len(values) == ACTUATORS:
            limits[key] = values[0] if len(set(values)) == 1 else tuple(values)
        else:
            text = f"The model does not state the {words} of every strut: what is it?"
            questions.append(Question(f"limits.{key}", text))
    return limits


def _ask_missed(
    slides: list[Joint], feet: list[_End], heads: list[_End], questions: list[Question]
) -> None:
    """Ask about axes that nearly meet; refuse struts whose axes do not."""
    hubs = np.array([end.hub for end in (*feet, *heads)])
    size = float(np.max(np.ptp(hubs, axis=0)))
    for ends, where in ((feet, "base"), (heads, "platform")):
        j = int(np.argmax([end.missed for end in ends]))
        far = ends[j].missed
        if far > _FAR_APART * size:
            message = f"the axes of its joints at the {where} miss each other by {far * 1e3:.3g} mm"
            raise slides[j].source.refusal(message, "axes that meet in one point")
        if far > _MISSED * size:
            text = (
                f"The axes of the joints at the {where} miss each other by up to "
                f"{far * 1e3:.3g} mm, those of strut {j + 1}: the points amid them stand here. "
                "Where do they meet?"
            )
            questions.append(Question(f"{where}_joints", text))


def _are_loops_closed(feet: list[_End], heads: list[_End], questions: list[Question]) -> bool:
    """Return whether the loops are closed in the model's own pose."""
    for j, ends in enumerate(zip(feet, heads, strict=True), 1):
        gap = max(float(np.linalg.norm(end.hub - end.leg)) for end in ends)
        if gap > _OPEN * float(np.linalg.norm(ends[1].hub - ends[0].hub)):
            text = (
                f"Where the model is written strut {j} misses its joint by {gap * 1e3:.3g} mm: "
                "that pose of the platform is no home. Where is it at home?"
            )
            questions.append(Question("home", text))
            return False
    return True


def _alpha_axes(feet: list[_End]) -> tuple[tuple[float, ...], ...] | None:
    axes = [end.first_axis for end in feet if end.first_axis is not None]
    return rows(np.array(axes)) if len(axes) == ACTUATORS else None


def _mass(
    group: int, groups: Groups, bodies: Sequence[Link], questions: list[Question]
) -> float | None:
    masses = [body.mass for i, body in enumerate(bodies) if groups.of(i) == group]
    known = [mass for mass in masses if mass is not None]
    if len(known) == len(masses) and sum(known) > 0:
        return float(sum(known))
    text = "The model does not state the mass of every body of the platform: what is moved?"
    questions.append(Question("moved_mass", text))
    return None


def _platform_body(
    group: int, groups: Groups, bodies: Sequence[Link], joints: Sequence[Joint]
) -> int:
    """Return the body of a group that most joints hold; the heaviest, where each holds another."""
    members = [i for i in range(len(bodies)) if groups.of(i) == group]
    held = [body for joint in joints if joint.kind == "rotation" for body in joint.bodies]
    most = max(held.count(member) for member in members)
    return max(members, key=held.count if most > 1 else lambda i: bodies[i].mass or 0.0)


def _names_of(group: int, groups: Groups, bodies: Sequence[Link]) -> str:
    names = [body.name for i, body in enumerate(bodies) if groups.of(i) == group]
    return ", ".join(names[:3]) + (" …" if len(names) > 3 else "")  # noqa: PLR2004 - enough names
