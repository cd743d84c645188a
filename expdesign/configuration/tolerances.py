"""`tolerances:` of robot and run: standard deviations of what is not known exactly."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Annotated, Any

import numpy as np
from pydantic import BeforeValidator

from expdesign.configuration.document import Placed
from expdesign.configuration.errors import Problem, nearest, refusal, shown
from expdesign.configuration.fields import by_key, each_read, exactly, known
from expdesign.configuration.quantity import (
    LENGTH,
    SHARE,
    Angle,
    Dimension,
    Duration,
    Length,
    NotNegative,
    Share,
    dimension_of,
)
from expdesign.configuration.section import Section
from expdesign.mechanism.catalogue import term_definitions
from expdesign.mechanism.hexapod import ACTUATORS

_SPACE = 3
_STD = "a standard deviation of 0 or more"


def _parsed(dimension: Dimension, value: object) -> float:
    number = dimension.parse(value)
    if number < 0:
        raise refusal(f"{number:g} is negative", _STD)
    return number


def _spread(value: object, dimension: Dimension, counts: Sequence[int], wanted: str) -> object:
    """Return one value as it is repeated in lists of these lengths; other lists as they are."""
    if not counts:
        return value
    if isinstance(value, list | tuple):
        if len(value) != counts[0]:
            raise refusal(f"there are {len(value)} values where {counts[0]} are needed", wanted)
        return [_spread(item, dimension, counts[1:], wanted) for item in value]
    number: object = _parsed(dimension, value)
    for count in reversed(counts):
        number = [number] * count
    return number


def _repeated(dimension: Dimension, counts: Sequence[int], wanted: str) -> BeforeValidator:
    return BeforeValidator(lambda value: _spread(value, dimension, counts, wanted))


_Coordinates = Annotated[
    tuple[
        Annotated[tuple[Annotated[Length, NotNegative], ...], exactly(_SPACE, "coordinates")], ...
    ],
    _repeated(
        LENGTH,
        (ACTUATORS, _SPACE),
        f"one length for every coordinate, {ACTUATORS} (one for each joint), or {ACTUATORS} "
        "triples [x, y, z]",
    ),
]
_EachLength = Annotated[
    tuple[Annotated[Length, NotNegative], ...],
    _repeated(LENGTH, (ACTUATORS,), f"one length for all struts, or a list of {ACTUATORS}"),
]
_EachShare = Annotated[
    tuple[Annotated[Share, NotNegative], ...],
    _repeated(SHARE, (ACTUATORS,), f"one share for all actuators, or a list of {ACTUATORS}"),
]


def _constants(term: str, value: object) -> dict[str, float]:
    """Read the standard deviations of a term's constants, in their SI units."""
    constants = {constant.name: constant for constant in term_definitions()[term].constants}
    allowed = ", ".join(constants) or f"none: {term} has no constants"
    if not isinstance(value, Mapping):
        raise refusal(f"{shown(value)} is not a mapping", f"standard deviations of: {allowed}")

    def read(name: str, item: object) -> float:
        if name not in constants:
            reason = f"the term {term} has no constant {shown(name)}"
            raise refusal(reason, allowed, partial(nearest, name, constants))
        return _parsed(dimension_of(constants[name].unit), item)

    return each_read(value, read, (term,))


class ForceConstantTolerance(Section):
    """Of force constants, as shares: what all of them have in common, and each one's own."""

    common: Annotated[Share, NotNegative] | None = None
    each: _EachShare | None = None


class Tolerances(Section):
    """Standard deviations of what is not known exactly, SI; None and 0: exact."""

    base_joints: _Coordinates | None = None
    """(6, 3), m, of the coordinates in the base frame."""
    platform_joints: _Coordinates | None = None
    """(6, 3), m, of the coordinates in the platform frame."""
    strut_length: _EachLength | None = None
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
            by_key(_constants, "terms with their constants", known(term_definitions, "term")),
        ]
        | None
    ) = None
    """Constants of the terms, SI: {term: {constant: standard deviation}}."""

    @property
    def inexact(self) -> bool:
        """Whether anything has a tolerance above 0."""
        return _positive(self.model_dump())


def _positive(value: object) -> bool:
    if isinstance(value, Mapping):
        return any(map(_positive, value.values()))
    if isinstance(value, list | tuple):
        return any(map(_positive, value))
    return isinstance(value, float) and value > 0


def too_large(
    sources: Sequence[Placed[Tolerances]], sizes: Mapping[str, float]
) -> Iterator[Problem]:
    """Name lengths of which nothing is known: tolerances not smaller than the part itself.

    `sizes` are those of the parts, m, by the key of their tolerance.
    """
    for source in sources:
        for key, size in sizes.items():
            largest = float(np.max(getattr(source.value, key) or 0.0))
            if largest >= size > 0:
                yield source.problem(
                    (key,),
                    f"a standard deviation of {largest:g} m leaves nothing that is known: "
                    f"{_SIZES[key]} {size:.3g} m",
                    "a standard deviation that is small against that",
                )


_SIZES = {
    "base_joints": "the joints' rms distance from their middle is",
    "platform_joints": "the joints' rms distance from their middle is",
    "strut_length": "the shortest strut at home has",
}


def merged_tolerances(
    sources: Sequence[Placed[Tolerances]], terms: Iterable[str]
) -> tuple[Tolerances | None, list[Problem]]:
    """Merge the tolerances of robot and run.

    Parameters
    ----------
    sources : sequence of Placed[Tolerances]
        Later ones override earlier ones key by key, those of `force_constant` and of `terms`
        each for itself.
    terms : iterable of str
        Those that the robot has.

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
        merged = _over(merged, given)
    return (None, problems) if problems else (Tolerances.model_validate(merged), [])


def _over(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping of mappings with another one's values in place of its own."""
    result = dict(below)
    for key, value in above.items():
        nested = isinstance(value, Mapping) and isinstance(result.get(key), Mapping)
        result[key] = _over(result[key], value) if nested else value
    return result
