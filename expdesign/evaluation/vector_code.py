"""Translation of a CasADi function to LLVM IR with vector instructions for several samples.

The instructions keep their order. Operations that IEEE 754 rounds correctly are vectorised, all
others call the C library sample by sample like CasADi's virtual machine: the results are identical
to the last bit.

The text consists of functions of a thousand instructions that pass their values through memory:
LLVM compiles many short functions faster than a long one, and the code is no slower.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise

import casadi as ca

from expdesign.evaluation.block_loop import Lanes, block_loop

_PART = 1000
"""Instructions of one function."""
_READ = "%read"
"""Prefix of the names of values that were read from memory."""

_EXACT = {
    ca.OP_ADD: "fadd {v} {x}, {y}",
    ca.OP_SUB: "fsub {v} {x}, {y}",
    ca.OP_MUL: "fmul {v} {x}, {y}",
    ca.OP_DIV: "fdiv {v} {x}, {y}",
    ca.OP_SQ: "fmul {v} {x}, {x}",
    ca.OP_TWICE: "fadd {v} {x}, {x}",
    ca.OP_NEG: "fneg {v} {x}",
    ca.OP_INV: "fdiv {v} {one}, {x}",
}
_INTRINSIC = {
    ca.OP_SQRT: "sqrt",
    ca.OP_FABS: "fabs",
    ca.OP_FLOOR: "floor",
    ca.OP_CEIL: "ceil",
    ca.OP_FMIN: "minnum",
    ca.OP_FMAX: "maxnum",
    ca.OP_COPYSIGN: "copysign",
}
_COMPARISON = {
    ca.OP_LT: "olt {v} {x}, {y}",
    ca.OP_LE: "ole {v} {x}, {y}",
    ca.OP_EQ: "oeq {v} {x}, {y}",
    ca.OP_NE: "une {v} {x}, {y}",
    ca.OP_NOT: "oeq {v} {x}, {zero}",
}
LIBRARY = {
    ca.OP_SIN: "sin",
    ca.OP_COS: "cos",
    ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin",
    ca.OP_ACOS: "acos",
    ca.OP_ATAN: "atan",
    ca.OP_SINH: "sinh",
    ca.OP_COSH: "cosh",
    ca.OP_TANH: "tanh",
    ca.OP_ASINH: "asinh",
    ca.OP_ACOSH: "acosh",
    ca.OP_ATANH: "atanh",
    ca.OP_EXP: "exp",
    ca.OP_LOG: "log",
    ca.OP_EXPM1: "expm1",
    ca.OP_LOG1P: "log1p",
    ca.OP_ERF: "erf",
    ca.OP_POW: "pow",
    ca.OP_CONSTPOW: "pow",
    ca.OP_FMOD: "fmod",
    ca.OP_ATAN2: "atan2",
    ca.OP_HYPOT: "hypot",
    ca.OP_REMAINDER: "remainder",
}
"""Functions of C's math.h by operation."""


_PARAMETERS = "ptr noalias %inputs, ptr noalias %fixed, ptr noalias %outputs, ptr noalias %work"
_ATTRIBUTES = 'attributes #0 = { nounwind "prefer-vector-width"="512" }\n'


class UnknownInstructionError(ValueError):
    """A function has an unsupported instruction, such as a call of another function."""


def vector_code(
    function: ca.Function,
    varying: int,
    places: Sequence[Sequence[int]],
    sizes: Sequence[int],
    lanes: Lanes,
) -> str:
    """Return LLVM's text of `ENTRY`, which evaluates a function for many samples.

    Its arguments are a table of the varying inputs, each stored sample by sample; the fixed inputs
    one after the other; a table of the outputs, stored like the varying inputs; the number of
    samples, at least one; and `scratch_size` numbers at a multiple of 64 bytes.

    Parameters
    ----------
    function : casadi.Function
        Of SX.
    varying : int
        Number of inputs, the first ones, that differ from sample to sample.
    places : sequence of int sequences
        Places of the nonzeros of every output; only these elements are written.
    sizes : sequence of int
        Elements of every output.
    lanes : Lanes
        Lanes of a vector register.

    Raises
    ------
    UnknownInstructionError
        An instruction is not supported.
    """
    program = _Program(function, varying, lanes)
    inputs, _ = _counts(function)
    entry = block_loop(inputs[:varying], program.parts, places, sizes, lanes)
    return "\n".join([*program.text(), *entry, _ATTRIBUTES])


def scratch_size(function: ca.Function, varying: int, lanes: Lanes) -> int:
    """Return the number of elements in the working memory of `ENTRY`."""
    inputs, outputs = _counts(function)
    return lanes.count * (sum(inputs[:varying]) + sum(outputs) + int(function.sz_w()))


def _counts(function: ca.Function) -> tuple[list[int], list[int]]:
    inputs = [int(function.nnz_in(k)) for k in range(function.n_in())]
    return inputs, [int(function.nnz_out(k)) for k in range(function.n_out())]


def _starts(counts: Iterable[int]) -> list[int]:
    return list(accumulate(counts, initial=0))


_Step = tuple[int, Sequence[int], Sequence[int], float]
"""Operation, places of its result and its operands, and the value of a constant."""


class _Program:
    """The instructions in functions of at most `_PART` instructions."""

    def __init__(self, function: ca.Function, varying: int, lanes: Lanes) -> None:
        inputs, outputs = _counts(function)
        self._varying, self._lanes = varying, lanes
        self._inputs = _starts(inputs[:varying])[:-1] + _starts(inputs[varying:])
        self._outputs = _starts(outputs)
        self._used: dict[str, list[str]] = {}
        steps = [_step(function, k) for k in range(function.n_instructions())]
        cuts = [*range(0, len(steps), _PART), len(steps)]
        kept = _places_read_later(steps, cuts)
        self.parts = len(cuts) - 1
        self._lines: list[str] = []
        for k, (start, end) in enumerate(pairwise(cuts)):
            self._lines += self._part(k, steps[start:end], kept[k])

    def text(self) -> list[str]:
        """Return the declarations and the functions."""
        return [line for _, lines in sorted(self._used.items()) for line in lines] + self._lines

    def _part(self, number: int, steps: Sequence[_Step], kept: set[int]) -> list[str]:
        part = _Part(self._lanes)
        for operation, result, operands, constant in steps:
            if operation == ca.OP_OUTPUT:
                row = self._outputs[result[0]] + result[1]
                part.store(part.value(operands[0]), "%outputs", row)
            elif operation == ca.OP_INPUT:
                row = self._inputs[operands[0]] + operands[1]
                part.values[result[0]] = part.input(row, varies=operands[0] < self._varying)
            elif operation == ca.OP_CONST:
                part.values[result[0]] = self._lanes.constant(constant)
            else:
                found = self._result(part, operation, [part.value(place) for place in operands])
                part.values[result[0]] = found
        for place in sorted(kept & set(part.values)):
            # Values that were only read are there already.
            if not part.values[place].startswith(_READ):
                part.store(part.values[place], "%work", place)
        head = f"define private void @part{number}({_PARAMETERS}) #0 {{"
        return [head, *part.lines, "  ret void", "}"]

    def _result(self, part: _Part, operation: int, operands: list[str]) -> str:
        x, y = operands[0], operands[-1]
        lanes = self._lanes
        names = {"v": lanes, "x": x, "y": y, "one": lanes.constant(1), "zero": lanes.constant(0)}
        if operation in _EXACT:
            return part.add(_EXACT[operation].format(**names))
        if operation in _COMPARISON:
            return part.number(part.add("fcmp " + _COMPARISON[operation].format(**names)))
        if operation in _LOGICAL:
            return _LOGICAL[operation](part, x, y)
        given = ", ".join(f"{lanes} {each}" for each in operands)
        if operation in _INTRINSIC:
            name = f"@llvm.{_INTRINSIC[operation]}.v{lanes.count}f64"
            kinds = ", ".join([str(lanes)] * len(operands))
            self._used[name] = [f"declare {lanes} {name}({kinds})"]
        else:
            called = LIBRARY[operation]
            name = f"@lanes_{called}"
            self._used[name] = _library_call(called, len(operands), lanes)
        return part.add(f"call {lanes} {name}({given})")


@dataclass
class _Part:
    """The lines of one function, and the names of its values."""

    lanes: Lanes
    lines: list[str] = field(default_factory=list)
    values: dict[int, str] = field(default_factory=dict)
    """Names of the present values at the places of CasADi's work."""

    def add(self, text: str, name: str = "%v") -> str:
        """Add an instruction, and return the name of its result."""
        found = f"{name}{len(self.lines)}"
        self.lines.append(f"  {found} = {text}")
        return found

    def select(self, holds: str, value: str, other: str) -> str:
        """Return one of two values, depending on a condition."""
        return self.add(
            f"select {self.lanes.mask} {holds}, {self.lanes} {value}, {self.lanes} {other}"
        )

    def number(self, holds: str) -> str:
        """Return 1 where a condition holds and 0 elsewhere."""
        return self.add(f"uitofp {self.lanes.mask} {holds} to {self.lanes}")

    def not_zero(self, value: str) -> str:
        """Return the condition that a value is not 0, or NaN."""
        return self.add(f"fcmp une {self.lanes} {value}, {self.lanes.constant(0)}")

    def value(self, place: int) -> str:
        """Return the value at a place of CasADi's work."""
        if place not in self.values:
            self.values[place] = self._load("%work", place, _READ)
        return self.values[place]

    def input(self, row: int, *, varies: bool) -> str:
        """Return a row of the varying or the fixed inputs."""
        if varies:
            return self._load("%inputs", row, "%v")
        at = self.add(f"getelementptr double, ptr %fixed, i64 {row}")
        number = self.add(f"load double, ptr {at}")
        lanes = self.lanes
        alone = self.add(f"insertelement {lanes} poison, double {number}, i32 0")
        zeros = f"<{lanes.count} x i32> zeroinitializer"
        return self.add(f"shufflevector {lanes} {alone}, {lanes} poison, {zeros}")

    def store(self, value: str, base: str, row: int) -> None:
        """Store a value in a row of memory."""
        at = self.add(f"getelementptr {self.lanes}, ptr {base}, i64 {row}")
        self.lines.append(f"  store {self.lanes} {value}, ptr {at}, align {self.lanes.bytes}")

    def _load(self, base: str, row: int, name: str) -> str:
        at = self.add(f"getelementptr {self.lanes}, ptr {base}, i64 {row}")
        return self.add(f"load {self.lanes}, ptr {at}, align {self.lanes.bytes}", name)


def _sign(part: _Part, x: str, _: str) -> str:
    lanes = part.lanes
    above = part.add(f"fcmp ogt {lanes} {x}, {lanes.constant(0)}")
    below = part.add(f"fcmp olt {lanes} {x}, {lanes.constant(0)}")
    return part.select(below, lanes.constant(-1), part.select(above, lanes.constant(1), x))


def _combine_conditions(joint: str) -> Callable[[_Part, str, str], str]:
    def both(part: _Part, x: str, y: str) -> str:
        first, second = part.not_zero(x), part.not_zero(y)
        return part.number(part.add(f"{joint} {part.lanes.mask} {first}, {second}"))

    return both


def _select_if_not_zero(part: _Part, x: str, y: str) -> str:
    return part.select(part.not_zero(x), y, part.lanes.constant(0))


_LOGICAL = {
    ca.OP_AND: _combine_conditions("and"),
    ca.OP_OR: _combine_conditions("or"),
    ca.OP_SIGN: _sign,
    ca.OP_IF_ELSE_ZERO: _select_if_not_zero,
}
_KNOWN = {
    *(*_EXACT, *_INTRINSIC, *_COMPARISON, *LIBRARY, *_LOGICAL),
    *(ca.OP_INPUT, ca.OP_OUTPUT),
}


def _step(function: ca.Function, k: int) -> _Step:
    operation = function.instruction_id(k)
    if operation == ca.OP_CONST:
        return operation, function.instruction_output(k), (), function.instruction_constant(k)
    if operation not in _KNOWN:
        raise UnknownInstructionError(f"instruction {operation} of {function.name()}")
    return operation, function.instruction_output(k), function.instruction_input(k), 0.0


def _places_read_later(steps: Sequence[_Step], cuts: Sequence[int]) -> list[set[int]]:
    """Return the places whose values are read after each part before they are overwritten."""
    needed: set[int] = set()
    found: list[set[int]] = []
    for start, end in reversed(list(pairwise(cuts))):
        found.append(set(needed))
        for operation, result, operands, _ in reversed(steps[start:end]):
            if operation == ca.OP_OUTPUT:
                needed.add(operands[0])
                continue
            needed.discard(result[0])
            if operation != ca.OP_INPUT:
                needed.update(operands)
    return found[::-1]


def _library_call(name: str, operands: int, lanes: Lanes) -> list[str]:
    """Return a function that calls a function of the C library sample by sample."""
    kinds = ", ".join(["double"] * operands)
    parameters = ", ".join(f"{lanes} %x{j}" for j in range(operands))
    lines = [f"declare double @{name}({kinds})"]
    lines.append(f"define private {lanes} @lanes_{name}({parameters}) noinline #0 {{")
    whole = "poison"
    for k in range(lanes.count):
        lines += [f"  %x{j}_{k} = extractelement {lanes} %x{j}, i32 {k}" for j in range(operands)]
        given = ", ".join(f"double %x{j}_{k}" for j in range(operands))
        lines.append(f"  %y{k} = call double @{name}({given})")
        lines.append(f"  %whole{k} = insertelement {lanes} {whole}, double %y{k}, i32 {k}")
        whole = f"%whole{k}"
    return [*lines, f"  ret {lanes} {whole}", "}"]
