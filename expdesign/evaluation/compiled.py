"""Loops over numbers as machine code, made by Numba."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import TypeVar, cast

from numba import njit

from expdesign.runfolder.files import foreign_folder

_Function = TypeVar("_Function", bound=Callable[..., object])


def compiled(function: _Function) -> _Function:
    """Compile a function with Numba at its first call and cache the machine code.

    The cache is next to the source, or in a folder that only this user may write to.
    """
    compiler = partial(njit, error_model="numpy", nogil=True)
    try:
        made = compiler(cache=True)(function)
    except RuntimeError:  # there is no folder that it could be kept in
        return cast("_Function", compiler()(function))
    folder = Path(made.stats.cache_path or "")
    if not folder.is_relative_to(Path(inspect.getfile(function)).parent) and _is_foreign(folder):
        made = compiler()(function)
    return cast("_Function", made)


@cache
def _is_foreign(folder: Path) -> bool:
    return not folder.is_dir() or bool(foreign_folder(folder))
