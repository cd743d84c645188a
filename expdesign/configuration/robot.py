"""Robots: from a file or a description to numbers that can be computed with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import geometry as geo
from expdesign.configuration.document import Document
from expdesign.configuration.finding import find_robot
from expdesign.configuration.limits import (
    LimitSource,
    limits_as_written,
    resolve_limits,
    with_shared_joints,
)
from expdesign.configuration.noise import NoiseSource, resolve_noise
from expdesign.configuration.noise_section import NoiseDescription
from expdesign.configuration.parameters import chosen_terms, parameter_warnings
from expdesign.configuration.problem import InputError, Key, Problem
from expdesign.configuration.resolved import ResolvedRobot, read_only
from expdesign.configuration.robot_section import RobotDescription
from expdesign.configuration.validation import validate
from expdesign.configuration.yaml_reader import read_yaml


@dataclass(frozen=True)
class RobotSource:
    """A validated description, and where it stands."""

    description: RobotDescription
    document: Document
    key: Key = ()

    def problem(self, key: Key, message: str, allowed: str | None = None) -> Problem:
        """Return a problem with a key of the robot."""
        return self.document.problem((*self.key, *key), message, allowed)


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
    return resolve_robot(read_robot(find_robot(name_or_path)))


def read_robot(path: Path) -> RobotSource:
    """Read and validate a robot file, without resolving it.

    Raises
    ------
    InputError
    """
    document = read_yaml(path)
    description, problems = validate(RobotDescription, document.data, document)
    if description is None:
        # The limits are not the schema's: their problems shall be reported with the others.
        limits = document.data.get("limits")
        if isinstance(limits, dict):
            problems += resolve_limits([LimitSource(limits, document, ("limits",))])[2]
        raise InputError(problems)
    return RobotSource(description, document)


def resolve_robot(
    source: RobotSource,
    limits: Sequence[LimitSource] = (),
    noise: Sequence[NoiseSource] = (),
) -> ResolvedRobot:
    """Resolve a robot together with what a run overrides.

    Parameters
    ----------
    source : RobotSource
    limits, noise : sequence, optional
        What overrides the robot's own, key by key.

    Raises
    ------
    InputError
        With everything that is wrong.
    """
    description, document = source.description, source.document
    own_limits = LimitSource(description.limits, document, (*source.key, "limits"))
    resolved_limits, length, problems = resolve_limits([own_limits, *limits])
    own_noise = description.noise
    merged_noise, resolved_noise, found = resolve_noise(
        [
            *([] if own_noise is None else [_noise_source(own_noise, source)]),
            *noise,
        ]
    )
    problems += found

    warnings = []
    platform_joints = read_only(description.platform_joints)
    if length is None:
        with np.errstate(all="ignore"):
            length = float(np.sqrt(np.mean(np.sum(platform_joints**2, axis=1))))
        warnings.append(
            f"limits.characteristic_length is not given: rotations are scaled by {length:.4g} m, "
            "the rms radius of the platform joints"
        )
    with np.errstate(all="ignore"):
        alpha_axes, joint_axes, found = _directions(source, platform_joints, length)
    problems += found
    if problems:
        raise InputError(problems)

    terms = chosen_terms(description.terms, description.platform)
    warnings += parameter_warnings(terms, description.parameters)
    warnings += _symmetry_warnings(description.platform, platform_joints)
    written = description.model_copy(
        update={
            "alpha_axes": _nested(alpha_axes),
            "platform_joint_axes": _nested(joint_axes),
            "noise": merged_noise,
            "limits": limits_as_written(resolved_limits, length),
        }
    )
    robot = ResolvedRobot(
        name=description.name,
        description=written,
        home=read_only(description.home),
        gravity=read_only(description.gravity),
        base_joints=read_only(description.base_joints),
        platform_joints=platform_joints,
        alpha_axes=read_only(alpha_axes),
        platform_joint_axes=read_only(joint_axes),
        platform=description.platform,
        terms=terms,
        constants=tuple(c.value for term in description.terms for c in term.constants.values()),
        parameters=description.parameters,
        noise=resolved_noise,
        limits=resolved_limits,
        characteristic_length=length,
        source=document.file,
        warnings=tuple(warnings),
    )
    pairs = geo.shared_joint_pairs(robot)
    limits_of_pairs = {
        key: with_shared_joints(limit, pairs) for key, limit in resolved_limits.items()
    }
    return replace(robot, limits=limits_of_pairs)


def _noise_source(noise: NoiseDescription, source: RobotSource) -> NoiseSource:
    return NoiseSource(noise, source.document, (*source.key, "noise"))


def _directions(
    source: RobotSource, platform_joints: Array, length: float
) -> tuple[Array, Array, list[Problem]]:
    """Return first cardan axes and platform joint axes, and what is wrong with the geometry."""
    description = source.description
    base_joints = np.array(description.base_joints)
    home = geo.home_geometry(np.array(description.home), base_joints, platform_joints)
    if description.alpha_axes is None:
        alpha_axes, problems = geo.default_alpha_axes(base_joints, source.problem)
    else:
        given = np.array(description.alpha_axes)
        alpha_axes, problems = geo.unit_vectors(given, "alpha_axes", source.problem, "axis")
    if description.platform_joint_axes is None:
        joint_axes = home.directions @ home.rotation
    else:
        given = np.array(description.platform_joint_axes)
        name = "platform_joint_axes"
        joint_axes, found = geo.unit_vectors(given, name, source.problem, "axis")
        problems += found
    if not problems:
        condition = geo.condition_at_home(home, length)
        problems = geo.geometry_problems(home, alpha_axes, condition, length, source.problem)
    return alpha_axes, joint_axes, problems


def _symmetry_warnings(platform: str, platform_joints: Array) -> list[str]:
    if platform != "symmetric":
        return []
    with np.errstate(all="ignore"):
        sums = geo.asymmetric_sums(platform_joints)
    if not sums:
        return []
    values = ", ".join(
        f"{name} = {value:.3g} {'m²' if '·' in name else 'm'}" for name, value in sums.items()
    )
    return [
        f"the platform is declared symmetric, but sums over its joints do not vanish: {values}; "
        "with `platform: general` the model is exact"
    ]


def _nested(array: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in array.tolist())
