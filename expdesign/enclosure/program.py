"""A sequence of instructions on packed Taylor models, compiled by Numba."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.enclosure.arithmetic import (
    TERMS,
    add,
    invert,
    larger,
    multiply,
    take_root,
)
from expdesign.evaluation.compiled import compiled

ASSIGN, NUMBER, ADD, SUBTRACT, NEGATE, MULTIPLY, TWICE, INVERT, ROOT, LARGER = range(10)
"""Instructions: of a row (instruction, target, first, second) of a program.

`NUMBER` writes the number whose place among the constants is the first.
"""
ROOM = 5
"""Packed models that `run` needs to work with."""


@compiled
def run(
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
