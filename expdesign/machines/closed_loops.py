"""A hexapod in a mechanism of bodies and joints: six slides between a base and a platform.

At each of its ends a slide is held by joints that turn about axes through one point: a cardan or a
ball joint, put together from whatever joints the model has there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from constraints.arrays import Array
from expdesign.configuration.errors import InputError
from expdesign.configuration.plausibility import FASTEST
from expdesign.machines.machine import MachineDraft, Question, round_digits, rows
from expdesign.machines.mechanism_graph import (
    Groups,
    Joint,
    Link,
    PathStep,
    Rotations,
    StrutPart,
    moved_bodies,
    rigid_groups,
)
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.strut import ANGLES

_ALLOWED = (
    "six struts, each with one sliding joint between a cardan or ball joint on the base and one on "
    "the platform; or the joints by hand: --base-joints, --platform-joints and --home-height"
)
_MISSED = 1e-4
"""Distance of axes that count as meeting, of the machine's size: the rounding of files."""
_FAR_APART = 2e-2
"""Largest such distance that is accepted; the robot file then has a question."""
_PARALLEL = 1e-6
"""Largest eigenvalue of the sum of projectors in an undetermined direction."""
_ASIDE = 2e-2
"""Sine of the angle between a slide and the line between the joints that counts as none."""
_OPEN = 1e-4
"""Distance of a loop's ends that counts as closed, of the length at home: rounded files."""


@dataclass(frozen=True)
class _End:
    """One end of a strut."""

    path: tuple[PathStep, ...]
    """Joints from base or platform to the slide."""
    hub: Array
    """The joint's point on the base or the platform, world, (3,), m."""
    leg: Array
    """The same on the strut."""
    first_axis: Array | None
    """The axis that is fixed in base or platform, world, (3,); None for a ball joint."""
    missed: float
    """Largest distance between the axes of its joints and their meeting point, m."""


@dataclass(frozen=True)
class _Strut:
    slide: Joint
    stator: int
    """Group of the slide's body on the side of the base."""
    slider: int
    axis: Array
    """Axis of the slide from base to platform, world, (3,), unit."""
    extends: int
    """1 if the slide's travel along its axis extends the strut, else −1."""
    foot: _End
    head: _End

    @property
    def along(self) -> Array:
        """From foot to head on the strut, (3,), m; zero in a model without length."""
        return self.head.leg - self.foot.leg


def hexapod(
    name: str,
    source: str,
    bodies: Sequence[Link],
    joints: Sequence[Joint],
    base: int | None,
    file: Path,
    added: Sequence[Joint] = (),
) -> MachineDraft:
    """Return the hexapod in a mechanism; struts are numbered in the order of their slides.

    `base` is the body that does not move, by default the one that carries the struts' first bodies.
    Joints that a reader `added` count as those of the file, except in messages about the file.
    """
    described, joints = joints, [*joints, *added]
    groups = rigid_groups(len(bodies), joints)
    slides = [joint for joint in joints if joint.kind == "slide"]
    turning = sum(joint.kind == "rotation" for joint in described)
    loops = max(len(described) - len(bodies) + 1, 0)
    content = (
        f"the model has {len(slides)} sliding joint{'s' * (len(slides) != 1)} other than those of "
        f"the platform, {turning} joint{'s that turn' if turning != 1 else ' that turns'} (cranks, "
        f"if they have motors) and {loops} closed loop{'s' * (loops != 1)}"
    )
    if len(slides) != ACTUATORS:
        raise InputError(content, file, allowed=_ALLOWED)
    rotations = Rotations(groups, joints)
    ends = [groups[body] for body in slides[0].bodies]
    base_group = _hub(ends[0], rotations) if base is None else groups[base]
    below = rotations.paths(base_group)
    platform_group = _hub(ends[1] if ends[0] in below else ends[0], rotations)
    above = rotations.paths(platform_group)
    try:
        struts = [_strut(slide, groups, below, above) for slide in slides]
    except InputError as error:
        problems = [replace(one, message=f"{one.message}; {content}") for one in error.problems]
        raise InputError(problems) from None
    platform = _platform_body(platform_group, groups, bodies, joints)
    place = bodies[platform].place
    names = [body.name for i, body in enumerate(bodies) if groups[i] == base_group]
    listed = ", ".join(names[:3]) + (" …" if len(names) > 3 else "")  # noqa: PLR2004 - enough names
    questions = [
        Question(
            "",
            f"Taken as base: {listed}; as platform: {bodies[platform].name}, whose frame is the "
            f"TCP's. Strut 1 is {slides[0].source.label} in line {slides[0].source.line}; the "
            "others follow as in the file.",
        ),
        *_missed(struts),
    ]
    limits, unknown = _limits(struts)
    gap = _open_loop(struts)
    questions += [*unknown, *gap]
    masses = [body.mass for i, body in enumerate(bodies) if groups[i] == platform_group]
    known = [mass for mass in masses if mass is not None]
    mass = float(sum(known)) if len(known) == len(masses) and sum(known) > 0 else None
    if mass is None:
        text = "The model does not state the mass of every body of the platform: what is moved?"
        questions.append(Question("moved_mass", text))
    parts = [_parts(strut, groups) for strut in struts]
    moved = moved_bodies(bodies, groups, parts, (platform_group, place), questions)
    angles = Rotation.from_matrix(place.rotation).as_euler(ANGLES) + 0.0
    axes = [one.foot.first_axis for one in struts if one.foot.first_axis is not None]
    return MachineDraft(
        name=name,
        source=source,
        base_joints=rows(np.array([strut.foot.hub for strut in struts])),
        platform_joints=rows(place.local(np.array([strut.head.hub for strut in struts]))),
        home=None if gap else (*rows(place.origin[None])[0], *angles.tolist()),
        alpha_axes=rows(np.array(axes)) if len(axes) == ACTUATORS else None,
        limits=limits,
        moved_mass=mass,
        bodies=moved,
        questions=tuple(questions),
    )


def _hub(start: int, rotations: Rotations) -> int:
    """Return the group with the most joints among those that rotations connect with a group."""
    return max(rotations.paths(start), key=lambda group: len(rotations.edges.get(group, [])))


def _strut(
    slide: Joint,
    groups: Groups,
    below: dict[int, tuple[PathStep, ...]],
    above: dict[int, tuple[PathStep, ...]],
) -> _Strut:
    """Return a strut by its slide, and the paths of joints from base and platform."""
    stator, slider = (groups[body] for body in slide.bodies)
    sign = 1
    if stator not in below:
        stator, slider, sign = slider, stator, -1
    if stator not in below:
        raise slide.source.refusal("no joints that turn connect it with the base", _ALLOWED)
    if slider not in above or slider in below:
        raise slide.source.refusal("it does not connect base and platform", _ALLOWED)
    foot, head = _end(slide, below[stator], "base"), _end(slide, above[slider], "platform")
    axis = slide.axes[0] * sign
    # A strut that is written without length extends along the axis.
    shortens = axis @ (head.leg - foot.leg) < -_OPEN * np.linalg.norm(head.hub - foot.hub)
    way = -1 if shortens else 1
    return _Strut(slide, stator, slider, way * axis, way, foot, head)


def _end(slide: Joint, path: tuple[PathStep, ...], where: str) -> _End:
    """Return the end of a strut at a path of joints from base or platform."""
    if not path:
        raise slide.source.refusal(f"it is fixed to the {where}", _ALLOWED)
    (hub, missed), (leg, _) = (_meeting(slide, path, where, on_hub) for on_hub in (True, False))
    axes = path[0].joint.axes
    first = axes[0 if path[0].forward else -1] if len(axes) else None
    return _End(path, hub, leg, first, missed)


def _meeting(
    slide: Joint, path: tuple[PathStep, ...], where: str, on_hub: bool
) -> tuple[Array, float]:
    """Return the meeting point of the joints' axes, (3,), m, and the largest distance to it, m.

    By least squares of the distances.
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


def _parts(strut: _Strut, groups: Groups) -> tuple[StrutPart, ...]:
    """Return ring, stator and slider; the slider has the bodies of the joints at the platform."""
    rings, lugs = (
        [groups[step.joint.bodies[1 if step.forward else 0]] for step in end.path[:-1]]
        for end in (strut.foot, strut.head)
    )
    along, first = strut.axis, strut.foot.first_axis
    if first is None or np.linalg.norm(np.cross(first, along)) < _PARALLEL:
        first = strut.foot.hub * [1.0, 1.0, 0.0]
    if np.linalg.norm(np.cross(first, along)) < _PARALLEL:
        first = np.eye(3)[int(np.argmin(np.abs(along)))]
    first = first / np.linalg.norm(first)
    second = np.cross(along, first)
    second = second / np.linalg.norm(second)
    of_strut = np.stack([np.cross(second, along), second, along])
    of_ring = np.stack([first, second, np.cross(first, second)])
    return (
        (rings, of_ring, strut.foot.leg),
        ((strut.stator,), of_strut, strut.foot.leg),
        ((strut.slider, *lugs), of_strut, strut.head.leg),
    )


def _limits(struts: Sequence[_Strut]) -> tuple[dict[str, object], list[Question]]:
    """Return the limits of the struts; a limit that is missing for one of them is a question."""
    lengths: list[tuple[float, float]] = []
    for strut in struts:
        hubs = strut.head.hub - strut.foot.hub
        apart = max(float(np.linalg.norm(v)) for v in (strut.along, hubs))
        aside = float(np.linalg.norm(np.cross(strut.axis, strut.along)))
        if aside > _ASIDE * apart:
            message = (
                f"it slides {np.degrees(np.arcsin(aside / apart)):.3g} deg off the line between "
                "the strut's joints"
            )
            raise strut.slide.source.refusal(message, _ALLOWED)
        if strut.slide.travel is None:
            continue
        ends = strut.axis @ strut.along + np.sort(np.array(strut.slide.travel) * strut.extends)
        if ends[1] > 0:
            lengths.append((round_digits(max(float(ends[0]), 0.0)), round_digits(float(ends[1]))))
    limits, unknown = dict[str, object](), list[Question]()
    slides = [strut.slide for strut in struts]
    # Simulators have placeholders such as 100 m/s.
    speeds = [slide.speed for slide in slides if slide.speed is not None and slide.speed <= FASTEST]
    found: tuple[tuple[str, list[object], str], ...] = (
        ("strut_length", list(lengths), "range"),
        ("actuator_force", [s.force for s in slides if s.force is not None], "largest force"),
        ("strut_speed", list(speeds), "largest speed"),
    )
    for key, values, words in found:
        if len(values) == ACTUATORS:
            limits[key] = values[0] if len(set(values)) == 1 else tuple(values)
        else:
            text = f"The model does not state the {words} of every strut: what is it?"
            unknown.append(Question(f"limits.{key}", text))
    return limits, unknown


def _missed(struts: Sequence[_Strut]) -> Iterator[Question]:
    """Yield a question for axes that nearly meet; refuse struts with distant axes."""
    feet, heads = [strut.foot for strut in struts], [strut.head for strut in struts]
    size = float(np.max(np.ptp(np.array([end.hub for end in (*feet, *heads)]), axis=0)))
    for ends, where in ((feet, "base"), (heads, "platform")):
        j = int(np.argmax([end.missed for end in ends]))
        far = ends[j].missed
        if far > _FAR_APART * size:
            message = f"the axes of its joints at the {where} miss each other by {far * 1e3:.3g} mm"
            raise struts[j].slide.source.refusal(message, "axes that meet in one point")
        if far > _MISSED * size:
            text = (
                f"The axes of the joints at the {where} miss each other by up to "
                f"{far * 1e3:.3g} mm, those of strut {j + 1}: these are the points midway. "
                "Where do they meet?"
            )
            yield Question(f"{where}_joints", text)


def _open_loop(struts: Sequence[_Strut]) -> list[Question]:
    """Return a question about home if a loop is open in the model's own pose."""
    for j, strut in enumerate(struts, 1):
        gap = max(float(np.linalg.norm(end.hub - end.leg)) for end in (strut.foot, strut.head))
        if gap > _OPEN * float(np.linalg.norm(strut.head.hub - strut.foot.hub)):
            text = (
                f"Where the model is written strut {j} misses its joint by {gap * 1e3:.3g} mm: "
                "that pose of the platform is no home. Where is it at home?"
            )
            return [Question("home", text)]
    return []


def _platform_body(
    group: int, groups: Groups, bodies: Sequence[Link], joints: Sequence[Joint]
) -> int:
    """Return the body of a group with the most joints; the heaviest, if each has one."""
    members = [i for i in range(len(bodies)) if groups[i] == group]
    held = [body for joint in joints if joint.kind == "rotation" for body in joint.bodies]
    most = max(held.count(member) for member in members)
    return max(members, key=held.count if most > 1 else lambda i: bodies[i].mass or 0.0)
