"""Evaluation of the symbolic graph over many samples: the one place where that is done.

By CasADi's virtual machine where samples are few, by machine code where they are many, and with
memory that stays bound where there is one at a time: always the same numbers. Threads may share it.
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
"""Samples, all together, from which on the cache is asked for what has no name."""
_COMPILING = 5000
"""Samples, all together, from which on machine code is made where the cache has none: the virtual
machine has taken about a third of the time by then that LLVM takes."""
_MOST_MAPS = 16
"""Bound on memory."""
_PIECE = 512
"""Samples that the virtual machine takes at a time."""


@dataclass(frozen=True)
class Graph:
    """Expressions of one instant: see `BatchFunction`."""

    name: str
    varying: Sequence[ca.SX]
    fixed: Sequence[ca.SX]
    outputs: Sequence[ca.SX]

    def function(self) -> tuple[ca.Function, Form]:
        """Return the function of the outputs' nonzeros, row by row, and its form."""
        # CasADi stores by columns, NumPy by rows.
        transposed = [output.T for output in self.outputs]
        nonzeros = [t.nz[:] for t in transposed]
        function = ca.Function(self.name, [*self.varying, *self.fixed], nonzeros, {"cse": True})
        form = Form(
            tuple(int(function.nnz_in(k)) for k in range(function.n_in())),
            len(self.varying),
            tuple((int(rows), int(columns)) for rows, columns in (o.shape for o in self.outputs)),
            tuple(_places(t) for t in transposed),
        )
        return function, form


def _places(transposed: ca.SX) -> tuple[int, ...]:
    rows, columns = transposed.sparsity().get_triplet()
    return tuple(
        int(column) * transposed.shape[0] + int(row)
        for column, row in zip(columns, rows, strict=True)
    )


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
    """

    def __init__(
        self,
        name: str,
        varying: Sequence[ca.SX],
        fixed: Sequence[ca.SX],
        outputs: Sequence[ca.SX],
    ) -> None:
        self._set(partial(Graph, name, varying, fixed, outputs), None)

    def _set(self, graph: Callable[[], Graph], name: str | None) -> None:
        self._make, self._name = graph, name
        self._maps: dict[int, ca.Function] = {}
        self._code: MachineCode | None = None
        self._asked = 0
        """Samples so far."""
        self._one: OneInstant | None = None

    @cached_property
    def _graph(self) -> tuple[ca.Function, Form]:
        return self._make().function()

    @property
    def _form(self) -> Form:
        return self._code.form if self._code else self._graph[1]

    @property
    def instructions(self) -> int:
        """Number of scalar instructions per sample."""
        return int(self._graph[0].n_instructions())

    def __call__(self, *inputs: Array) -> list[Array]:
        """Evaluate: varying inputs as (N, rows), fixed ones as (rows,).

        Raises
        ------
        ValueError
            There are other inputs than the function has, or one has another size.
        """
        count = len(np.atleast_2d(inputs[0])) if inputs else 0
        code, form = self._compiled(count), self._form
        # Machine code reads what it is given an address of, whatever is there.
        if len(inputs) != len(form.inputs):
            raise ValueError(f"{len(inputs)} inputs, not {len(form.inputs)}")
        varying = [np.atleast_2d(value) for value in inputs[: form.varying]]
        fixed = [np.asarray(value, dtype=np.float64) for value in inputs[form.varying :]]
        for k, (value, rows) in enumerate(zip([*varying, *fixed], form.inputs, strict=True)):
            size = rows * (count if k < form.varying else 1)
            if value.size != size or (k < form.varying and len(value) != count):
                raise ValueError(f"input {k}: {value.size} values, not {size}")
        flat = code(varying, fixed) if code else self._mapped(varying, fixed, count)
        return [
            values if columns == 1 else values.reshape(count, rows, columns)
            for values, (rows, columns) in zip(flat, form.shapes, strict=True)
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
            function, form = self._graph
            places = [np.array(place, dtype=np.intp) for place in form.places]
            self._one = OneInstant(function, form.shapes, places)
        return self._one(*inputs)

    def _compiled(self, count: int) -> MachineCode | None:
        before, self._asked = self._asked, self._asked + count
        if self._code is None and self._name is not None and before == 0:
            self._code = kept_code(self._name)
        for enough in (_LOADING, _COMPILING):
            if self._code is None and before < enough <= self._asked:
                function, form = self._graph
                compiling = enough == _COMPILING
                self._code = machine_code(function, form, self._name, compiling=compiling)
        return self._code

    def _mapped(self, varying: list[Array], fixed: list[Array], count: int) -> list[Array]:
        """Evaluate by the virtual machine: (N, elements) of every output."""
        places = [list(place) for place in self._form.places]
        results = [np.zeros((count, size)) for size in self._form.sizes]
        for start in range(0, count, _PIECE):
            piece = slice(start, start + _PIECE)
            found = self._piece([value[piece] for value in varying], fixed)
            for whole, at, values in zip(results, places, found, strict=True):
                whole[piece, at] = values
        return results

    def _piece(self, varying: list[Array], fixed: list[Array]) -> list[Array]:
        count = len(varying[0])
        mapped = self._maps.get(count)
        if mapped is None:
            if len(self._maps) > _MOST_MAPS:
                self._maps.clear()
            mapped = self._maps[count] = self._graph[0].map(count)
        # CasADi stores by columns and a map puts samples side by side: one sample after the
        # other in memory, as in a NumPy array with a row per sample. Nothing is converted.
        buffer, evaluate = mapped.buffer()
        inputs = [np.ascontiguousarray(value, dtype=np.float64) for value in varying]
        inputs += [np.tile(np.ravel(value), (count, 1)).astype(np.float64) for value in fixed]
        outputs = [np.empty((count, len(places))) for places in self._form.places]
        for k, value in enumerate(inputs):
            # The stubs ask for a size that the functions do not take.
            buffer.set_arg(k, value.data)  # type: ignore[call-arg]
        for k, value in enumerate(outputs):
            buffer.set_res(k, value.data)  # type: ignore[call-arg]
        evaluate()
        return outputs


class NamedFunction(BatchFunction):
    """A function whose graph is built only on demand.

    Machine code that is cached under the name, which identifies everything the graph is made of,
    makes the graph unnecessary. None: the function has no such name.
    """

    def __init__(self, make: Callable[[], Graph], name: str | None) -> None:
        self._set(make, name)


class OneInstant:
    """A function bound to memory for one instant; threads that share it take turns.

    Parameters
    ----------
    function : casadi.Function
        Its inputs and outputs are columns.
    shapes : list of (rows, columns)
        Of the outputs.
    places : list of int arrays
        Positions of their nonzeros in each output, row by row.
    """

    def __init__(
        self,
        function: ca.Function,
        shapes: Sequence[tuple[int, int]],
        places: list[NDArray[np.intp]],
    ) -> None:
        self._lock = Lock()
        self._inputs = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self._outputs = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        # The buffer has to live as long as what evaluates it.
        self._buffer, self._evaluate = function.buffer()
        for k, value in enumerate(self._inputs):
            # The stubs ask for a size that the functions do not take.
            self._buffer.set_arg(k, value.data)  # type: ignore[call-arg]
        for k, value in enumerate(self._outputs):
            self._buffer.set_res(k, value.data)  # type: ignore[call-arg]
        # None: all of them in their order
        dense = [
            len(place) == rows * columns
            for place, (rows, columns) in zip(places, shapes, strict=True)
        ]
        self._layouts = [
            ((rows,) if columns == 1 else (rows, columns), None if full else place)
            for (rows, columns), place, full in zip(shapes, places, dense, strict=True)
        ]

    def __call__(self, *inputs: Array) -> list[Array]:
        """Evaluate: every input as (rows,), every output as (rows,) or (rows, columns).

        Raises
        ------
        ValueError
            An input has another size.
        """
        for k, (place, value) in enumerate(zip(self._inputs, inputs, strict=True)):
            if value.shape != place.shape:
                raise ValueError(f"input {k}: {value.size} values, not {place.size}")
        with self._lock:
            for place, value in zip(self._inputs, inputs, strict=True):
                place[:] = value
            self._evaluate()
            values = [place.copy() for place in self._outputs]
        return [
            whole.reshape(shape) if places is None else _spread(whole, shape, places)
            for whole, (shape, places) in zip(values, self._layouts, strict=True)
        ]


def _spread(values: Array, shape: tuple[int, ...], places: NDArray[np.intp]) -> Array:
    whole = np.zeros(shape)
    whole.reshape(-1)[places] = values
    return whole


_Arguments = ParamSpec("_Arguments")


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
            made[key] = NamedFunction(partial(state, *given, **named), content_key(state, key))
        return made[key]

    return function
