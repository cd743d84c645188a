"""Uncertainty of robot files: `tolerances:` by the user, and `identification:` from an estimate."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import model_validator

from expdesign.configuration import schema
from expdesign.configuration.document import Located
from expdesign.configuration.errors import InputError, Problem, nearest_name, quote, refusal
from expdesign.configuration.quantity import (
    SHARE,
    Angle,
    Duration,
    Length,
    NotNegative,
    Number,
    Share,
    quantity_in,
)
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.term import Term
from expdesign.mechanism.terms import term_definitions

IDENTIFIED_ROBOT = "identified-robot.yaml"
"""File of the estimated robot in a run folder."""
IDENTIFIED = "-identified"
"""Suffix of the name of an estimated robot."""
Matrix = tuple[tuple[Number, ...], ...]


def machine_name(robot: str) -> str:
    """Return the name of the machine for that of a robot, identified or not.

    Examples
    --------
    >>> machine_name("lab-identified")
    'lab'
    """
    return robot.removesuffix(IDENTIFIED)


def identified_name(robot: str) -> str:
    """Return the name for an estimate of a robot; the robot's name if it would become too long.

    Examples
    --------
    >>> identified_name("lab")
    'lab-identified'
    """
    name = machine_name(robot) + IDENTIFIED
    return name if len(name) <= schema.LONGEST_NAME else robot


class IdentifiedDeviation(schema.Section):
    """A quantity with a tolerance, SI."""

    name: str
    """As in tables/deviations.csv."""
    tolerance: Annotated[Number, NotNegative]
    value: Number
    """Estimate, already applied to the robot's geometry, gravity and constants, but not to terms
    that the robot lacks; zero if it was not estimated."""
    std: Annotated[Number, NotNegative]


class Identification(schema.Section):
    """Origin of the robot's parameters, and their covariance, SI."""

    run: str
    """Name of the run."""
    estimator: str
    verdict: Literal["accepted", "doubtful", "not judged"]
    summary: str = ""
    """The verdict in words."""
    recordings: tuple[str, ...] = ()
    """SHA-256 of lengths and forces of each recording in the estimate and in its prior."""
    parameters: Annotated[tuple[str, ...], schema.at_least(1, "parameters")]
    """Order of rows and columns."""
    constants: tuple[str, ...] = ()
    """Constants of terms, estimated with the parameters: ``cogging_pitch``. Their c rows and
    columns follow those of the parameters."""
    unconstrained: tuple[Number, ...] = ()
    """Estimate before the projection to the nearest physically consistent parameters."""
    covariance_random: Matrix
    """(m + c) × (m + c): random share, new in every recording of the machine."""
    covariance_systematic: Matrix
    """(m + c) × (m + c): systematic share, common to all recordings of the machine."""
    deviations: tuple[IdentifiedDeviation, ...] = ()
    """Sources of the systematic share."""
    response: Matrix = ()
    """(m + c) × t: errors of parameters and constants per unit of each deviation."""
    covariance_deviations: Matrix = ()
    """(m + t) × t: covariance of the errors of parameters and deviations, all shares, with those of
    the deviations; empty if these were not estimated."""

    @model_validator(mode="after")
    def _check_sizes(self) -> Identification:
        count, others = len(self.parameters), len(self.deviations)
        joint = len(self.covariance_deviations) > 0
        if len(self.unconstrained) not in (0, count):
            reason = "unconstrained does not fit the parameters"
            raise refusal(reason, f"{count} numbers", key="unconstrained")
        count += len(self.constants)
        for key, rows, columns in (
            ("covariance_random", count, count),
            ("covariance_systematic", count, count),
            ("response", count if others else 0, others),
            ("covariance_deviations", len(self.parameters) + others if joint else 0, others),
        ):
            matrix = getattr(self, key)
            if len(matrix) != rows or any(len(row) != columns for row in matrix):
                reason = f"{key} does not fit the parameters, constants and deviations"
                raise refusal(reason, f"{rows} rows of {columns} numbers", key=key)
        return self

    def for_parameters(self, values: Mapping[str, float]) -> Identification:
        """Return the identification for other parameters with their values, (m').

        Further ones are known exactly, those that are left out must be.
        """
        old = {name: place for place, name in enumerate(self.parameters)}
        places = [old.get(name, -1) for name in values]

        def select(matrix: Matrix, axes: int) -> Matrix:
            """Return the rows, with two axes also the columns, of the parameters and others."""
            found = np.array(matrix)
            for axis in range(axes):
                others = range(len(old), found.shape[axis])
                padded = np.pad(found, [(0, int(one == axis)) for one in range(found.ndim)])
                found = np.take(padded, [*places, *others], axis=axis)
            return tuple(map(tuple, found.tolist()))

        before = dict(zip(self.parameters, self.unconstrained, strict=False))
        changes = {
            "parameters": tuple(values),
            "unconstrained": tuple({**values, **before}[name] for name in values if before),
            "covariance_random": select(self.covariance_random, 2),
            "covariance_systematic": select(self.covariance_systematic, 2),
            "response": self.response and select(self.response, 1),
            "covariance_deviations": self.covariance_deviations
            and select(self.covariance_deviations, 1),
        }
        return self.model_copy(update=changes)

    @property
    def warnings(self) -> list[str]:
        """Warnings for the use of the robot."""
        if self.verdict == "accepted":
            return []
        words = f" ({self.summary})" if self.summary else ""
        return [
            f"the parameters come from the estimate of the run {self.run}, which is "
            f"{self.verdict}{words}"
        ]


_SPACE = 3
_Coordinates = Annotated[
    tuple[
        Annotated[
            tuple[Annotated[Length, NotNegative], ...],
            schema.repeated(_SPACE, "coordinates", "one length for all coordinates"),
        ],
        ...,
    ],
    schema.repeated(ACTUATORS, "joints", "one length for all coordinates of all joints"),
]


EACH_PARAMETER = "std"
"""Key of the standard deviation of each parameter of a lacking term."""


def _read_term(term: str, value: object) -> dict[str, float]:
    """Read the numbers of a term in the units of its constants and parameters."""
    definition = term_definitions()[term]
    parameters = {one.name: one.unit for one in definition.parameters}
    units = {one.name: one.unit for one in definition.constants} | parameters
    shared = set(parameters.values())
    if len(shared) == 1:
        units[EACH_PARAMETER] = shared.pop()

    def read(name: str, item: object) -> float:
        if name == EACH_PARAMETER and name not in units and item == 0:
            return 0.0
        if name == EACH_PARAMETER and name not in units:
            reason = f"the parameters of {term} have different units"
            raise refusal(reason, f"a standard deviation for each: {', '.join(parameters)}")
        if name not in units:
            reason = f"the term {term} has no constant {quote(name)} and no such parameter"
            raise refusal(reason, ", ".join(units), partial(nearest_name, name, units))
        number = (SHARE if units[name] == "1" else quantity_in(units[name])).parse(item)
        if number < 0 and name in (EACH_PARAMETER, *parameters):
            raise refusal(f"{number:g} is negative", "a standard deviation of 0 or more")
        return number

    if isinstance(value, Mapping):
        return schema.read_entries(value, read, (term,))
    return {EACH_PARAMETER: read(EACH_PARAMETER, value)}


_Delays = schema.PerStrut[Annotated[Duration, NotNegative]]


class ForceConstantTolerance(schema.Section):
    """Standard deviations of the force constants, or of constants of motors, as shares."""

    common: Annotated[Share, NotNegative] | None = None
    """Common to all actuators."""
    each: schema.PerStrut[Annotated[Share, NotNegative]] | None = None
    """Individual part of each actuator."""


class MotorTolerance(schema.Section):
    """Standard deviations of the motors' constants, as shares, for recordings of voltages."""

    constant: ForceConstantTolerance | None = None
    resistance: ForceConstantTolerance | None = None
    supply: ForceConstantTolerance | None = None
    """Of the voltages themselves as well."""


class ChannelTimeTolerance(schema.Section):
    """Standard deviations of delays or time constants of single channels, s, one or six."""

    forces: _Delays | None = None
    lengths: _Delays | None = None


class RobotTolerances(schema.Section):
    """Standard deviations of quantities that are not known exactly, SI; None and 0: exact."""

    base_joints: _Coordinates | None = None
    """(6, 3), m, of the coordinates in the base frame."""
    platform_joints: _Coordinates | None = None
    """(6, 3), m, of the coordinates in the platform frame."""
    strut_length: schema.PerStrut[Annotated[Length, NotNegative]] | None = None
    """(6,), m, zero of each length measurement."""
    force_constant: ForceConstantTolerance | None = None
    motor: MotorTolerance | None = None
    """For recordings of voltages, where it takes the place of `force_constant`."""
    gravity: Annotated[Angle, NotNegative] | None = None
    """rad, of its direction, about each of two axes across it."""
    delay: Annotated[Duration, NotNegative] | None = None
    """s, of the forces against the lengths."""
    channel_delay: ChannelTimeTolerance | None = None
    """s, of single channels of forces and lengths."""
    low_pass: ChannelTimeTolerance | None = None
    """s, root mean squares of the time constants of first-order low passes of single channels."""
    clock: Annotated[Share, NotNegative] | None = None
    """Rate of the recording's clock, as a share."""
    terms: (
        Annotated[
            dict[str, dict[str, float]],
            schema.by_key(
                _read_term,
                "terms with their constants, or lacking terms with a standard deviation",
                schema.check_choice(term_definitions, "term"),
            ),
        ]
        | None
    ) = None
    """Standard deviations of the constants of the robot's terms, SI: {term: {constant: std}}; or of
    the parameters of a term that it lacks, with the values of its constants:
    {term: {std: …, constant: value}}, or a single number; 0: the machine has no such term."""

    def lacking_terms(self, present: Iterable[str]) -> dict[str, tuple[float, ...]]:
        """Return the constants of terms that are not present, but may act, in their order."""
        given, own = self.terms or {}, frozenset(present)
        return {
            name: tuple(given[name].get(one.name, one.default or 0.0) for one in term.constants)
            for name, term in term_definitions().items()
            if name in given and name not in own and _sizes(term, given[name], least=0.0)
        }

    @property
    def stated_terms(self) -> frozenset[str]:
        """Terms with a standard deviation, perhaps zero, of each of their parameters."""
        return frozenset(
            name
            for name, own in (self.terms or {}).items()
            if EACH_PARAMETER in own
            or {one.name for one in term_definitions()[name].parameters} <= set(own)
        )

    def without_terms(self, names: Iterable[str]) -> RobotTolerances:
        """Return the tolerances without those of some terms."""
        kept = {name: own for name, own in (self.terms or {}).items() if name not in set(names)}
        return self.model_copy(update={"terms": kept or None})

    @property
    def inexact(self) -> bool:
        """True with any tolerance above 0."""
        return _any_positive(self.model_dump())


def _sizes(term: Term, given: Mapping[str, float], least: float = -1.0) -> set[str]:
    """Return the keys with standard deviations of a term's parameters, above the least."""
    keys = {EACH_PARAMETER, *(one.name for one in term.parameters)}
    return {key for key, value in given.items() if key in keys and value > least}


def _any_positive(value: object) -> bool:
    if isinstance(value, Mapping):
        return any(map(_any_positive, value.values()))
    if isinstance(value, list | tuple):
        return any(map(_any_positive, value))
    return isinstance(value, float) and value > 0


_SIZES = {
    "base_joints": "the joints' rms distance from their middle is",
    "platform_joints": "the joints' rms distance from their middle is",
    "strut_length": "the shortest strut at home has",
}


def oversized_tolerances(
    sources: Sequence[Located[RobotTolerances]], sizes: Mapping[str, float]
) -> Iterator[Problem]:
    """Yield problems of tolerances that are not smaller than the part itself; sizes in m."""
    for source in sources:
        for key, size in sizes.items():
            largest = float(np.max(getattr(source.value, key) or 0.0))
            if largest >= size > 0:
                message = (
                    f"a standard deviation of {largest:g} m is not smaller than the part itself: "
                    f"{_SIZES[key]} {size:.3g} m"
                )
                allowed = "a standard deviation that is small against that"
                yield source.problem((key,), message, allowed)


def merge_tolerances(
    sources: Sequence[Located[RobotTolerances]], terms: Iterable[str]
) -> RobotTolerances | None:
    """Merge the tolerances of robot and run for a robot with these terms.

    Later ones override earlier ones by key, also inside `force_constant` and `terms`.
    """
    if not sources:
        return None
    present, merged, problems = list(terms), dict[str, Any](), list[Problem]()
    for source in sources:
        given = source.value.model_dump(exclude_none=True)
        merged = _update(merged, given)
        for name in given.get("terms", {}):
            faults = _faults_of_term(name, merged["terms"][name], present, merged["terms"])
            problems += [source.problem(("terms", name), *fault) for fault in faults]
    if problems:
        raise InputError(problems)
    return RobotTolerances.model_validate(merged)


def _faults_of_term(
    name: str, given: Mapping[str, float], present: Sequence[str], stated: Iterable[str]
) -> Iterator[tuple[str, str]]:
    """Yield the faults of one term's tolerances with the allowed values."""
    term = term_definitions()[name]
    constants = ", ".join(one.name for one in term.constants) or "none"
    sizes, acts = _sizes(term, given), bool(_sizes(term, given, least=0.0))
    if name in present:
        if sizes:
            yield (
                f"{name} is a term of the robot: its parameters are estimated already",
                f"standard deviations of its constants: {constants}",
            )
        elif any(value < 0 for value in given.values()):
            yield f"a standard deviation of {name} is negative", "0 or more"
        return
    if not sizes:
        yield (
            f"the robot has no term {name}, and no standard deviation of its parameters is given",
            f"{', '.join(present)}; or {EACH_PARAMETER}, with the term's constants: {constants}",
        )
    for one in term.constants:
        if one.name not in given and one.default is None and acts:
            yield f"{name}.{one.name} is missing", f"{{{EACH_PARAMETER}: …, {one.name}: …}}"
        elif one.positive and given.get(one.name, 1.0) <= 0:
            yield f"{name}.{one.name} is not positive", "a value above 0"
    partner = term.constants_of
    if acts and partner and partner not in (*present, *stated):
        yield f"the term '{name}' takes the constants of '{partner}'", f"{partner}, too"


def _update(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return a nested mapping with the values of another one."""
    result = dict(below)
    for key, value in above.items():
        nested = isinstance(value, Mapping) and isinstance(result.get(key), Mapping)
        result[key] = _update(result[key], value) if nested else value
    return result
