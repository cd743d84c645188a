"""The robot file: what it may hold, and reading it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from expdesign.configuration.bodies import Bodies
from expdesign.configuration.document import Placed
from expdesign.configuration.drive import DIRECT, DriveOrDirect
from expdesign.configuration.identification import Identification
from expdesign.configuration.joint_ring import OrRing
from expdesign.configuration.limits import Limits
from expdesign.configuration.noise import NoiseDescription
from expdesign.configuration.parameters import Parameters, Terms, default_terms
from expdesign.configuration.problem import InputError
from expdesign.configuration.section import LATER, Section, file_kind, validate
from expdesign.configuration.tolerances import Tolerances
from expdesign.configuration.values.quantity import Acceleration
from expdesign.configuration.values.scalars import (
    Direction,
    FilledText,
    Name,
    Point,
    Pose,
    Text,
    exactly,
    one_of,
)
from expdesign.configuration.yaml_file import read_yaml
from expdesign.mechanism.hexapod import ACTUATORS

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
