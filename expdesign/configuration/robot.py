"""Robots, ready to be computed with: the numbers that follow from a robot file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Discriminator, Field, Tag

from constraints import Limit
from constraints.arrays import Array
from expdesign.configuration import geometry as geo
from expdesign.configuration.bodies import Bodies, Body, payload_parameters
from expdesign.configuration.document import Placed, find_file, read_yaml
from expdesign.configuration.errors import InputError, Problem
from expdesign.configuration.fields import (
    Direction,
    FilledText,
    Name,
    Point,
    Pose,
    Text,
    exactly,
    one_of,
    read_only,
)
from expdesign.configuration.geometry import OrRing
from expdesign.configuration.identification import Identification
from expdesign.configuration.limits import (
    Limits,
    default_limits,
    limits_as_written,
    merged_reserve,
    resolve_limits,
    with_shared_joints,
)
from expdesign.configuration.noise import NoiseDescription, ResolvedNoise, resolve_noise
from expdesign.configuration.parameters import (
    DIRECT,
    Drive,
    DriveOrDirect,
    Parameters,
    Terms,
    chosen_terms,
    default_terms,
)
from expdesign.configuration.plausibility import physical_consistency, roundings, unit_slips
from expdesign.configuration.quantity import Acceleration
from expdesign.configuration.section import LATER, Section, file_kind, validate
from expdesign.configuration.tolerances import Tolerances, merged_tolerances, too_large
from expdesign.library import robot_files
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.term import Term, parameters_of
from expdesign.mechanism.terms import rigid_platform

PlatformKind = Literal["symmetric", "general"]
_Points = Annotated[tuple[Point, ...], exactly(ACTUATORS, "joints"), *OrRing]
_Axes = Annotated[tuple[Direction, ...], exactly(ACTUATORS, "axes")]

EARTH_GRAVITY = (0.0, 0.0, -9.81)
"""Where z points upward, m/s²."""


class RobotDescription(Section):
    """A hexapod as its YAML file states it, in SI units."""

    name: Name
    description: Text = ""
    home: Pose
    """x, y, z [m], phi, theta, psi [rad]."""
    gravity: Annotated[tuple[Acceleration, ...], exactly(3, "components [x, y, z]")] = EARTH_GRAVITY
    """Base frame, m/s²."""
    base_joints: _Points
    """(6, 3), base frame, m."""
    platform_joints: _Points
    """(6, 3), platform frame, m."""
    alpha_axes: _Axes | None = None
    """(6, 3), first cardan axes in the base frame; of any length but zero."""
    platform_joint_axes: _Axes | None = None
    """(6, 3), in the platform frame; of any length but zero."""
    platform_cardan_axes: Annotated[_Axes | None, LATER] = None
    """(6, 3), of cardan joints at the platform that turn the screws, platform frame; None: the
    screws do not turn with the platform."""
    platform: Annotated[PlatformKind, one_of(PlatformKind)] = "symmetric"
    """10 or 15 rigid-body parameters of the platform."""
    terms: Annotated[Terms, LATER] = Field(default_factory=default_terms)
    """Blocks of the model that is linear in the parameters."""
    drive: Annotated[DriveOrDirect, LATER] = DIRECT
    """What moves the struts; a screw or gear adds the term of its inertia."""
    bodies: Annotated[Bodies | None, LATER] = None
    """What moves; the parameters that it makes need not be given."""
    parameters: Parameters
    """Nominal (a-priori) values of the terms' parameters; physically consistent or not."""
    noise: NoiseDescription | None = None
    tolerances: Annotated[Tolerances | None, LATER] = None
    """Standard deviations of what is not known exactly; None: all is exact."""
    limits: Limits = Field(default_factory=dict)
    """As written."""
    identification: Annotated[Identification | None, LATER] = None
    """How the values are known, in a file that an estimate wrote."""


_ROBOT_FILE_KIND = file_kind("robot file", RobotDescription)


def _name_or_inline(value: object) -> str:
    return "(inline)" if isinstance(value, dict | RobotDescription) else "(name)"


RobotSource = Annotated[
    Annotated[FilledText, Tag("(name)")] | Annotated[RobotDescription, Tag("(inline)")],
    Discriminator(_name_or_inline),
]
"""A robot that ships, a path relative to the run file, or the robot itself."""


def read_robot(path: Path) -> Placed[RobotDescription]:
    """Read and validate a robot file, without resolving it."""
    document = read_yaml(path, _ROBOT_FILE_KIND)
    description, problems = validate(RobotDescription, document.data, document)
    if description is None:
        raise InputError(problems)
    return Placed(description, document)


_ARRAYS = (
    *("home", "gravity", "base_joints", "platform_joints", "alpha_axes", "platform_joint_axes"),
)


@dataclass(frozen=True, eq=False)
class ResolvedRobot:
    """A hexapod, ready to be computed with. The arrays are read-only, in SI units."""

    name: str
    description: RobotDescription
    """The same robot as it could stand in a file, with every default and the run's limits, noise
    and tolerances."""
    home: Array
    """(6,): x, y, z [m], phi, theta, psi [rad]."""
    gravity: Array
    """(3,), base frame, m/s²."""
    base_joints: Array
    """(6, 3), base frame, m."""
    platform_joints: Array
    """(6, 3), platform frame, m."""
    alpha_axes: Array
    """(6, 3), first cardan axes, unit vectors in the base frame."""
    platform_joint_axes: Array
    """(6, 3), reference axes of the platform joints, unit vectors in the platform frame."""
    platform_cardan_axes: Array | None
    """(6, 3), of cardan joints at the platform, unit vectors in the platform frame; None: the
    struts' halves do not turn against each other."""
    drive: Drive
    platform: PlatformKind
    terms: tuple[Term, ...]
    """Blocks of the regressor."""
    constants: tuple[float, ...]
    """Of the terms in their order."""
    parameters: Mapping[str, float]
    """Nominal values by name, in the order of the terms."""
    noise: ResolvedNoise | None
    """None when neither robot nor run state any."""
    tolerances: Tolerances | None
    """None when neither robot nor run state any."""
    limits: Mapping[str, Limit]
    """By key, in the order of the limits' catalogue, with their reserves. A limit that is missing
    does not limit, or another one holds it as well."""
    characteristic_length: float
    """By which rotations are scaled in condition numbers, m."""
    source: Path | None = None
    warnings: tuple[str, ...] = ()
    """What is legal but odd."""
    rounded: str = ""
    """Why bodies have its parameters within the rounding of the file, where they have not those
    written; else empty."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters in their order."""
        return tuple(self.parameters)

    @property
    def estimated_constants(self) -> tuple[str, ...]:
        """Constants of terms that its file says to estimate: ``cogging.pitch``."""
        return tuple(
            f"{term.name}.{name}"
            for term in self.description.terms
            for name, constant in term.constants.items()
            if constant.estimate
        )

    @property
    def thread_lead(self) -> float:
        """Lead of the struts' screws, m per turn, above zero for a right-handed thread."""
        return self.drive.screw.signed_lead if self.drive.screw is not None else 0.0

    @property
    def shared_joint_pairs(self) -> tuple[tuple[int, int], ...]:
        """Pairs of struts i < j, from zero, whose base or platform joints are the same point."""
        return geo.shared_pairs(self.base_joints, self.platform_joints)

    def struts_at(self, pose: Array) -> geo.StrutGeometry:
        """Return lengths, directions and inverse Jacobian at a pose (6,), m and rad."""
        return geo.geometry_at(pose, self.base_joints, self.platform_joints)


def load_robot_description(name_or_path: str | PathLike[str]) -> ResolvedRobot:
    """Load a robot.

    Parameters
    ----------
    name_or_path : str or path-like
        The name of a robot that ships, or the path of a robot file.

    Returns
    -------
    ResolvedRobot
        Arrays in SI units, every default filled in.

    Raises
    ------
    InputError
        With everything that is wrong: the file, its keys and values, or a geometry that is
        singular at home.
    """
    return resolve_robot(read_robot(find_file(name_or_path, "robot", robot_files())))


def as_general(description: RobotDescription) -> RobotDescription:
    """Return the same machine with all ten parameters of its platform."""
    terms = chosen_terms(description.terms, "general", description.drive)
    values = {one.name: description.parameters.get(one.name, 0.0) for one in parameters_of(terms)}
    return description.model_copy(update={"platform": "general", "parameters": values})


def carrying(robot: ResolvedRobot, payload: Sequence[Body]) -> ResolvedRobot:
    """Return a robot with a general platform with bodies on it; its `description` has none."""
    carried = payload_parameters(payload)
    values = {name: value + carried.get(name, 0.0) for name, value in robot.parameters.items()}
    return replace(robot, parameters=values) if payload else robot


def resolve_robot(
    source: Placed[RobotDescription],
    limits: Sequence[Placed[Mapping[str, Any]]] = (),
    noise: Sequence[Placed[NoiseDescription]] = (),
    tolerances: Sequence[Placed[Tolerances]] = (),
    sampling: float | None = None,
    *,
    file_format: int | None = None,
) -> ResolvedRobot:
    """Resolve a robot together with what a run overrides: limits, noise and tolerances.

    `sampling` is that of the run's experiment, Hz, where there is one; `file_format` is that
    of a run file that was resolved before, whose limits by default are those of its time.
    """
    description, document = source.value, source.document
    limits = [Placed(description.limits, document, (*source.key, "limits")), *limits]
    resolved_limits, length = resolve_limits(limits, default_limits(description.home, file_format))
    reserve = merged_reserve(limits)
    if description.noise is not None:
        noise = [Placed(description.noise, document, (*source.key, "noise")), *noise]
    merged_noise, resolved_noise, problems = resolve_noise(noise, sampling)
    if description.tolerances is not None:
        own = Placed(description.tolerances, document, (*source.key, "tolerances"))
        tolerances = [own, *tolerances]
    merged, found = merged_tolerances(tolerances, (term.name for term in description.terms))
    problems += found
    if tolerances:
        sizes = geo.sizes(description.home, description.base_joints, description.platform_joints)
        problems += too_large(tolerances, sizes)

    warnings = []
    drive, turning = description.drive, description.platform_cardan_axes is not None
    terms = chosen_terms(description.terms, description.platform, drive, turning=turning)
    if turning and drive.screw is None:
        message = "only a screw turns with the platform, and the drive has none"
        allowed = "drive: {screw: {lead: …}} beside it"
        problems.append(source.problem(("platform_cardan_axes",), message, allowed))
    platform_joints = np.array(description.platform_joints)
    with np.errstate(all="ignore"):
        if length is None:
            length = geo.rms_radius(platform_joints)
            warnings.append(
                "limits.characteristic_length is not given: condition numbers count a rotation of "
                f"1 rad as {length:.4g} m, the rms radius of the platform joints"
            )
        alpha_axes, joint_axes, thread_axes, found = _axes(source, platform_joints, length)
        sums = geo.asymmetric_sums(platform_joints) if rigid_platform.SYMMETRIC in terms else {}
    problems += found
    if problems:
        raise InputError(problems)

    consistency = physical_consistency(
        terms,
        description.parameters,
        roundings(document, (*source.key, "parameters"), description.parameters),
        platform_joints,
        length,
        float(np.linalg.norm(description.gravity)),
    )
    warnings += [*_of_gravity(description), *consistency.warnings]
    base_joints, home = np.array(description.base_joints), np.array(description.home)
    longest = float(np.max(geo.geometry_at(home, base_joints, platform_joints).lengths))
    warnings += reserve.warnings(resolved_limits)
    warnings += unit_slips(resolved_limits, drive, description.parameters, longest)
    if description.bodies is not None:
        made = description.bodies.parameters(platform_joints)
        general = description.platform == "general"
        warnings += description.bodies.warnings(made, general=general)
    if description.identification is not None:
        warnings += description.identification.warnings
    if sums:
        warnings.append(
            "the platform is declared symmetric, but its joints are not: `platform: general` has "
            "the five parameters that count it. The sums over the joints would be zero: "
            f"{', '.join(f'{name} = {value}' for name, value in sums.items())}"
        )
    written = description.model_copy(
        update={
            "alpha_axes": tuple(map(tuple, alpha_axes.tolist())),
            "platform_joint_axes": tuple(map(tuple, joint_axes.tolist())),
            "platform_cardan_axes": None
            if thread_axes is None
            else tuple(map(tuple, thread_axes.tolist())),
            "noise": merged_noise,
            "tolerances": merged,
            "limits": limits_as_written(resolved_limits, length, reserve),
        }
    )
    arrays = {name: read_only(getattr(written, name)) for name in _ARRAYS}
    pairs = geo.shared_pairs(arrays["base_joints"], platform_joints)
    return ResolvedRobot(
        name=description.name,
        description=written,
        **arrays,
        platform_cardan_axes=None if thread_axes is None else read_only(thread_axes),
        drive=drive,
        platform=description.platform,
        terms=terms,
        constants=tuple(c.value for term in description.terms for c in term.constants.values()),
        parameters=description.parameters,
        noise=resolved_noise,
        tolerances=merged,
        limits=reserve.drawn_in(
            {key: with_shared_joints(limit, pairs) for key, limit in resolved_limits.items()}
        ),
        characteristic_length=length,
        source=document.file,
        warnings=tuple(warnings),
        rounded=consistency.rounded,
    )


def _of_gravity(description: RobotDescription) -> list[str]:
    base, platform = np.array(description.base_joints), np.array(description.platform_joints)
    with np.errstate(all="ignore"):
        joints = geo.geometry_at(np.array(description.home), base, platform).joints
        return geo.gravity_warnings(np.array(description.gravity), joints - base)


def _axes(
    source: Placed[RobotDescription], platform_joints: Array, length: float
) -> tuple[Array, Array, Array | None, list[Problem]]:
    """Return the axes of the struts' joints, and what is wrong with the geometry.

    First cardan axes at the base, reference axes and first cardan axes at the platform.
    """
    description, problems = source.value, list[Problem]()
    base_joints = np.array(description.base_joints)
    home = geo.geometry_at(np.array(description.home), base_joints, platform_joints)
    if description.alpha_axes is None:
        alpha_axes, problems = geo.default_alpha_axes(base_joints, source.problem)
    else:
        alpha_axes = geo.unit_vectors(np.array(description.alpha_axes))
    if description.platform_joint_axes is None:
        joint_axes = home.directions @ home.rotation
    else:
        joint_axes = geo.unit_vectors(np.array(description.platform_joint_axes))
    problems = problems or geo.geometry_problems(home, alpha_axes, length, source.problem)
    thread_axes = None
    if description.platform_cardan_axes is not None and not problems:
        given = np.array(description.platform_cardan_axes)
        thread_axes, problems = geo.thread_axes(given, alpha_axes, home, source.problem)
    return alpha_axes, joint_axes, thread_axes, problems
