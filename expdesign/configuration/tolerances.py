"""`tolerances:` of robot and run: standard deviations of quantities that are not known exactly."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Annotated, Any

import numpy as np

from expdesign.configuration.document import Located
from expdesign.configuration.errors import Problem, nearest_name, quote, refusal
from expdesign.configuration.fields import by_key, check_choice, per_strut, read_entries, repeated
from expdesign.configuration.quantity import (
    Angle,
    Duration,
    Length,
    NotNegative,
    Share,
    quantity_in,
)
from expdesign.configuration.section import Section
from expdesign.mechanism.catalogue import term_definitions
from expdesign.mechanism.hexapod import ACTUATORS

_SPACE = 3
_Coordinates = Annotated[
    tuple[
        Annotated[
            tuple[Annotated[Length, NotNegative], ...],
            repeated(_SPACE, "coordinates", "one length for all coordinates"),
        ],
        ...,
    ],
    repeated(ACTUATORS, "joints", "one length for all coordinates of all joints"),
]


def _read_constants(term: str, value: object) -> dict[str, float]:
    """Read the standard deviations of a term's constants, in their SI units."""
    constants = {constant.name: constant for constant in term_definitions()[term].constants}
    allowed = ", ".join(constants) or f"none: {term} has no constants"
    if not isinstance(value, Mapping):
        raise refusal(f"{quote(value)} is not a mapping", f"standard deviations of: {allowed}")

    def read(name: str, item: object) -> float:
        if name not in constants:
            reason = f"the term {term} has no constant {quote(name)}"
            raise refusal(reason, allowed, partial(nearest_name, name, constants))
        number = quantity_in(constants[name].unit).parse(item)
        if number < 0:
            raise refusal(f"{number:g} is negative", "a standard deviation of 0 or more")
        return number

    return read_entries(value, read, (term,))


class ForceConstantTolerance(Section):
    """Standard deviations of the force constants, as shares."""

    common: Annotated[Share, NotNegative] | None = None
    """Common to all actuators."""
    each: Annotated[tuple[Annotated[Share, NotNegative], ...], per_strut("shares")] | None = None
    """Individual part of each actuator."""


class RobotTolerances(Section):
    """Standard deviations of quantities that are not known exactly, SI; None and 0: exact."""

    base_joints: _Coordinates | None = None
    """(6, 3), m, of the coordinates in the base frame."""
    platform_joints: _Coordinates | None = None
    """(6, 3), m, of the coordinates in the platform frame."""
    strut_length: (
        Annotated[tuple[Annotated[Length, NotNegative], ...], per_strut("lengths")] | None
    ) = None
    """(6,), m, zero of each length measurement."""
    force_constant: ForceConstantTolerance | None = None
    gravity: Annotated[Angle, NotNegative] | None = None
    """rad, of its direction, about each of two axes across it."""
    delay: Annotated[Duration, NotNegative] | None = None
    """s, of the forces against the lengths."""
    clock: Annotated[Share, NotNegative] | None = None
    """Rate of the recording's clock, as a share."""
    terms: (
        Annotated[
            dict[str, dict[str, float]],
            by_key(
                _read_constants,
                "terms with their constants",
                check_choice(term_definitions, "term"),
            ),
        ]
        | None
    ) = None
    """Constants of the terms, SI: {term: {constant: standard deviation}}."""

    @property
    def inexact(self) -> bool:
        """True with any tolerance above 0."""
        return _any_positive(self.model_dump())


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
    """Yield problems of tolerances that are not smaller than the part itself.

    Parameters
    ----------
    sizes : mapping
        Sizes of the parts by the key of their tolerance, m.
    """
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
) -> tuple[RobotTolerances | None, list[Problem]]:
    """Merge the tolerances of robot and run.

    Parameters
    ----------
    sources : sequence of Located[RobotTolerances]
        Later ones override earlier ones by key, also inside `force_constant` and `terms`.
    terms : iterable of str
        Terms of the robot.

    Returns
    -------
    tolerances
        None without sources, or with problems.
    problems
        Constants of terms that the robot lacks.
    """
    if not sources:
        return None, []
    present, merged, problems = list(terms), dict[str, Any](), list[Problem]()
    for source in sources:
        given = source.value.model_dump(exclude_none=True)
        problems += [
            source.problem(("terms", name), f"the robot has no term {name}", ", ".join(present))
            for name in given.get("terms", {})
            if name not in present
        ]
        merged = _update(merged, given)
    return (None, problems) if problems else (RobotTolerances.model_validate(merged), [])


def _update(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return a nested mapping with the values of another one."""
    result = dict(below)
    for key, value in above.items():
        nested = isinstance(value, Mapping) and isinstance(result.get(key), Mapping)
        result[key] = _update(result[key], value) if nested else value
    return result
