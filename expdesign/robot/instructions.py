"""A CasADi function's instructions, each done for many samples at once by NumPy.

CasADi's virtual machine goes through all instructions for one sample after the other and spends
most of its time on finding out what comes next. Here that is asked once per block of samples. What
IEEE 754 rounds correctly is NumPy's; all else, such as sines, is done by CasADi itself: the numbers
are the same, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from threading import Lock
from typing import Any

import casadi as ca
import numpy as np

from constraints.arrays import Array

BLOCK = 512
"""Samples at a time: more of them are no faster, and leave the processor's cache."""
FEWEST = 192
"""Samples from which on a block is faster than the virtual machine."""
_LONGEST = 40_000
"""Instructions; more, such as those of Jacobians, are asked for at few samples only."""

_EXACT: dict[int, Callable[..., Any]] = {
    ca.OP_ADD: np.add,
    ca.OP_SUB: np.subtract,
    ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide,
    ca.OP_NEG: np.negative,
    ca.OP_SQ: np.square,
    ca.OP_INV: np.reciprocal,
    ca.OP_SQRT: np.sqrt,
    ca.OP_FABS: np.absolute,
    ca.OP_FMIN: np.fmin,
    ca.OP_FMAX: np.fmax,
}

_lock = Lock()


class Instructions:
    """The instructions of an SX function, bound to memory for a block of samples.

    Parameters
    ----------
    function : casadi.Function
        From `BLOCK` samples of its inputs to as many of its outputs.
    varying : int
        How many of the inputs, the first ones, differ from sample to sample.
    """

    def __init__(self, function: ca.Function, varying: int) -> None:
        self._varying = varying
        work = np.zeros((function.sz_w() + 1, BLOCK))
        self._inputs = [np.zeros((function.nnz_in(k), BLOCK)) for k in range(function.n_in())]
        self._outputs = [np.zeros((function.nnz_out(k), BLOCK)) for k in range(function.n_out())]
        by_casadi: dict[int, Callable[..., None]] = {}
        self._steps: list[tuple[Callable[..., Any], tuple[Any, ...]]] = []
        step: tuple[Callable[..., Any], tuple[Any, ...]]
        for k in range(function.n_instructions()):
            operation = function.instruction_id(k)
            left, right = function.instruction_output(k), function.instruction_input(k)
            if operation == ca.OP_INPUT:
                step = np.copyto, (work[left[0]], self._inputs[right[0]][right[1]])
            elif operation == ca.OP_OUTPUT:
                step = np.copyto, (self._outputs[left[0]][left[1]], work[right[0]])
            elif operation == ca.OP_CONST:
                step = work[left[0]].fill, (function.instruction_constant(k),)
            elif operation == ca.OP_TWICE:
                step = np.add, (work[right[0]], work[right[0]], work[left[0]])
            else:
                if operation not in _EXACT and operation not in by_casadi:
                    by_casadi[operation] = _by_casadi(operation, len(right))
                done = _EXACT.get(operation) or by_casadi[operation]
                step = done, (*(work[place] for place in right), work[left[0]])
            self._steps.append(step)

    @staticmethod
    def of(function: ca.Function, varying: int) -> Instructions | None:
        """Return those of a function, None where there are too many or calls among them."""
        count = function.n_instructions()
        if count > _LONGEST or any(function.instruction_id(k) == ca.OP_CALL for k in range(count)):
            return None
        return Instructions(function, varying)

    def __call__(self, varying: Sequence[Array], fixed: Sequence[Array]) -> list[Array]:
        """Evaluate: varying inputs as (N, rows) with N ≤ `BLOCK`, fixed ones as (rows,).

        Returns (N, nonzeros) for every output.
        """
        count = len(varying[0])
        with _lock, np.errstate(all="ignore"):
            for place, value in zip(self._inputs[: self._varying], varying, strict=True):
                place[:, :count] = value.T
            for place, value in zip(self._inputs[self._varying :], fixed, strict=True):
                place[:] = np.reshape(value, (-1, 1))
            for do, arguments in self._steps:
                do(*arguments)
            return [place[:, :count].T.copy() for place in self._outputs]


def _by_casadi(operation: int, operands: int) -> Callable[..., None]:
    """Return one operation on rows of a block, the last of which takes the result."""
    x, y = ca.MX.sym("x", BLOCK), ca.MX.sym("y", BLOCK)
    if operands == 1:
        function = ca.Function("operation", [x], [ca.MX.unary(operation, x)])
    else:
        function = ca.Function("operation", [x, y], [ca.MX.binary(operation, x, y)])
    buffer, evaluate = function.buffer()

    def done(*rows: Array) -> None:
        for k, row in enumerate(rows[:-1]):
            buffer.set_arg(k, row.data)  # type: ignore[call-arg]
        buffer.set_res(0, rows[-1].data)  # type: ignore[call-arg]
        evaluate()

    return done
