"""Execution of a CasADi function's instructions with Taylor models instead of numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.enclosure import taylor_model as f
from expdesign.enclosure.arithmetic import (
    TERMS,
    add,
    invert,
    larger,
    multiply,
    take_root,
)
from expdesign.enclosure.taylor_model import TaylorModel
from expdesign.evaluation.compiled import compiled

ASSIGN, NUMBER, ADD, SUBTRACT, NEGATE, MULTIPLY, TWICE, INVERT, ROOT, LARGER = range(10)
"""Instructions: of a row (instruction, target, first, second) of a program.

`NUMBER` writes the number whose place among the constants is the first.
"""
ROOM = 5
"""Packed models that `run_instructions` needs to work with."""

_COMPILED = {
    ca.OP_ASSIGN: ASSIGN,
    ca.OP_NEG: NEGATE,
    ca.OP_TWICE: TWICE,
    ca.OP_INV: INVERT,
    ca.OP_SQRT: ROOT,
    ca.OP_ADD: ADD,
    ca.OP_SUB: SUBTRACT,
    ca.OP_MUL: MULTIPLY,
    ca.OP_FMAX: LARGER,
}
_CALLED: dict[int, Callable[..., TaylorModel]] = {
    ca.OP_SIN: f.sine,
    ca.OP_COS: f.cosine,
    ca.OP_TAN: lambda a: f.divide(f.sine(a), f.cosine(a)),
    ca.OP_ASIN: f.arc_sine,
    ca.OP_ACOS: f.arc_cosine,
    ca.OP_ATAN: lambda a: f.arc_tangent(a, TaylorModel.number(1.0)),
    ca.OP_EXP: f.exponential,
    ca.OP_SIGN: f.sign,
    ca.OP_FABS: f.absolute,
    ca.OP_ATAN2: f.arc_tangent,
    ca.OP_HYPOT: lambda a, b: f.root(a.squared() + b.squared()),
}

_SPARE = 2
"""Places that an instruction of several steps needs for what is between them."""


class NoEnclosureError(NotImplementedError):
    """An operation of a function has no enclosure here."""


class EnclosedFunction:
    """The instructions of an SX function of columns, for Taylor models.

    Parameters
    ----------
    inputs, outputs : sequence of SX columns

    Raises
    ------
    NoEnclosureError
        An operation has no enclosure.
    """

    def __init__(self, inputs: Sequence[ca.SX], outputs: Sequence[ca.SX]) -> None:
        function = ca.Function(
            "enclosed", list(inputs), [ca.densify(one) for one in outputs], {"cse": True}
        )
        self.sizes = tuple(int(function.nnz_out(k)) for k in range(function.n_out()))
        # What is given, and what comes out, have places of their own behind those of the work.
        given = [int(function.nnz_in(k)) for k in range(function.n_in())]
        work = int(function.sz_w()) + _SPARE
        ends = np.cumsum([work, *given, *self.sizes]).tolist()
        self._given, self._found = ends[: len(given)], ends[len(given) : -1]
        self._places = ends[-1]
        spare = work - _SPARE
        steps = [s for k in range(function.n_instructions()) for s in _steps(function, k, spare)]
        self._steps = [self._placed(step) for step in steps]
        self._constants = np.array([step.constant for step in steps])
        self._parts = lru_cache(maxsize=64)(self._parts_for)

    def __call__(
        self, inputs: Sequence[Sequence[TaylorModel]], wanted: Iterable[int] | None = None
    ) -> list[list[TaylorModel]]:
        """Return the models of each output that is wanted (all by default), of models of inputs."""
        which = frozenset(range(len(self.sizes)) if wanted is None else wanted)
        cells = max(model.cells for part in inputs for model in part)
        work = np.empty((self._places, TERMS + 1, cells))
        counts = np.zeros(self._places, dtype=np.int64)
        for start, models in zip(self._given, inputs, strict=True):
            for place, model in enumerate(models, start):
                counts[place] = model.write(work[place])
        room = np.empty((ROOM, TERMS + 1, cells))
        with np.errstate(all="ignore"):
            for part in self._parts(which):
                if isinstance(part, np.ndarray):
                    run_instructions(part, self._constants, work, counts, room)
                    continue
                models = [TaylorModel.unpacked(work[k], counts[k]) for k in part.sources]
                counts[part.target] = part.function(*models).write(work[part.target])
        return [
            [
                TaylorModel.unpacked(work[place].copy(), counts[place])
                for place in range(start, start + size)
            ]
            if k in which
            else []
            for k, (start, size) in enumerate(zip(self._found, self.sizes, strict=True))
        ]

    def _placed(self, step: _Step) -> _Step:
        """Return an instruction with inputs and outputs at their places."""
        if step.input is not None:
            return replace(step, sources=(self._given[step.input[0]] + step.input[1],))
        if step.output is not None:
            return replace(step, target=self._found[step.output[0]] + step.output[1])
        return step

    def _parts_for(self, wanted: frozenset[int]) -> list[NDArray[np.int64] | _Call]:
        """Return what some outputs need: programs, and between them functions that are called."""
        live: set[int] = set()
        kept: list[tuple[int, _Step]] = []
        for number, step in reversed(list(enumerate(self._steps))):
            if step.output is None and step.target not in live:
                continue
            if step.output is not None and step.output[0] not in wanted:
                continue
            live.discard(step.target)
            live.update(step.sources)
            kept.append((number, step))
        parts: list[NDArray[np.int64] | _Call] = []
        rows: list[tuple[int, ...]] = []
        for number, step in reversed(kept):
            if step.called is None:
                first, second = (*step.sources, 0, 0)[:2] if step.sources else (number, 0)
                rows.append((step.compiled, step.target, first, second))
                continue
            call = _Call(step.called, step.target, step.sources)
            parts += [np.array(rows, dtype=np.int64).reshape(-1, 4), call]
            rows = []
        return [*parts, np.array(rows, dtype=np.int64).reshape(-1, 4)]


class _Call(NamedTuple):
    """A function of models between two programs."""

    function: Callable[..., TaylorModel]
    target: int
    sources: tuple[int, ...]


@dataclass(frozen=True)
class _Step:
    """One instruction, by the program or by a function that is called."""

    target: int
    sources: tuple[int, ...] = ()
    compiled: int = ASSIGN
    called: Callable[..., TaylorModel] | None = None
    constant: float = 0.0
    input: tuple[int, int] | None = None
    """Which input, and which of its elements, it reads."""
    output: tuple[int, int] | None = None


def _steps(function: ca.Function, k: int, spare: int) -> tuple[_Step, ...]:
    """Return what an instruction is done by; places of the work from `spare` on no other uses."""
    operation = function.instruction_id(k)
    if operation not in (ca.OP_DIV, ca.OP_FMIN):
        return (_step(function, k),)
    (target,), (a, b) = function.instruction_output(k), function.instruction_input(k)
    if operation == ca.OP_DIV:
        inverse = _Step(spare, (b,), INVERT)
        return inverse, _Step(target, (a, spare), MULTIPLY)
    flipped = [_Step(spare + i, (one,), NEGATE) for i, one in enumerate((a, b))]
    most = _Step(spare, (spare, spare + 1), LARGER)
    return *flipped, most, _Step(target, (spare,), NEGATE)


def _step(function: ca.Function, k: int) -> _Step:
    operation = function.instruction_id(k)
    target = tuple(function.instruction_output(k))
    source = tuple(function.instruction_input(k))
    if operation == ca.OP_INPUT:
        return _Step(target[0], input=(source[0], source[1]))
    if operation == ca.OP_OUTPUT:
        return _Step(-1, (source[0],), output=(target[0], target[1]))
    if operation == ca.OP_CONST:
        number = function.instruction_constant(k)
        return _Step(target[0], compiled=NUMBER, constant=number)
    if operation == ca.OP_SQ:
        return _Step(target[0], source * 2, MULTIPLY)
    if operation in _COMPILED:
        return _Step(target[0], source, _COMPILED[operation])
    if operation in _CALLED:
        return _Step(target[0], source, called=_CALLED[operation])
    raise NoEnclosureError(f"no enclosure of CasADi's operation {operation}")


@compiled
def run_instructions(
    program: NDArray[np.int64],
    constants: Array,
    work: Array,
    counts: NDArray[np.int64],
    room: Array,
) -> None:
    """Do instructions on models in numbered places.

    Parameters
    ----------
    program : (I, 4)
    work : (places, TERMS + 1, N)
        Packed models.
    counts : (places,)
        Their coefficients.
    room : (ROOM, TERMS + 1, N)
        Is overwritten.
    """
    out = room[0]
    for step in range(len(program)):
        do, target, a, b = program[step]
        count = 1
        if do == NUMBER:
            out[0] = constants[a]
            out[TERMS] = 0.0
        elif do in (ASSIGN, NEGATE):
            count = counts[a]
            sign = 1.0 if do == ASSIGN else -1.0
            for k in range(count):
                for n in range(out.shape[1]):
                    out[k, n] = sign * work[a, k, n]
            out[TERMS] = work[a, TERMS]
        elif do in (ADD, SUBTRACT):
            sign = 1.0 if do == ADD else -1.0
            count = add(work[a], counts[a], work[b], counts[b], sign, out)
        elif do == TWICE:
            count = add(work[a], counts[a], work[a], counts[a], 1.0, out)
        elif do == MULTIPLY:
            count = multiply(work[a], counts[a], work[b], counts[b], out, room[1])
        elif do == INVERT:
            count = invert(work[a], counts[a], out, room[1:])
        elif do == LARGER:
            count = larger(work[a], counts[a], work[b], counts[b], out, room[1:])
        elif do == ROOT:
            count = take_root(work[a], counts[a], out, room[1:])
        for k in range(count):
            work[target, k] = out[k]
        work[target, TERMS] = out[TERMS]
        counts[target] = count
