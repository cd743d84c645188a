"""The robot file, and its resolution with a run's overrides into numbers for computations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from constraints import Limit
from constraints.arrays import Array
from expdesign.configuration import geometry as geo
from expdesign.configuration import plausibility, schema
from expdesign.configuration.bodies import Bodies, BodyDescription, payload_parameters
from expdesign.configuration.document import Located, find_file, read_yaml
from expdesign.configuration.errors import InputError, Problem, collect
from expdesign.configuration.geometry import OrRing
from expdesign.configuration.limits import (
    Limits,
    default_limits,
    limits_as_written,
    merge_reserves,
    reserve_of,
    reserve_warnings,
    resolve_limits,
    with_shared_joints,
)
from expdesign.configuration.noise import NoiseDescription, ResolvedNoise, resolve_noise
from expdesign.configuration.parameters import (
    DIRECT,
    ConstantDescription,
    Drive,
    DriveOrDirect,
    Parameters,
    TermDescription,
    Terms,
    chosen_terms,
    default_terms,
)
from expdesign.configuration.quantity import Acceleration
from expdesign.configuration.tolerances import (
    Identification,
    RobotTolerances,
    merge_tolerances,
    oversized_tolerances,
)
from expdesign.library import robot_files
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.term import Term, parameters_of
from expdesign.mechanism.terms import rigid_platform, terms_named
from expdesign.mechanism.terms.actuator_forces import BACK_EMF

PlatformKind = Literal["symmetric", "general"]

EARTH_GRAVITY = (0.0, 0.0, -9.81)
"""Gravity with z upward, m/s²."""

_Points = Annotated[tuple[schema.Point, ...], schema.exactly(ACTUATORS, "joints"), *OrRing]
_Axes = Annotated[tuple[schema.Direction, ...], schema.exactly(ACTUATORS, "axes")]


class RobotDescription(schema.Section):
    """The content of a robot file, in SI units."""

    name: schema.Name
    description: str = ""
    home: schema.Pose
    """x, y, z [m], phi, theta, psi [rad]."""
    gravity: Annotated[tuple[Acceleration, ...], schema.exactly(3, "components [x, y, z]")] = (
        EARTH_GRAVITY
    )
    """Base frame, m/s²."""
    base_joints: _Points
    """(6, 3), base frame, m."""
    platform_joints: _Points
    """(6, 3), platform frame, m."""
    alpha_axes: _Axes | None = None
    """(6, 3), first cardan axes in the base frame; of any length but zero."""
    platform_joint_axes: _Axes | None = None
    """(6, 3), reference axes of the platform joints, platform frame; of any length but zero."""
    platform_cardan_axes: _Axes | None = None
    """(6, 3), first axes of cardan joints at the platform that turn the screws, platform frame;
    None: the screws do not turn with the platform."""
    platform: PlatformKind = "symmetric"
    """10 or 15 rigid-body parameters of the platform."""
    drive: DriveOrDirect = DIRECT
    """Drive of the struts; a screw or gear adds the term of its inertia."""
    terms: Terms = Field(default_factory=default_terms)
    """Blocks of the model that is linear in the parameters; in their constants turns of the drive
    may be stated for lengths."""
    bodies: Bodies | None = None
    """Moving bodies; the parameters that follow from them need not be given."""
    parameters: Parameters
    """Nominal (a-priori) values of the terms' parameters; physically consistent or not."""
    noise: NoiseDescription | None = None
    tolerances: RobotTolerances | None = None
    """Standard deviations of quantities that are not known exactly; None: all are exact."""
    limits: Limits = Field(default_factory=dict)
    """In the user's notation."""
    identification: Identification | None = None
    """Origin and covariance of the values, in a file from an estimate."""


RobotSource = schema.PlainOrSection[schema.FilledText, RobotDescription]
"""The name of an included robot, a path relative to the run file, or the robot itself."""


@dataclass(frozen=True, eq=False)
class ResolvedRobot:
    """A hexapod with all numbers for computations.

    Fields with the name of a key have its unit, frame and shape (`RobotDescription`), as read-only
    arrays; axes are unit vectors.
    """

    name: str
    description: RobotDescription
    """The same robot as the content of a file, with every default and the run's limits, noise and
    tolerances."""
    home: Array
    gravity: Array
    base_joints: Array
    platform_joints: Array
    alpha_axes: Array
    platform_joint_axes: Array
    platform_cardan_axes: Array | None
    drive: Drive
    platform: PlatformKind
    terms: tuple[Term, ...]
    """Blocks of the regressor."""
    constants: tuple[float, ...]
    """Constants of the terms in their order."""
    parameters: Mapping[str, float]
    """Nominal values by name, in the order of the terms."""
    noise: ResolvedNoise | None
    """None when neither robot nor run states any."""
    tolerances: RobotTolerances | None
    limits: Mapping[str, Limit]
    """By key, in the order of the catalogue, with their reserves; without limits that are open or
    implied by another one."""
    characteristic_length: float
    """Scale of rotations in condition numbers, m."""
    source: Path | None = None
    warnings: tuple[str, ...] = ()
    """Valid but suspicious properties."""
    rounded: str = ""
    """Explanation if only the unrounded parameters are physically consistent; else empty."""
    forces_of_voltages: bool = False
    """Whether the forces are those of the motors' voltages at rest, with the damping of the drives
    by the induced voltage."""

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters in their order."""
        return tuple(self.parameters)

    @property
    def constants_by_term(self) -> Mapping[str, Mapping[str, float]]:
        """Constants of every term by their names."""
        values = iter(self.constants)
        return {one.name: {c.name: next(values) for c in one.constants} for one in self.terms}

    @property
    def lacking_terms(self) -> Mapping[str, tuple[float, ...]]:
        """Constants of the terms that the robot lacks and whose parameters have a tolerance.

        The last one is the damping in forces of voltages, whose parameters are known.
        """
        own = [term.name for term in self.terms]
        found = {} if self.tolerances is None else self.tolerances.lacking_terms(own)
        if self.forces_of_voltages and BACK_EMF.name not in own:
            found = {name: found[name] for name in found if name != BACK_EMF.name}
            found[BACK_EMF.name] = ()
        return found

    @property
    def estimated_constants(self) -> tuple[str, ...]:
        """Constants of terms that the file marks for estimation: ``cogging.pitch``."""
        return tuple(
            f"{term.name}.{name}"
            for term in self.description.terms
            for name, constant in term.constants.items()
            if constant.estimate
        )

    @property
    def thread_lead(self) -> float:
        """Lead of the struts' screws, m per turn, positive for a right-handed thread."""
        return self.drive.screw.signed_lead if self.drive.screw is not None else 0.0

    @property
    def shared_joint_pairs(self) -> tuple[tuple[int, int], ...]:
        """Pairs of struts i < j, from zero, with a common base or platform joint."""
        return geo.shared_pairs(self.base_joints, self.platform_joints)

    def struts_at(self, pose: Array) -> geo.StrutGeometry:
        """Return lengths, directions and inverse Jacobian at a pose (6,), m and rad."""
        return geo.geometry_at(pose, self.base_joints, self.platform_joints)


def load_robot_description(name_or_path: str | PathLike[str]) -> ResolvedRobot:
    """Load an included robot by its name, or one from a file, in SI units with every default.

    Raises
    ------
    InputError
        With all problems: the file, its keys and values, or a geometry that is singular at home.

    Examples
    --------
    >>> load_robot_description("palida").base_joints.shape
    (6, 3)
    """
    return resolve_robot(read_robot(find_file(name_or_path, "robot", robot_files())))


def read_robot(path: Path) -> Located[RobotDescription]:
    """Read and validate a robot file, without resolving it."""
    document = read_yaml(path, "robot file", schema.offered_keys(RobotDescription))
    return Located(schema.validate(RobotDescription, document.data, document), document)


def resolve_robot(
    source: Located[RobotDescription],
    limits: Sequence[Located[Mapping[str, Any]]] = (),
    noise: Sequence[Located[NoiseDescription]] = (),
    tolerances: Sequence[Located[RobotTolerances]] = (),
    sampling: float | None = None,
) -> ResolvedRobot:
    """Resolve a robot with the limits, noise, tolerances and sampling (Hz) of a run."""
    description, document = source.value, source.document
    limits = [Located(description.limits, document, (*source.key, "limits")), *limits]
    stated, length = resolve_limits(limits, default_limits(description.home))
    reserve = merge_reserves(limits)
    if description.noise is not None:
        noise = [Located(description.noise, document, (*source.key, "noise")), *noise]
    problems, merged_noise, resolved_noise, merged = list[Problem](), None, None, None
    drive, turning = description.drive, description.platform_cardan_axes is not None
    terms = chosen_terms(description.terms, description.platform, drive, turning=turning)
    with collect(problems):
        merged_noise, resolved_noise = resolve_noise(noise, sampling)
    if description.tolerances is not None:
        own = Located(description.tolerances, document, (*source.key, "tolerances"))
        tolerances = [own, *tolerances]
    with collect(problems):
        merged = merge_tolerances(tolerances, (term.name for term in terms))
    if tolerances:
        sizes = geo.sizes(description.home, description.base_joints, description.platform_joints)
        problems += oversized_tolerances(tolerances, sizes)
    if turning and drive.screw is None:
        message = "only a screw turns with the platform, and the drive has none"
        allowed = "together with drive: {screw: {lead: …}}"
        problems.append(source.problem(("platform_cardan_axes",), message, allowed))
    scale = length
    if scale is None:
        with np.errstate(all="ignore"):
            scale = geo.rms_radius(np.array(description.platform_joints))
    with collect(problems):
        alpha_axes, joint_axes, thread_axes = _axes(source, scale)
    if problems:
        raise InputError(problems)

    written = description.model_copy(
        update={
            "alpha_axes": _rows(alpha_axes),
            "platform_joint_axes": _rows(joint_axes),
            "platform_cardan_axes": _rows(thread_axes),
            "noise": merged_noise,
            "tolerances": merged,
            "limits": limits_as_written(stated, scale, reserve),
        }
    )
    pairs = geo.shared_pairs(np.array(written.base_joints), np.array(written.platform_joints))
    robot = ResolvedRobot(
        name=description.name,
        description=written,
        home=schema.read_only(description.home),
        gravity=schema.read_only(description.gravity),
        base_joints=schema.read_only(description.base_joints),
        platform_joints=schema.read_only(description.platform_joints),
        alpha_axes=schema.read_only(alpha_axes),
        platform_joint_axes=schema.read_only(joint_axes),
        platform_cardan_axes=None if thread_axes is None else schema.read_only(thread_axes),
        drive=drive,
        platform=description.platform,
        terms=terms,
        constants=tuple(c.value for term in description.terms for c in term.constants.values()),
        parameters=description.parameters,
        noise=resolved_noise,
        tolerances=merged,
        limits={
            key: with_shared_joints(limit, pairs).with_reserve(reserve_of(reserve, key))
            for key, limit in stated.items()
        },
        characteristic_length=scale,
        source=document.file,
    )
    before = (
        ()
        if length is not None
        else (
            "limits.characteristic_length is not given: condition numbers count a rotation of "
            f"1 rad as {scale:.4g} m, the rms radius of the platform joints",
        )
    )
    return _with_warnings(robot, source, stated, before, reserve_warnings(reserve, stated))


def _axes(source: Located[RobotDescription], length: float) -> tuple[Array, Array, Array | None]:
    """Return the axes of the struts' joints; refuse faults of the geometry.

    They are first cardan axes at the base, reference axes and first cardan axes at the platform.
    """
    given = source.value
    base_joints, platform_joints = np.array(given.base_joints), np.array(given.platform_joints)
    thread_axes = None
    with np.errstate(all="ignore"):
        home = geo.geometry_at(np.array(given.home), base_joints, platform_joints)
        if given.alpha_axes is None:
            alpha_axes = geo.default_alpha_axes(base_joints, source.problem)
        else:
            alpha_axes = geo.unit_vectors(np.array(given.alpha_axes))
        joint_axes = home.directions @ home.rotation
        if given.platform_joint_axes is not None:
            joint_axes = geo.unit_vectors(np.array(given.platform_joint_axes))
        geo.refuse_unusable(home, alpha_axes, length, source.problem)
        if given.platform_cardan_axes is not None:
            axes = np.array(given.platform_cardan_axes)
            thread_axes = geo.thread_axes(axes, alpha_axes, home, source.problem)
    return alpha_axes, joint_axes, thread_axes


def _rows(axes: Array | None) -> tuple[tuple[float, ...], ...] | None:
    return None if axes is None else tuple(map(tuple, axes.tolist()))


def _with_warnings(
    robot: ResolvedRobot,
    source: Located[RobotDescription],
    stated: Mapping[str, Limit],
    before: Sequence[str],
    of_reserve: Sequence[str],
) -> ResolvedRobot:
    """Return a robot with the warnings about its valid but suspicious properties."""
    description, parameters = robot.description, robot.parameters
    inconsistencies, rounded = plausibility.physical_consistency(
        robot.terms,
        parameters,
        plausibility.rounding_errors(source.document, (*source.key, "parameters"), parameters),
        robot.platform_joints,
        robot.characteristic_length,
        float(np.linalg.norm(robot.gravity)),
    )
    home = robot.struts_at(robot.home)
    warnings = [
        *before,
        *geo.gravity_warnings(robot.gravity, home.joints - robot.base_joints),
        *inconsistencies,
        *of_reserve,
        *plausibility.far_points(
            {
                "base_joints": robot.base_joints,
                "platform_joints": robot.platform_joints,
                "home": robot.home[:3],
            }
        ),
        *plausibility.likely_unit_errors(
            stated, robot.drive, parameters, float(np.max(home.lengths))
        ),
    ]
    if description.bodies is not None:
        implied = description.bodies.parameters(robot.platform_joints)
        warnings += description.bodies.warnings(implied, general=robot.platform == "general")
    if description.identification is not None:
        warnings += description.identification.warnings
    if not source.key:  # a file of its own
        warnings += source.document.warnings
    symmetric = rigid_platform.SYMMETRIC in robot.terms
    if sums := geo.asymmetric_sums(robot.platform_joints) if symmetric else {}:
        warnings.append(
            "the platform is declared symmetric, but its joints are not: `platform: general` has "
            "the five parameters for it. The sums over the joints would be zero: "
            f"{', '.join(f'{name} = {value}' for name, value in sums.items())}"
        )
    return replace(robot, warnings=tuple(warnings), rounded=rounded)


def as_general(description: RobotDescription) -> RobotDescription:
    """Return the same machine with all ten parameters of its platform."""
    terms = chosen_terms(description.terms, "general", description.drive)
    values = {one.name: description.parameters.get(one.name, 0.0) for one in parameters_of(terms)}
    return description.model_copy(update={"platform": "general", "parameters": values})


def add_payload(robot: ResolvedRobot, payload: Sequence[BodyDescription]) -> ResolvedRobot:
    """Return a robot with a general platform and bodies on it; its `description` has none."""
    added = payload_parameters(payload)
    values = {name: value + added.get(name, 0.0) for name, value in robot.parameters.items()}
    return replace(robot, parameters=values) if payload else robot


def add_lacking_terms(robot: ResolvedRobot, values: Sequence[float] = ()) -> ResolvedRobot:
    """Return a robot with its lacking terms, whose parameters are zero or have these values.

    They follow its own terms, and have no tolerances any more. The damping in forces of voltages is
    that of the motors.
    """
    lacking = robot.lacking_terms
    terms = terms_named(lacking, general=robot.platform == "general")
    names = [parameter.name for parameter in parameters_of(terms)]
    damping = robot.drive.back_emf if BACK_EMF.name in lacking else ()
    values = values or (0.0,) * (len(names) - len(damping))
    added = dict(zip(names, (*values, *damping), strict=True))
    described = tuple(
        TermDescription(
            name=term.name,
            constants={
                one.name: ConstantDescription(value=value)
                for one, value in zip(term.constants, lacking[term.name], strict=True)
            },
        )
        for term in terms
    )
    about = robot.description
    stated = {
        "terms": (*about.terms, *described),
        "parameters": {**about.parameters, **added},
        "tolerances": about.tolerances and about.tolerances.without_terms(lacking),
    }
    return replace(
        robot,
        description=about.model_copy(update=stated),
        terms=(*robot.terms, *terms),
        constants=(*robot.constants, *chain.from_iterable(lacking.values())),
        parameters={**robot.parameters, **added},
        tolerances=robot.tolerances and robot.tolerances.without_terms(lacking),
    )
