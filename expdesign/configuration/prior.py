"""`prior:` of a run: an identified machine, before a later change such as a payload."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.document import Document, Located, absolute, find_file
from expdesign.configuration.errors import InputError, Key, Problem
from expdesign.configuration.identification import IDENTIFIED_ROBOT, Identification, machine_name
from expdesign.configuration.robot import (
    ResolvedRobot,
    RobotDescription,
    RobotSource,
    read_robot,
    resolve_robot,
)
from expdesign.library import robot_files
from expdesign.mechanism.terms import rigid_platform

_ALLOWED = "the run folder of an estimate of this machine, or its identified-robot.yaml"

_ALIKE = 1e-9
"""Difference of coordinates within rounding errors, m."""
_ROUNDING = 1e-9
"""Size of a negative eigenvalue of a correlation matrix within rounding errors."""
_DYNAMIC = ("gravity", "base_joints", "platform_joints", "alpha_axes", "platform_cardan_axes")
"""Properties of a robot, in addition to terms and drive, that its parameters refer to."""


def identification_of(machine: RobotSource | None) -> Identification:
    """Return the identification of a prior machine from a loaded run."""
    if not isinstance(machine, RobotDescription) or machine.identification is None:
        raise ValueError("the run was not loaded: its prior is no identified machine")
    return machine.identification


def prior_machine(
    source: RobotSource, key: Key, robot: ResolvedRobot, document: Document
) -> RobotDescription:
    """Return the identified machine for a prior of the run, inline or by its name.

    It has no limits, noise or tolerances, since these are not part of a prior.

    Raises
    ------
    InputError
        The machine is missing, is another robot, or its values have no covariance.
    """
    placed = _locate(source, key, document)
    bare = placed.value.model_copy(update={"limits": {}, "noise": None, "tolerances": None})
    machine = resolve_robot(Located(bare, placed.document, placed.key))
    wrong = list(_differences(machine, robot)) or list(
        _covariance_faults(bare.identification, robot)
    )
    if wrong:
        name = placed.document.file or machine.name
        raise InputError(
            [document.problem(key, f"{name}: {reason}", allowed) for reason, allowed in wrong]
        )
    return bare


def _locate(source: RobotSource, key: Key, document: Document) -> Located[RobotDescription]:
    if isinstance(source, RobotDescription):
        return Located(source, document, key)
    path = absolute(source, document.folder)
    if path.is_dir():
        path = path / IDENTIFIED_ROBOT
    else:
        try:
            path = find_file(source, "robot", robot_files(), document.folder)
        except InputError:
            path = path / IDENTIFIED_ROBOT
    if not path.is_file():
        raise InputError([document.problem(key, f"there is no {path}", _ALLOWED)])
    return read_robot(path)


def _differences(machine: ResolvedRobot, robot: ResolvedRobot) -> Iterator[tuple[str, str]]:
    """Yield differences that make the parameters of two robots incomparable, with a remedy."""
    names = machine_name(machine.name), machine_name(robot.name)
    if names[0] != names[1]:
        yield f"it is the machine {names[0]}, and the run's robot is {names[1]}", _ALLOWED
        return
    if machine.platform != robot.platform:
        kinds = f"its platform is {machine.platform}, that of the run's robot {robot.platform}"
        yield kinds, f"an identification with platform: {robot.platform}"
    elif (machine.terms, machine.constants) != (robot.terms, robot.constants):
        terms = ", ".join(term.name for term in robot.terms)
        yield "its terms or their constants are not those of the run's robot", terms
    if machine.drive != robot.drive:
        yield "its drive is not that of the run's robot", "the same drive"
    for name in _DYNAMIC:
        if not _equal(getattr(machine, name), getattr(robot, name)):
            yield (
                f"its {name} are not those of the run's robot: the parameters belong to another "
                "geometry",
                "the same geometry: `robot:` may be the identified-robot.yaml itself",
            )


def _equal(one: Array | None, other: Array | None) -> bool:
    if one is None or other is None:
        return one is other
    return bool(np.allclose(one, other, rtol=0, atol=_ALIKE))


def _covariance_faults(
    found: Identification | None, robot: ResolvedRobot
) -> Iterator[tuple[str, str]]:
    """Yield faults of the values' covariance."""
    if found is None:
        yield "it was not identified: the file has no `identification` with a covariance", _ALLOWED
        return
    if found.parameters != robot.parameter_names:
        names = ", ".join(robot.parameter_names)
        yield "identification.parameters are not those of the run's robot", names
        return
    covariance = np.array(found.covariance_random)
    variance = np.diag(covariance)
    scale = np.sqrt(np.where(variance > 0, variance, 1.0))
    correlation = covariance / np.multiply.outer(scale, scale)
    if np.any(variance < 0) or not np.allclose(correlation, correlation.T, atol=_ROUNDING):
        yield (
            "identification.covariance_random is not symmetric, or has a negative variance",
            ("a covariance"),
        )
    elif np.linalg.eigvalsh(correlation)[0] < -_ROUNDING:
        yield "identification.covariance_random has negative eigenvalues", "a covariance"


def payload_problems(
    machine: RobotDescription, robot: ResolvedRobot, key: Key, document: Document
) -> Iterator[Problem]:
    """Yield obstacles to separating a payload from the platform of an identified machine."""
    ten = tuple(parameter.name for parameter in rigid_platform.GENERAL.parameters)
    if not set(ten) <= set(robot.parameter_names):
        yield document.problem(
            key,
            "a payload has ten parameters, and a symmetric platform has five of them",
            "platform: general, for the robot and in the identification",
        )
        return
    found = identification_of(machine)
    variance = dict(zip(found.parameters, np.diag(found.covariance_random), strict=False))
    if fixed := [name for name in ten if not variance.get(name, 0.0) > 0]:
        yield document.problem(
            key,
            f"the identification did not estimate {', '.join(fixed)}: the platform's share of "
            "them is unknown",
            "an identification that estimates all ten parameters of the platform",
        )
