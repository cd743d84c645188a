"""Files of a control model from their templates, with CasADi functions as lines of C or NumPy.

CasADi's own C generator is not used: it keeps double constants and double functions for `float`,
its unused arguments and functions do not compile without warnings, and the robot's numbers would be
scattered over the code. Here they are named constants at the top of the file.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from textwrap import wrap
from types import MappingProxyType
from typing import Any

import casadi as ca
import numpy as np
from jinja2 import Environment, select_autoescape

from constraints.arrays import Array
from estimation.controlmodel.model import DOUBLE, SINGLE, ControlModel, model_functions
from estimation.uncertainty.forces import by_actuator
from expdesign.evaluation.vector_code import LIBRARY, UnknownInstructionError
from expdesign.mechanism.hexapod import ACTUATORS, COORDINATES
from expdesign.mechanism.term import parameters_of
from expdesign.templates import text_templates

_WORDS = {
    "α": "alpha",
    "β": "beta",
    "σ": "std",
    "²": "^2",
    "·": " ",
    "–": "-",
    "…": "...",
    "±": "+-",
}
_WIDTH = 84
"""Largest number of characters of a doubt in the head of a file."""
_LIST_WIDTH = 93
"""Largest number of characters of a line of names."""


@dataclass(frozen=True, eq=False)
class ModelConstant:
    """An array of numbers of the robot."""

    name: str
    comment: str
    values: Array
    notes: tuple[str, ...] = ()
    """Of every row, or none."""

    @property
    def places(self) -> tuple[str, ...]:
        """Names of its elements in C and Python, row by row."""
        indices = np.ndindex(*self.values.shape)
        return tuple(self.name + "".join(f"[{k}]" for k in index) for index in indices)


def robot_constants(model: ControlModel) -> tuple[ModelConstant, ...]:
    """Return the constants in the order of the inputs of `model_functions`.

    Geometry, constants of the terms, parameters: one array to each piece of `GeometrySymbols`.
    """
    robot = model.robot
    about = robot.description
    geometry = [
        ModelConstant("BASE_JOINTS", "joints at the base, base frame, m", about.base_joints),
        ModelConstant(
            "PLATFORM_JOINTS", "joints at the platform, platform frame, m", about.platform_joints
        ),
        ModelConstant(
            "CARDAN_FRAMES",
            "frames of the cardan joints, columns x y z, base frame",
            robot.cardan_frames,
        ),
        ModelConstant(
            "JOINT_AXES",
            "axes of the joints at the platform, platform frame",
            about.platform_joint_axes,
        ),
        ModelConstant("GRAVITY", "gravity, base frame, m/s^2", about.gravity),
    ]
    if about.platform_cardan_axes is not None:
        geometry += [
            ModelConstant(
                "PLATFORM_CARDAN_AXES",
                "first axes of the cardan joints at the platform, platform frame",
                about.platform_cardan_axes,
            ),
            ModelConstant("LEAD", "lead of the threads, m per turn", np.array([about.thread_lead])),
        ]
    known = [(term, one) for term in robot.terms for one in term.constants]
    return (
        *geometry,
        ModelConstant(
            "CONSTANTS",
            "constants of the terms",
            np.asarray(about.constants, dtype=float),
            tuple(f"{term.name}: {one.name} [{one.unit}]" for term, one in known),
        ),
        ModelConstant(
            "PARAMETERS", "parameters of the dynamics", robot.parameters, tuple(_parameters(model))
        ),
    )


def _parameters(model: ControlModel) -> Iterator[str]:
    std = model.parameter_std
    for k, parameter in enumerate(parameters_of(model.robot.terms)):
        spread = "" if std is None else f", std {std[k]:.2g}"
        yield f"{parameter.name} [{parameter.unit}]{spread}: {plain(parameter.meaning)}"


def plain(text: str) -> str:
    """Return a text in ASCII, without the marks of LaTeX: compilers differ on all else."""
    for letter, word in _WORDS.items():
        text = text.replace(letter, word)
    text = re.sub(r"\\[, ]", " ", re.sub(r"[${}]|\\(?=[a-z])", "", text))
    return text.encode("ascii", "replace").decode("ascii")


def uncertainty_lines(model: ControlModel) -> tuple[str, ...]:
    """Return the standard deviations of the forces in words, one line to an actuator."""
    if model.uncertainty is None:
        return ("not known: no covariance of the parameters, or no motion to state it on",)
    return tuple(
        f"actuator {one.actuator}: rms {one.rms:.3g} N, largest {one.largest:.3g} N, of forces up "
        f"to {one.largest_force:.3g} N"
        for one in by_actuator(model.uncertainty, model.robot)
    )


_OUTPUTS = {"lengths": ("lengths",), "rates": ("rates",), "slope": ("lengths", "matrix")}
_FORCES, _LOAD = ("transposed", "forces", "along"), ("transposed", "load", "along")
"""Variables in C and Python for the outputs of `model_functions`."""
_CARRIED = "carry(matrix, along, load)"
"""Call that computes the load from its wrench."""


@dataclass(frozen=True)
class Body:
    """One function of a file."""

    inputs: tuple[str, ...]
    loaded: bool
    code: Lines


def context(model: ControlModel, language: Language) -> dict[str, Any]:
    """Return the context of the templates: bodies of functions, constants and vectors."""
    constants = robot_constants(model)
    groups = [constant.places for constant in constants]
    *geometry, own, parameters = groups
    machine = [[place for group in geometry for place in group], own, parameters]
    bodies: dict[str, Body] = {}
    for name, each in model_functions(model.robot.terms).items():
        inputs = [[f"{key}[{k}]" for k in range(COORDINATES)] for key in each.inputs]
        keys = _OUTPUTS.get(name, (*_LOAD, *_FORCES[1:]) if each.loaded else _FORCES)
        outputs = [list(map(_place(key), range(_size(key)))) for key in keys]
        load = [list(map(_place("load"), range(ACTUATORS)))] if each.loaded else []
        calls = {len(_LOAD) - 1: _CARRIED} if each.loaded else {}
        code = lines(each.function, [*inputs, *machine, *load], outputs, language, calls)
        bodies[name] = Body(each.inputs, each.loaded, code)
    read = frozenset[str]().union(*(body.code.read for body in bodies.values()))
    vectors, force = model.vectors, model.largest_force
    return {
        "model": model,
        "prefix": model.prefix,
        "upper": model.prefix.upper(),
        "robot": model.robot.name,
        "origin": model.origin,
        "uncertainty": uncertainty_lines(model),
        "doubts": [line for one in model.doubts for line in wrap(plain(one), _WIDTH)],
        "width": repr(float(model.width)),
        "constants": [one for one in constants if not read.isdisjoint(one.places)],
        "home": ModelConstant("HOME", "home pose x y z phi theta psi, m and rad", model.robot.home),
        "body": bodies,
        "tolerance": {"double": DOUBLE * force, "single": SINGLE * force},
        "vectors": {key: getattr(vectors, key) for key in vectors.__dataclass_fields__},
        "checked": ("forces", "rest", "friction", "lengths", "rates"),
    }


def render_template(template: str, filled: dict[str, Any]) -> bytes:
    """Return the text of a template in UTF-8."""
    return _environment().get_template(template).render(filled).encode("utf-8")


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


def _format_list(values: Array, form: str, brackets: str) -> str:
    """Return an array in brackets, its numbers in a form such as ``R({})``."""
    if np.ndim(values) == 0:
        return form.format(repr(float(values)))
    inner = ", ".join(_format_list(one, form, brackets) for one in values)
    return f"{brackets[0]}{inner}{brackets[1]}"


@cache
def _environment() -> Environment:
    environment = text_templates("estimation.controlmodel")
    environment.autoescape = select_autoescape(("xml.j2",), default=False)
    environment.filters |= {
        "c_reals": partial(_format_list, form="R({})", brackets="{}"),
        "c_doubles": partial(_format_list, form="{}", brackets="{}"),
        "python": partial(_format_list, form="{}", brackets="[]"),
        "wrapped": lambda words: wrap(", ".join(words), _LIST_WIDTH),
        "plain": plain,
    }
    return environment


SIGN = "sign_of"
"""The sign of dry friction, a function that the file has to define."""
_OPERATORS = {
    ca.OP_ASSIGN: "{x}",
    ca.OP_ADD: "{x} + {y}",
    ca.OP_SUB: "{x} - {y}",
    ca.OP_MUL: "{x} * {y}",
    ca.OP_DIV: "{x} / {y}",
    ca.OP_SQ: "{x} * {x}",
    ca.OP_TWICE: "{x} + {x}",
    ca.OP_NEG: "-{x}",
    ca.OP_INV: "{one} / {x}",
    ca.OP_SIGN: f"{SIGN}({{x}})",
}
_NAMED = LIBRARY | {
    ca.OP_SQRT: "sqrt",
    ca.OP_FABS: "fabs",
    ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil",
    ca.OP_FMIN: "fmin",
    ca.OP_FMAX: "fmax",
    ca.OP_COPYSIGN: "copysign",
}
"""Functions of C's math.h by operation."""
_COMPARED = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!="}


@dataclass(frozen=True)
class Language:
    """How a line is written."""

    number: Callable[[float], str]
    called: Callable[[str], str]
    """Name of a function of math.h → its call."""
    chosen: str
    """The value of `a` where `holds`, else that of `b`."""
    end: str = ""


def _numpy_name(name: str) -> str:
    if name in ("erf", "remainder"):  # of math.h: NumPy has none, or another one
        raise UnknownInstructionError(f"NumPy has no {name} of C's math.h")
    if name == "pow":
        return "np.power"
    return f"np.arc{name[1:]}" if name.startswith("a") else f"np.{name}"


C = Language(
    lambda value: f"R({float(value)!r})",
    lambda name: f"F({name})",
    "({holds}) ? {a} : {b}",
    ";",
)
NUMPY = Language(lambda value: repr(float(value)), _numpy_name, "np.where({holds}, {a}, {b})")


@dataclass(frozen=True)
class Lines:
    """A function's body: names of its variables, statements, and which inputs they read."""

    variables: tuple[str, ...]
    statements: tuple[str, ...]
    read: frozenset[str]


def lines(
    function: ca.Function,
    inputs: Sequence[Sequence[str]],
    outputs: Sequence[Sequence[str]],
    language: Language,
    calls: Mapping[int, str] = MappingProxyType({}),
) -> Lines:
    """Return the instructions of an SX function as assignments.

    Parameters
    ----------
    function : casadi.Function
        Of SX, its inputs and outputs dense.
    inputs, outputs : sequence of str sequences
        Names of the elements, column by column.
    calls : mapping
        Output → call after its last element. CasADi sorts the instructions by the outputs, so that
        those of later outputs follow.

    Raises
    ------
    UnknownInstructionError
        An operation has no form there.
    """
    # Names of inputs and constants are inserted at their use.
    held: dict[int, str] = {}
    variables: dict[str, None] = {}
    statements: list[str] = []
    read: set[str] = set()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        target, source = function.instruction_output(k), function.instruction_input(k)
        if operation == ca.OP_INPUT:
            held[target[0]] = inputs[source[0]][source[1]]
            read.add(held[target[0]])
        elif operation == ca.OP_CONST:
            held[target[0]] = language.number(function.instruction_constant(k))
        elif operation == ca.OP_OUTPUT:
            name = outputs[target[0]][target[1]]
            statements.append(f"{name} = {held[source[0]]}{language.end}")
            if target[0] in calls and target[1] == len(outputs[target[0]]) - 1:
                statements.append(f"{calls[target[0]]}{language.end}")
        else:
            text = _expression(operation, [held[place] for place in source], language)
            held[target[0]] = f"a{target[0]}"
            variables[held[target[0]]] = None
            statements.append(f"{held[target[0]]} = {text}{language.end}")
    return Lines(tuple(variables), tuple(statements), frozenset(read))


def _expression(operation: int, operands: Sequence[str], language: Language) -> str:
    x, y = operands[0], operands[-1]
    if operation in _OPERATORS:
        # A number may be negative: 1 - -2 is no decrement.
        x, y = (f"({each})" if each.startswith("-") else each for each in (x, y))
        return _OPERATORS[operation].format(x=x, y=y, one=language.number(1.0))
    if operation in _NAMED:
        return f"{language.called(_NAMED[operation])}({', '.join(operands)})"
    one, zero = language.number(1.0), language.number(0.0)
    if operation in _COMPARED:
        holds = f"{x} {_COMPARED[operation]} {y}"
        return language.chosen.format(holds=holds, a=one, b=zero)
    conditional = {
        ca.OP_NOT: (zero, one),
        ca.OP_IF_ELSE_ZERO: (y, zero),
        ca.OP_AND: (_truth(y, language), zero),
        ca.OP_OR: (one, _truth(y, language)),
    }
    if operation in conditional:
        a, b = conditional[operation]
        return language.chosen.format(holds=f"{x} != {zero}", a=a, b=b)
    raise UnknownInstructionError(f"CasADi's operation {operation} cannot be written as a line")


def _truth(value: str, language: Language) -> str:
    one, zero = language.number(1.0), language.number(0.0)
    return f"({language.chosen.format(holds=f'{value} != {zero}', a=one, b=zero)})"
