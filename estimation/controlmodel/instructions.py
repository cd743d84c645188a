"""CasADi functions as lines of C or NumPy, one line to an instruction.

CasADi's own C generator is not used: it keeps double constants and double functions when
`float` is requested, its unused arguments and functions do not compile without warnings, and the
robot's numbers would be strewn over the code. Here they stay named constants on top of the file.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import casadi as ca

from expdesign.evaluation.vector_code import LIBRARY, UnknownInstructionError

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
    """Name of a function of math.h → what calls it."""
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
        What every element is called, column by column.
    language : Language
    calls : mapping
        Output → what to call once it is written. CasADi has the instructions in the order of the
        outputs, so that what is needed for later ones alone comes after.

    Raises
    ------
    UnknownInstructionError
        An operation has no form there.
    """
    # What an input, or a constant, is called is put in where it is used.
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
