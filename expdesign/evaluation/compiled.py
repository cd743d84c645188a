"""Loops over numbers as machine code, made by Numba."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TypeVar, cast

from numba import njit

_Function = TypeVar("_Function", bound=Callable[..., object])


def compiled(function: _Function) -> _Function:
    """Compile a function with Numba at its first call and cache the machine code."""
    compiler = partial(njit, error_model="numpy", nogil=True)
    try:
        made = compiler(cache=True)(function)
    except RuntimeError:  # there is no folder that it could be kept in
        made = compiler()(function)
    return cast("_Function", made)
