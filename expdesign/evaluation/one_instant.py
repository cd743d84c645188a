"""A CasADi function for one instant at a time, where the call costs more than the numbers.

A map of one sample and a buffer made for each call take longer than the instructions themselves.
Here the function is bound once to memory of its own; a call copies in, evaluates and copies out.
"""

from __future__ import annotations

from collections.abc import Sequence
from threading import Lock

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array


class OneInstant:
    """A function bound to memory for one instant; threads that share it take turns.

    Parameters
    ----------
    function : casadi.Function
        Its inputs and outputs are columns.
    shapes : list of (rows, columns)
        Of the outputs.
    places : list of int arrays
        Where their nonzeros stand in the rows of each, one row after the other.
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
