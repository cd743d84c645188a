"""The files of a control model from their templates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape

from constraints.arrays import Array
from estimation.controlmodel.instructions import Language, Lines, lines
from estimation.controlmodel.model import DOUBLE, SINGLE, ControlModel
from estimation.controlmodel.numbers import (
    home,
    plain,
    robot_constants,
    uncertainty_lines,
)
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES

_OUTPUTS = {"lengths": ("lengths",), "rates": ("rates",), "slope": ("lengths", "matrix")}
_FORCES, _LOAD = ("transposed", "forces", "along"), ("transposed", "load", "along")
"""What is stored in C and Python by the functions of `model_functions`."""
_CARRIED = "carry(matrix, along, load)"
"""Makes the load of its wrench."""


@dataclass(frozen=True)
class Body:
    """One function of a file."""

    does: str
    inputs: tuple[str, ...]
    unread: tuple[str, ...]
    """Inputs that it does not depend on."""
    loaded: bool
    code: Lines


def context(model: ControlModel, language: Language) -> dict[str, Any]:
    """Return what templates are filled with: bodies of functions, constants and vectors."""
    constants = robot_constants(model)
    groups = [constant.places for constant in constants]
    *geometry, own, parameters = groups
    machine = [[place for group in geometry for place in group], own, parameters]
    bodies: dict[str, Body] = {}
    for name, each in model.functions.items():
        inputs = [[f"{key}[{k}]" for k in range(COORDINATES)] for key in each.inputs]
        keys = _OUTPUTS.get(name, (*_LOAD, *_FORCES[1:]) if each.loaded else _FORCES)
        outputs = [list(map(_place(key), range(_size(key)))) for key in keys]
        load = [list(map(_place("load"), range(ACTUATORS)))] if each.loaded else []
        calls = {len(_LOAD) - 1: _CARRIED} if each.loaded else {}
        code = lines(each.function, [*inputs, *machine, *load], outputs, language, calls)
        unread = tuple(
            key
            for key, places in zip(each.inputs, inputs, strict=True)
            if code.read.isdisjoint(places)
        )
        bodies[name] = Body(each.does, each.inputs, unread, each.loaded, code)
    read = frozenset[str]().union(*(body.code.read for body in bodies.values()))
    vectors, force = model.vectors, model.largest_force
    return {
        "model": model,
        "prefix": model.prefix,
        "upper": model.prefix.upper(),
        "robot": model.robot.name,
        "origin": model.origin,
        "uncertainty": uncertainty_lines(model),
        "width": repr(float(model.width)),
        "constants": [one for one in constants if not read.isdisjoint(one.places)],
        "home": home(model),
        "body": bodies,
        "tolerance": {"double": DOUBLE * force, "single": SINGLE * force},
        "vectors": {key: getattr(vectors, key) for key in vectors.__dataclass_fields__},
        "checked": ("forces", "rest", "friction", "lengths", "rates"),
    }


def rendered(template: str, filled: dict[str, Any]) -> str:
    """Return the text of a template."""
    return _environment().get_template(template).render(filled)


def _size(key: str) -> int:
    return ACTUATORS * ACTUATORS if key in ("transposed", "matrix") else ACTUATORS


def _place(key: str) -> Any:
    # A matrix is stored row by row; `transposed` comes column by column.
    def place(k: int) -> str:
        row, column = divmod(k, ACTUATORS)
        if key == "transposed":
            return f"matrix[{column}][{row}]"
        return f"matrix[{row}][{column}]" if key == "matrix" else f"{key}[{k}]"

    return place


def _listed(values: Array, form: str, brackets: str) -> str:
    """Return an array in brackets, its numbers in a form such as ``R({})``."""
    if np.ndim(values) == 0:
        return form.format(repr(float(values)))
    inner = ", ".join(_listed(one, form, brackets) for one in values)
    return f"{brackets[0]}{inner}{brackets[1]}"


def _wrapped(words: Sequence[str], width: int = 90) -> list[str]:
    """Return words joined by commas, in lines."""
    found = [""]
    for word in words:
        if found[-1] and len(found[-1]) + len(word) > width:
            found.append("")
        found[-1] += (", " if found[-1] else "") + word
    return [line + ("," if k < len(found) - 1 else "") for k, line in enumerate(found)]


@cache
def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("estimation.controlmodel", "templates"),
        autoescape=select_autoescape(("xml.j2",), default=False),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "c_reals": partial(_listed, form="R({})", brackets="{}"),
        "c_doubles": partial(_listed, form="{}", brackets="{}"),
        "python": partial(_listed, form="{}", brackets="[]"),
        "wrapped": _wrapped,
        "plain": plain,
    }
    return environment
