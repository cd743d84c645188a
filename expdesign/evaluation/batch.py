"""Evaluation of the symbolic graph over many samples: the one place where that is done.

By CasADi's virtual machine where samples are few, by machine code where they are many, and with
memory that stays bound where there is one at a time: always the same numbers. Threads may share it.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.evaluation.machine_code import MachineCode, machine_code
from expdesign.evaluation.one_instant import OneInstant

_LOADING = 64
"""Samples, all together, from which on the cache is asked: who evaluates few never loads LLVM."""
_COMPILING = 5000
"""Samples, all together, from which on machine code is made where the cache has none: the virtual
machine has taken about a third of the time by then that LLVM takes."""
_MOST_MAPS = 16
"""Bound on memory."""
_PIECE = 512
"""Samples that the virtual machine takes at a time."""


class BatchFunction:
    """A function of one instant, evaluated for N instants.

    Parameters
    ----------
    name : str
        Name in CasADi's messages.
    varying : sequence of SX columns
        Inputs that differ from sample to sample.
    fixed : sequence of SX columns
        Inputs that all samples share.
    outputs : sequence of SX
        Expressions; each comes back as (N, rows, columns), or (N, rows) if it is a column.
    cse : bool
        Whether to look for expressions that stand there twice.
    """

    def __init__(
        self,
        name: str,
        varying: Sequence[ca.SX],
        fixed: Sequence[ca.SX],
        outputs: Sequence[ca.SX],
        *,
        cse: bool = True,
    ) -> None:
        # Row-major nonzeros: CasADi stores by columns, NumPy by rows.
        transposed = [output.T for output in outputs]
        nonzeros = [t.nz[:] for t in transposed]
        self._function = ca.Function(name, [*varying, *fixed], nonzeros, {"cse": cse})
        self._varying = len(varying)
        self._shapes = [output.shape for output in outputs]
        self._places = [_places(t) for t in transposed]
        self._maps: dict[int, ca.Function] = {}
        self._code: MachineCode | None = None
        self._asked = 0
        """Samples so far."""
        self._one: OneInstant | None = None

    @property
    def instructions(self) -> int:
        """Number of scalar instructions per sample."""
        return int(self._function.n_instructions())

    def __call__(self, *inputs: Array) -> list[Array]:
        """Evaluate: varying inputs as (N, rows), fixed ones as (rows,).

        Raises
        ------
        ValueError
            There are other inputs than the function has, or one has another size.
        """
        # Machine code reads what it is given an address of, whatever is there.
        if len(inputs) != self._function.n_in():
            raise ValueError(f"{len(inputs)} inputs, not {self._function.n_in()}")
        varying = [np.atleast_2d(value) for value in inputs[: self._varying]]
        fixed = [np.asarray(value, dtype=np.float64) for value in inputs[self._varying :]]
        count = varying[0].shape[0]
        for k, value in enumerate([*varying, *fixed]):
            size = self._function.nnz_in(k) * (count if k < self._varying else 1)
            if value.size != size or (k < self._varying and len(value) != count):
                raise ValueError(f"input {k}: {value.size} values, not {size}")
        code = self._compiled(count)
        flat = code(varying, fixed) if code else self._mapped(varying, fixed, count)
        return [
            values if columns == 1 else values.reshape(count, rows, columns)
            for values, (rows, columns) in zip(flat, self._shapes, strict=True)
        ]

    @property
    def is_compiled(self) -> bool:
        """Whether machine code evaluates it by now."""
        return self._code is not None

    def compile(self) -> None:
        """Make machine code now, for all processes of the user's, where it can be made."""
        self._compiled(_COMPILING)

    def at(self, *inputs: Array) -> list[Array]:
        """Evaluate one instant: every input as (rows,), outputs without the axis of samples.

        The same numbers as a call with one sample gives, in a fraction of the time.
        """
        if self._one is None:
            self._one = OneInstant(self._function, self._shapes, self._places)
        return self._one(*inputs)

    def _compiled(self, count: int) -> MachineCode | None:
        before, self._asked = self._asked, self._asked + count
        for enough in (_LOADING, _COMPILING):
            if self._code is None and before < enough <= self._asked:
                sizes = [rows * columns for rows, columns in self._shapes]
                self._code = machine_code(
                    self._function,
                    self._varying,
                    self._places,
                    sizes,
                    compiling=enough == _COMPILING,
                )
        return self._code

    def _mapped(self, varying: list[Array], fixed: list[Array], count: int) -> list[Array]:
        """Evaluate by the virtual machine: (N, elements) of every output."""
        results = [np.zeros((count, rows * columns)) for rows, columns in self._shapes]
        for start in range(0, count, _PIECE):
            piece = slice(start, start + _PIECE)
            found = self._piece([value[piece] for value in varying], fixed)
            for whole, places, values in zip(results, self._places, found, strict=True):
                whole[piece, places] = values
        return results

    def _piece(self, varying: list[Array], fixed: list[Array]) -> list[Array]:
        count = len(varying[0])
        mapped = self._maps.get(count)
        if mapped is None:
            if len(self._maps) > _MOST_MAPS:
                self._maps.clear()
            mapped = self._maps[count] = self._function.map(count)
        # CasADi stores by columns and a map puts samples side by side: one sample after the
        # other in memory, as in a NumPy array with a row per sample. Nothing is converted.
        buffer, evaluate = mapped.buffer()
        inputs = [np.ascontiguousarray(value, dtype=np.float64) for value in varying]
        inputs += [np.tile(np.ravel(value), (count, 1)).astype(np.float64) for value in fixed]
        outputs = [np.empty((count, len(places))) for places in self._places]
        for k, value in enumerate(inputs):
            # The stubs ask for a size that the functions do not take.
            buffer.set_arg(k, value.data)  # type: ignore[call-arg]
        for k, value in enumerate(outputs):
            buffer.set_res(k, value.data)  # type: ignore[call-arg]
        evaluate()
        return outputs


def _places(transposed: ca.SX) -> NDArray[np.intp]:
    rows, columns = transposed.sparsity().get_triplet()
    return np.asarray(columns, dtype=np.intp) * transposed.shape[0] + np.asarray(
        rows, dtype=np.intp
    )
