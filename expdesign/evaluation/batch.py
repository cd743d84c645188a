"""Evaluation of symbolic graphs of one instant, for one instant or for many.

CasADi's virtual machine evaluates few samples, machine code evaluates many, and buffers bound once
evaluate single instants; the results are identical to the last bit. Threads may share a function.

Building a graph with all its derivatives takes longer than loading its machine code. A `kernel` is
therefore built only if the cache has no machine code under its key: a digest of the code and data
that the graph is made of.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial, wraps
from threading import Lock
from typing import ParamSpec

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.evaluation.content import content_key
from expdesign.evaluation.machine_code import Form, MachineCode, kept_code, machine_code

_LOADING = 64
"""Samples in total from which the cache is searched for functions without a key."""
_COMPILING = 5000
"""Samples in total from which machine code is compiled if the cache has none: by then the virtual
machine has taken about a third of the time that LLVM takes."""
_MOST_MAPS = 16
"""Largest number of CasADi maps in memory."""
_PIECE = 512
"""Samples that the virtual machine evaluates at once."""

_Arguments = ParamSpec("_Arguments")


@dataclass(frozen=True)
class Graph:
    """Expressions of one instant."""

    name: str
    """Name in CasADi's messages."""
    varying: Sequence[ca.SX]
    """Columns, inputs that differ from sample to sample."""
    fixed: Sequence[ca.SX]
    """Columns, inputs that all samples share."""
    outputs: Sequence[ca.SX]

    def function(self) -> tuple[ca.Function, Form]:
        """Return the function of the outputs' nonzeros, row by row, and its form."""
        # CasADi stores by columns, NumPy by rows.
        transposed = [output.T for output in self.outputs]
        nonzeros = [t.nz[:] for t in transposed]
        function = ca.Function(self.name, [*self.varying, *self.fixed], nonzeros, {"cse": True})
        places = []
        for output in transposed:
            rows, columns = output.sparsity().get_triplet()
            pairs = zip(columns, rows, strict=True)
            places.append(tuple(int(c) * output.shape[0] + int(r) for c, r in pairs))
        form = Form(
            tuple(int(function.nnz_in(k)) for k in range(function.n_in())),
            len(self.varying),
            tuple((int(rows), int(columns)) for rows, columns in (o.shape for o in self.outputs)),
            tuple(places),
        )
        return function, form


def kernel(state: Callable[_Arguments, Graph]) -> Callable[_Arguments, BatchFunction]:
    """Return for a function that states a graph one that returns the evaluation of the graph.

    The evaluation is made once per arguments. These are hashable: terms and limits, and settings.

    Examples
    --------
    >>> import casadi as ca
    >>> import numpy as np
    >>> @kernel
    ... def multiples(factor: float) -> Graph:
    ...     x = ca.SX.sym("x", 2)
    ...     return Graph("multiples", [x], [], [factor * x])
    >>> multiples(2.0)(np.array([[1.0, 3.0]]))[0].tolist()
    [[2.0, 6.0]]
    """
    made: dict[Hashable, BatchFunction] = {}

    @wraps(state)
    def function(*given: _Arguments.args, **named: _Arguments.kwargs) -> BatchFunction:
        key = given, *sorted(named.items())
        if key not in made:
            made[key] = BatchFunction(partial(state, *given, **named), content_key(state, key))
        return made[key]

    return function


class BatchFunction:
    """A function of one instant, evaluated for N instants.

    Parameters
    ----------
    graph : Graph or callable
        The graph, or a function that builds it on demand: machine code in the cache makes it
        unnecessary.
    key : str, optional
        Digest of everything the graph is made of, the name of its machine code in the cache.
    """

    def __init__(self, graph: Graph | Callable[[], Graph], key: str | None = None) -> None:
        self._make, self._key = graph, key
        self._maps: dict[int, ca.Function] = {}
        self._code: MachineCode | None = None
        self._asked = 0
        """Samples so far."""
        self._one: _OneInstant | None = None

    @cached_property
    def _graph(self) -> tuple[ca.Function, Form]:
        graph = self._make if isinstance(self._make, Graph) else self._make()
        return graph.function()

    @property
    def _form(self) -> Form:
        return self._code.form if self._code else self._graph[1]

    @property
    def instructions(self) -> int:
        """Number of scalar instructions per sample."""
        return int(self._graph[0].n_instructions())

    def __call__(self, *inputs: Array) -> list[Array]:
        """Evaluate: varying inputs as (N, rows), fixed ones as (rows,).

        Every output is an array (N, rows, columns), or (N, rows) if it is a column.

        Raises
        ------
        ValueError
            The number of inputs or the size of one is wrong.
        """
        count = len(np.atleast_2d(inputs[0])) if inputs else 0
        code, form = self._machine_code(count), self._form
        # Machine code reads memory without any check of its own.
        if len(inputs) != len(form.inputs):
            raise ValueError(f"{len(inputs)} inputs, not {len(form.inputs)}")
        varying = [np.atleast_2d(value) for value in inputs[: form.varying]]
        fixed = [np.asarray(value, dtype=np.float64) for value in inputs[form.varying :]]
        for k, (value, rows) in enumerate(zip([*varying, *fixed], form.inputs, strict=True)):
            size = rows * (count if k < form.varying else 1)
            if value.size != size or (k < form.varying and len(value) != count):
                raise ValueError(f"input {k}: {value.size} values, not {size}")
        flat = code(varying, fixed) if code else self._interpret(varying, fixed, count)
        return [
            values if columns == 1 else values.reshape(count, rows, columns)
            for values, (rows, columns) in zip(flat, form.shapes, strict=True)
        ]

    @property
    def is_compiled(self) -> bool:
        """Whether machine code evaluates it by now."""
        return self._code is not None

    def load(self) -> bool:
        """Load the machine code if it is cached under the key; return whether it is loaded."""
        if self._code is None and self._key is not None:
            self._code = kept_code(self._key)
        return self.is_compiled

    def compile(self) -> None:
        """Compile machine code now, for all processes of this user, where that is possible."""
        if not self.load():
            self._machine_code(_COMPILING)

    def at(self, *inputs: Array) -> list[Array]:
        """Evaluate one instant: every input as (rows,), outputs without the axis of samples.

        The numbers are those of a call with one sample, in a fraction of the time.
        """
        if self._one is None:
            self._one = _OneInstant(*self._graph)
        return self._one(*inputs)

    def _machine_code(self, count: int) -> MachineCode | None:
        before, self._asked = self._asked, self._asked + count
        if before == 0:
            self.load()
        for enough in (_LOADING, _COMPILING):
            if self._code is None and before < enough <= self._asked:
                function, form = self._graph
                compiling = enough == _COMPILING
                self._code = machine_code(function, form, self._key, compiling=compiling)
        return self._code

    def _interpret(self, varying: list[Array], fixed: list[Array], count: int) -> list[Array]:
        """Evaluate by the virtual machine: (N, elements) of every output."""
        places = [list(place) for place in self._form.places]
        results = [np.zeros((count, size)) for size in self._form.sizes]
        for start in range(0, count, _PIECE):
            piece = slice(start, start + _PIECE)
            found = self._interpret_piece([value[piece] for value in varying], fixed)
            for whole, at, values in zip(results, places, found, strict=True):
                whole[piece, at] = values
        return results

    def _interpret_piece(self, varying: list[Array], fixed: list[Array]) -> list[Array]:
        count = len(varying[0])
        mapped = self._maps.get(count)
        if mapped is None:
            if len(self._maps) > _MOST_MAPS:
                self._maps.clear()
            mapped = self._maps[count] = self._graph[0].map(count)
        # CasADi's column of a sample is contiguous, like NumPy's row: nothing is converted.
        inputs = [np.ascontiguousarray(value, dtype=np.float64) for value in varying]
        inputs += [np.tile(np.ravel(value), (count, 1)).astype(np.float64) for value in fixed]
        outputs = [np.empty((count, len(places))) for places in self._form.places]
        _, evaluate = _bound_buffer(mapped, inputs, outputs)
        evaluate()
        return outputs


class _OneInstant:
    """A function bound to memory for one instant; threads that share it take turns."""

    def __init__(self, function: ca.Function, form: Form) -> None:
        self._lock = Lock()
        self._inputs = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self._outputs = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        # The buffer has to live as long as the function that evaluates it.
        self._buffer, self._evaluate = _bound_buffer(function, self._inputs, self._outputs)
        self._layouts: list[tuple[tuple[int, ...], NDArray[np.intp] | None]] = [
            (
                (rows,) if columns == 1 else (rows, columns),
                # None: the output has no zeros.
                None if len(place) == rows * columns else np.array(place, dtype=np.intp),
            )
            for place, (rows, columns) in zip(form.places, form.shapes, strict=True)
        ]

    def __call__(self, *inputs: Array) -> list[Array]:
        """Evaluate: every input as (rows,), every output as (rows,) or (rows, columns).

        Raises
        ------
        ValueError
            The size of an input is wrong.
        """
        for k, (place, value) in enumerate(zip(self._inputs, inputs, strict=True)):
            if value.shape != place.shape:
                raise ValueError(f"input {k}: {value.size} values, not {place.size}")
        with self._lock:
            for place, value in zip(self._inputs, inputs, strict=True):
                place[:] = value
            self._evaluate()
            found = [place.copy() for place in self._outputs]
        for k, (shape, places) in enumerate(self._layouts):
            if places is not None:
                whole = np.zeros(int(np.prod(shape)))
                whole[places] = found[k]
                found[k] = whole
            found[k] = found[k].reshape(shape)
        return found


def _bound_buffer(
    function: ca.Function, inputs: Sequence[Array], outputs: Sequence[Array]
) -> tuple[ca.FunctionBuffer, Callable[[], object]]:
    """Return a buffer of a function that reads and writes these arrays, and its evaluation."""
    buffer, evaluate = function.buffer()
    for k, value in enumerate(inputs):
        # The stubs ask for a size that the functions do not take.
        buffer.set_arg(k, value.data)  # type: ignore[call-arg]
    for k, value in enumerate(outputs):
        buffer.set_res(k, value.data)  # type: ignore[call-arg]
    return buffer, evaluate
