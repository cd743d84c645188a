"""A CasADi function's instructions, done with Taylor models in place of numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from expdesign.enclosure import functions as f
from expdesign.enclosure.taylor_model import TaylorModel

_ONE: dict[int, Callable[[TaylorModel], TaylorModel]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_NEG: lambda a: -a,
    ca.OP_SQ: TaylorModel.squared,
    ca.OP_TWICE: lambda a: a.scaled(2.0),
    ca.OP_INV: f.reciprocal,
    ca.OP_SQRT: f.root,
    ca.OP_SIN: f.sine,
    ca.OP_COS: f.cosine,
    ca.OP_TAN: lambda a: f.divided(f.sine(a), f.cosine(a)),
    ca.OP_ASIN: f.arc_sine,
    ca.OP_ACOS: f.arc_cosine,
    ca.OP_ATAN: lambda a: f.arc_tangent(a, TaylorModel.number(1.0)),
    ca.OP_EXP: f.exponential,
    ca.OP_SIGN: f.sign,
    ca.OP_FABS: f.absolute,
}
_TWO: dict[int, Callable[[TaylorModel, TaylorModel], TaylorModel]] = {
    ca.OP_ADD: TaylorModel.__add__,
    ca.OP_SUB: TaylorModel.__sub__,
    ca.OP_MUL: TaylorModel.__mul__,
    ca.OP_DIV: f.divided,
    ca.OP_ATAN2: f.arc_tangent,
    ca.OP_HYPOT: lambda a, b: f.root(a.squared() + b.squared()),
    ca.OP_FMIN: f.smaller,
    ca.OP_FMAX: f.larger,
}


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
        self._slots = int(function.sz_w()) + 1
        self.sizes = tuple(int(function.nnz_out(k)) for k in range(function.n_out()))
        self._steps = [_step(function, k) for k in range(function.n_instructions())]
        self._needed = lru_cache(maxsize=64)(self._needed_for)

    def __call__(
        self, inputs: Sequence[Sequence[TaylorModel]], wanted: Iterable[int] | None = None
    ) -> list[list[TaylorModel]]:
        """Return the models of each output that is wanted (all by default), of models of inputs."""
        which = frozenset(range(len(self.sizes)) if wanted is None else wanted)
        work: list[TaylorModel] = [TaylorModel.number(0.0)] * self._slots
        found: dict[tuple[int, ...], TaylorModel] = {}
        with np.errstate(all="ignore"):
            for do, target, source in self._needed(which):
                if do is _INPUT:
                    work[target[0]] = inputs[source[0]][source[1]]
                elif do is _OUTPUT:
                    found[target] = work[source[0]]
                else:
                    work[target[0]] = do(*(work[k] for k in source))
        return [
            [found[k, place] for place in range(size)] if k in which else []
            for k, size in enumerate(self.sizes)
        ]

    def _needed_for(self, wanted: frozenset[int]) -> list[_Step]:
        """Return the instructions that some outputs need."""
        live: set[int] = set()
        kept = []
        for step in reversed(self._steps):
            do, target, source = step
            if do is _OUTPUT:
                if target[0] not in wanted:
                    continue
                live.add(source[0])
            elif target[0] not in live:
                continue
            else:
                live.remove(target[0])
                if do is not _INPUT:
                    live.update(source)
            kept.append(step)
        return kept[::-1]


_Step = tuple[Callable[..., TaylorModel], tuple[int, ...], tuple[int, ...]]


def _INPUT() -> TaylorModel:  # noqa: N802 - a mark, not a function that is called
    raise NotImplementedError


def _OUTPUT() -> TaylorModel:  # noqa: N802
    raise NotImplementedError


def _step(function: ca.Function, k: int) -> _Step:
    operation = function.instruction_id(k)
    target = tuple(function.instruction_output(k))
    source = tuple(function.instruction_input(k))
    if operation == ca.OP_INPUT:
        return _INPUT, target, source
    if operation == ca.OP_OUTPUT:
        return _OUTPUT, target, source
    if operation == ca.OP_CONST:
        number = TaylorModel.number(function.instruction_constant(k))
        return (lambda: number), target, ()
    if operation in _ONE:
        return _ONE[operation], target, source
    if operation in _TWO:
        return _TWO[operation], target, source
    raise NoEnclosureError(f"no enclosure of CasADi's operation {operation}")
