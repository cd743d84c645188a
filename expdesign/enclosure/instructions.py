"""Execution of a CasADi function's instructions with Taylor models instead of numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.enclosure import taylor_model as f
from expdesign.enclosure.arithmetic import (
    TERMS,
    add,
    copy,
    invert,
    multiply,
    take_larger,
    take_root,
)
from expdesign.enclosure.taylor_model import TaylorModel
from expdesign.evaluation.compiled import compiled

ASSIGN, NUMBER, ADD, SUBTRACT, NEGATE, MULTIPLY, TWICE, INVERT, ROOT, LARGER = range(10)
"""Instructions of a program, whose rows are (instruction, target, first, second).

`NUMBER` writes the constant with the number `first`.
"""
ROOM = 5
"""Packed models in the working memory of `run_instructions`."""

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
"""Places for the intermediate results of an instruction of several steps."""


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
        # Inputs and outputs have their own places behind those of the work.
        given = [int(function.nnz_in(k)) for k in range(function.n_in())]
        work = int(function.sz_w()) + _SPARE
        ends = np.cumsum([work, *given, *self.sizes]).tolist()
        self._given, self._found = ends[: len(given)], ends[len(given) : -1]
        self._places, self._spare = ends[-1], work - _SPARE
        numbers = range(function.n_instructions())
        self._steps = [step for k in numbers for step in self._steps_of(function, k)]
        self._constants = np.array([step.constant for step in self._steps])
        self._parts = lru_cache(maxsize=64)(self._parts_for)

    def __call__(
        self, inputs: Sequence[Sequence[TaylorModel]], wanted: Iterable[int] | None = None
    ) -> list[list[TaylorModel]]:
        """Return the models of the wanted outputs (by default all), of models of the inputs."""
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
                elif part.function is not None:
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

    def _steps_of(self, function: ca.Function, k: int) -> Iterator[_Step]:
        """Yield the steps of an instruction."""
        operation, spare = function.instruction_id(k), self._spare
        place, *element = function.instruction_output(k)
        source = tuple(function.instruction_input(k))
        if operation == ca.OP_INPUT:
            yield _Step(place, (self._given[source[0]] + source[1],))
        elif operation == ca.OP_OUTPUT:
            yield _Step(self._found[place] + element[0], source[:1], output=place)
        elif operation == ca.OP_CONST:
            yield _Step(place, compiled=NUMBER, constant=function.instruction_constant(k))
        elif operation == ca.OP_SQ:
            yield _Step(place, source * 2, MULTIPLY)
        elif operation == ca.OP_DIV:
            yield _Step(spare, source[1:], INVERT)
            yield _Step(place, (source[0], spare), MULTIPLY)
        elif operation == ca.OP_FMIN:
            yield from (_Step(spare + i, (one,), NEGATE) for i, one in enumerate(source))
            yield _Step(spare, (spare, spare + 1), LARGER)
            yield _Step(place, (spare,), NEGATE)
        elif operation in _COMPILED:
            yield _Step(place, source, _COMPILED[operation])
        elif operation in _CALLED:
            yield _Step(place, source, function=_CALLED[operation])
        else:
            raise NoEnclosureError(f"no enclosure of CasADi's operation {operation}")

    def _parts_for(self, wanted: frozenset[int]) -> list[NDArray[np.int64] | _Step]:
        """Return the programs and the function calls between them that some outputs need."""
        live: set[int] = set()
        kept: list[tuple[int, _Step]] = []
        for number, step in reversed(list(enumerate(self._steps))):
            if step.output is None and step.target not in live:
                continue
            if step.output is not None and step.output not in wanted:
                continue
            live.discard(step.target)
            live.update(step.sources)
            kept.append((number, step))
        parts: list[NDArray[np.int64] | _Step] = []
        rows: list[tuple[int, ...]] = []
        for number, step in reversed(kept):
            if step.function is None:
                first, second = (*step.sources, 0, 0)[:2] if step.sources else (number, 0)
                rows.append((step.compiled, step.target, first, second))
                continue
            parts += [np.array(rows, dtype=np.int64).reshape(-1, 4), step]
            rows = []
        return [*parts, np.array(rows, dtype=np.int64).reshape(-1, 4)]


@dataclass(frozen=True)
class _Step:
    """One instruction, of a program or a call of a function."""

    target: int
    sources: tuple[int, ...] = ()
    compiled: int = ASSIGN
    function: Callable[..., TaylorModel] | None = None
    """Function of models, instead of a compiled instruction."""
    constant: float = 0.0
    output: int | None = None
    """Number of the output that it writes."""


@compiled
def run_instructions(
    program: NDArray[np.int64],
    constants: Array,
    work: Array,
    counts: NDArray[np.int64],
    room: Array,
) -> None:
    """Execute instructions on models in numbered places.

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
            for n in range(out.shape[1]):
                out[0, n], out[TERMS, n] = constants[a], 0.0
        elif do in (ASSIGN, NEGATE):
            count = counts[a]
            copy(work[a], count, 1.0 if do == ASSIGN else -1.0, out)
        elif do in (ADD, SUBTRACT, TWICE):
            sign = -1.0 if do == SUBTRACT else 1.0
            other = a if do == TWICE else b
            count = add(work[a], counts[a], work[other], counts[other], sign, out)
        elif do == MULTIPLY:
            count = multiply(work[a], counts[a], work[b], counts[b], out, room[1])
        elif do == INVERT:
            count = invert(work[a], counts[a], out, room[1:])
        elif do == LARGER:
            count = take_larger(work[a], counts[a], work[b], counts[b], out, room[1:])
        elif do == ROOT:
            count = take_root(work[a], counts[a], out, room[1:])
        copy(out, count, 1.0, work[target])
        counts[target] = count
