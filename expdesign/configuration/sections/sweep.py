"""`sweep:`: a grid of designs, from key paths of the run file with their values."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import cache, partial
from math import prod
from typing import Annotated, Any, get_args

from pydantic import AfterValidator
from pydantic.fields import FieldInfo

from constraints import limit_definitions
from expdesign.configuration.errors import nearest_name, quote, refusal
from expdesign.configuration.fields import at_least, by_key
from expdesign.configuration.limits import CHARACTERISTIC_LENGTH, RESERVE
from expdesign.configuration.quantity import NUMBER, Quantity
from expdesign.configuration.section import Section
from expdesign.configuration.sections.design import DesignSection, TrajectorySection
from expdesign.configuration.sections.experiment import ExperimentSection

MOST_DESIGNS = 200
"""Largest number of designs in one sweep: days of work."""

LIMITS = "limits"
SCALE = "scale"
"""Last part of a path with factors of a limit's bounds instead of bounds."""
FREQUENCY = "trajectory.frequency"
"""Path at which one value means two equal bounds."""

_SECTIONS: dict[str, tuple[type[Section], tuple[str, ...]]] = {
    "trajectory": (TrajectorySection, tuple(TrajectorySection.model_fields)),
    "design": (DesignSection, tuple(DesignSection.model_fields)),
    "experiment": (ExperimentSection, ("periods", "sampling")),
}
"""Sections and keys that a design depends on."""

_ALLOWED = (
    "trajectory.KEY, design.KEY, experiment.periods, experiment.sampling, limits.KEY, "
    f"limits.KEY.COMPONENT, limits.KEY.{SCALE}"
)
_values: Callable[..., Any] = at_least(1, "values", MOST_DESIGNS).func


@cache
def path_units() -> dict[str, str]:
    """Return the key paths for sweeps, with the unit of their plain numbers.

    The unit is ``"1"`` for pure numbers, and empty for texts.

    Examples
    --------
    >>> path_units()["trajectory.frequency"]
    'Hz'
    """
    found = {
        f"{name}.{key}": _unit(section.model_fields[key])
        for name, (section, keys) in _SECTIONS.items()
        for key in keys
    }
    for key, definition in limit_definitions().items():
        place = f"{LIMITS}.{key}"
        found[place] = definition.unit
        found |= {f"{place}.{component}": definition.unit for component in definition.components}
        found[f"{place}.{SCALE}"] = "1"
    return found | {f"{LIMITS}.{CHARACTERISTIC_LENGTH}": "m", f"{LIMITS}.{RESERVE}": "1"}


def _unit(info: FieldInfo) -> str:
    """Return the unit of a key's plain numbers."""
    parts = [*_parts(info.annotation), *info.metadata]
    units = [part.unit for part in parts if isinstance(part, Quantity)]
    return units[0] if units else "1" if any(part in (int, float) for part in parts) else ""


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield the types and annotations inside a type."""
    for part in get_args(annotation):
        yield from _parts(part)
    yield annotation


def _read_values(path: str, value: object) -> tuple[Any, ...]:
    """Return the values of a path."""
    valid = path_units()
    if path not in valid:
        raise refusal(
            f"unknown key path {quote(path)}", _ALLOWED, partial(nearest_name, path, valid)
        )
    values = tuple(_values(value))
    texts = [json.dumps(one, sort_keys=True, default=repr) for one in values]
    for number, text in enumerate(texts):
        if text in texts[:number]:
            raise refusal(f"{quote(values[number])} is listed twice", "each one once")
    if is_scale(path):
        for one in values:
            if NUMBER.parse(one) <= 0:
                raise refusal(f"the factor {quote(one)} is not positive", "factors above 0")
    return values


def is_scale(path: str) -> bool:
    """Return True for a path with factors of a limit's bounds."""
    return path.startswith(f"{LIMITS}.") and path.endswith(f".{SCALE}")


def _check_grid(paths: dict[str, tuple[Any, ...]]) -> dict[str, tuple[Any, ...]]:
    """Refuse overlapping paths and a grid that is too large."""
    if not paths:
        raise refusal("the sweep names no key", f"key paths with lists of values: {_ALLOWED}")
    for path in paths:
        for other in paths:
            # A scale changes all of its limit, as does the limit itself.
            whole, part = (one.removesuffix(f".{SCALE}") for one in (path, other))
            if other != path and (part == whole or part.startswith(f"{whole}.")):
                raise refusal(f"it overlaps with {path}", "one of the two", key=other)
    count = prod(len(values) for values in paths.values())
    if count > MOST_DESIGNS:
        sizes = " · ".join(str(len(values)) for values in paths.values())
        message = f"{sizes} = {count} designs" if len(paths) > 1 else f"{count} designs"
        raise refusal(f"the grid has {message}", f"{MOST_DESIGNS} designs at most")
    return paths


Sweep = Annotated[
    dict[str, tuple[Any, ...]],
    by_key(_read_values, "key paths with lists of values"),
    AfterValidator(_check_grid),
]
"""Key paths with their values, in the user's notation."""
