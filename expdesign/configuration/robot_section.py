"""The robot file: geometry, nominal parameters, noise and limits of a hexapod."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from expdesign.configuration.base import Section
from expdesign.configuration.failure import refusal, shown
from expdesign.configuration.noise_section import NoiseDescription
from expdesign.configuration.parameters import DEFAULT_TERMS, Parameters, Terms
from expdesign.configuration.quantity import Acceleration, Angle, Length, Number
from expdesign.configuration.scalars import Name, Text, exactly, one_of

PlatformKind = Literal["symmetric", "general"]


def _mapping(value: object) -> object:
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise refusal(f"{shown(value)} is not a mapping", "keys with their values")
    return value


RawMapping = Annotated[dict[str, Any], BeforeValidator(_mapping)]
"""A mapping whose keys are judged by whoever knows them."""

Point = Annotated[tuple[Length, ...], exactly(3, "coordinates [x, y, z]")]
Direction = Annotated[tuple[Number, ...], exactly(3, "components [x, y, z]")]
Pose = Annotated[
    tuple[Length, Length, Length, Angle, Angle, Angle],
    exactly(6, "coordinates [x, y, z, phi, theta, psi]"),
]


class RobotDescription(Section):
    """A hexapod as its YAML file states it, in SI units.

    Attributes
    ----------
    name, description : str
    home : (6,)
        x, y, z [m], phi, theta, psi [rad].
    gravity : (3,)
        In the base frame, m/s².
    base_joints, platform_joints : (6, 3)
        In the base and in the platform frame, m.
    alpha_axes, platform_joint_axes : (6, 3), optional
        Directions in the base and in the platform frame; any length but zero.
    platform : {"symmetric", "general"}
        10 or 15 rigid-body parameters of the platform.
    terms : tuple of TermDescription
        Blocks of the model that is linear in the parameters.
    parameters : dict
        Nominal (a-priori) values of the terms' parameters, SI; they need not be physically
        consistent.
    noise : NoiseDescription, optional
    limits : dict
        As written; `expdesign.configuration` judges it by the limits that exist.
    """

    name: Name
    description: Text = ""
    home: Pose
    gravity: Annotated[tuple[Acceleration, ...], exactly(3, "components [x, y, z]")] = (
        0.0,
        0.0,
        -9.81,
    )
    base_joints: Annotated[tuple[Point, ...], exactly(6, "joints")]
    platform_joints: Annotated[tuple[Point, ...], exactly(6, "joints")]
    alpha_axes: Annotated[tuple[Direction, ...], exactly(6, "axes")] | None = None
    platform_joint_axes: Annotated[tuple[Direction, ...], exactly(6, "axes")] | None = None
    platform: Annotated[PlatformKind, one_of(PlatformKind)] = "symmetric"
    terms: Terms = DEFAULT_TERMS
    parameters: Parameters
    noise: NoiseDescription | None = None
    limits: RawMapping = Field(default_factory=dict)
