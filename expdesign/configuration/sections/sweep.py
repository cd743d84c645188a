"""`sweep:`, a grid of designs: key paths of the run file, each with the values that it takes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import cache, partial
from math import prod
from typing import Annotated, Any, get_args

from pydantic import AfterValidator, BeforeValidator
from pydantic.fields import FieldInfo

from constraints import limit_definitions
from expdesign.configuration.errors import nearest, refusal, shown
from expdesign.configuration.fields import at_least, by_key
from expdesign.configuration.limits import CHARACTERISTIC_LENGTH, RESERVE
from expdesign.configuration.quantity import NUMBER, Dimension
from expdesign.configuration.section import Section
from expdesign.configuration.sections.design import DesignSection, TrajectorySection
from expdesign.configuration.sections.experiment import ExperimentSection

MOST_DESIGNS = 200
"""Of one sweep: days of work, each a run folder."""

LIMITS = "limits"
SCALE = "scale"
"""Last part of a path whose values are factors of a limit's bounds, not bounds."""
FREQUENCY = "trajectory.frequency"
"""Here one value stands for two equal bounds."""

_SECTIONS: dict[str, tuple[type[Section], tuple[str, ...]]] = {
    "trajectory": (TrajectorySection, tuple(TrajectorySection.model_fields)),
    "design": (DesignSection, tuple(DesignSection.model_fields)),
    "experiment": (ExperimentSection, ("periods", "sampling")),
}
"""Sections that a design is made from, with those of their keys that it depends on."""

_ALLOWED = (
    "trajectory.KEY, design.KEY, experiment.periods, experiment.sampling, limits.KEY, "
    f"limits.KEY.COMPONENT, limits.KEY.{SCALE}"
)
_values: Callable[..., Any] = at_least(1, "values", MOST_DESIGNS).func


@cache
def path_units() -> dict[str, str]:
    """Return the key paths that can be swept, with the unit of plain numbers there.

    It is ``"1"`` for pure numbers, and empty where no numbers stand.
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
    """Return the unit that a key's plain numbers have: that of what reads them."""
    dimensions = [part for part in _parts(info) if isinstance(part, Dimension)]
    if dimensions:
        return dimensions[0].unit
    return "1" if any(part in (int, float) for part in _parts(info)) else ""


def _parts(annotation: Any) -> Iterator[Any]:
    """Yield the types in an annotation, and the dimensions of what reads quantities."""
    if isinstance(annotation, FieldInfo):
        yield from _parts(annotation.annotation)
    inner = annotation.metadata if isinstance(annotation, FieldInfo) else get_args(annotation)
    for part in inner:
        yield from _parts(part)
    if isinstance(annotation, BeforeValidator):
        yield getattr(annotation.func, "__self__", None)
    yield annotation


def _listed(path: str, value: object) -> tuple[Any, ...]:
    """Return the values of a path that can be swept."""
    valid = path_units()
    if path not in valid:
        raise refusal(f"unknown key path {shown(path)}", _ALLOWED, partial(nearest, path, valid))
    values = tuple(_values(value))
    texts = [json.dumps(one, sort_keys=True, default=repr) for one in values]
    for number, text in enumerate(texts):
        if text in texts[:number]:
            raise refusal(f"{shown(values[number])} is listed twice", "each one once")
    if is_scale(path):
        for one in values:
            if NUMBER.parse(one) <= 0:
                raise refusal(f"the factor {shown(one)} is not positive", "factors above 0")
    return values


def is_scale(path: str) -> bool:
    """Tell whether the values of a path are factors of a limit's bounds."""
    return path.startswith(f"{LIMITS}.") and path.endswith(f".{SCALE}")


def _grid(paths: dict[str, tuple[Any, ...]]) -> dict[str, tuple[Any, ...]]:
    """Refuse paths that do not make a grid, or one that is too large."""
    if not paths:
        raise refusal("the sweep names no key", f"key paths with lists of values: {_ALLOWED}")
    for path in paths:
        for other in paths:
            # A scale changes all of its limit, and so does the limit itself.
            whole, part = (one.removesuffix(f".{SCALE}") for one in (path, other))
            if other != path and (part == whole or part.startswith(f"{whole}.")):
                raise refusal(f"it changes a part of {path}, too", "one of the two", key=other)
    count = prod(len(values) for values in paths.values())
    if count > MOST_DESIGNS:
        sizes = " · ".join(str(len(values)) for values in paths.values())
        message = f"{sizes} = {count} designs" if len(paths) > 1 else f"{count} designs"
        raise refusal(f"the grid has {message}", f"{MOST_DESIGNS} designs at most")
    return paths


Sweep = Annotated[
    dict[str, tuple[Any, ...]],
    by_key(_listed, "key paths with lists of values"),
    AfterValidator(_grid),
]
"""Key paths with their values, as they are written."""
