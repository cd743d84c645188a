"""Functions of the robot's graph, named by what they are made of.

To make a graph with all its derivatives takes longer than to load its machine code. A kernel is
known by the function that states it, by its arguments and by the project's sources, so that the
graph is made only where there is no machine code of it yet.
"""

from __future__ import annotations

import copyreg
import hashlib
import time
from collections.abc import Callable, Hashable
from enum import Enum
from functools import cache, partial, wraps
from importlib.metadata import version
from pathlib import Path
from typing import ParamSpec

import constraints
from constraints import limits
from expdesign.evaluation.batch import BatchFunction, Graph, NamedFunction

_Arguments = ParamSpec("_Arguments")
_PROJECT = Path(constraints.__file__).parents[1]
_PACKAGES = ("constraints", "expdesign", "estimation")
_BEGAN = time.time_ns() - 60_000_000_000
"""What has changed since then, a minute before this was imported, may not be what is running."""


def kernel(state: Callable[_Arguments, Graph]) -> Callable[_Arguments, BatchFunction]:
    """Make of a function that states a graph one that returns it for evaluation, made once.

    Its arguments are hashable: terms and limits, and settings.
    """
    made: dict[Hashable, BatchFunction] = {}

    @wraps(state)
    def function(*given: _Arguments.args, **named: _Arguments.kwargs) -> BatchFunction:
        key = given, *sorted(named.items())
        if key not in made:
            name = f"{state.__module__}.{state.__qualname__}"
            made[key] = NamedFunction(partial(state, *given, **named), _full(name, key))
        return made[key]

    return function


def _full(name: str, arguments: object) -> str | None:
    """Return a name for all that a graph is made of; None where that cannot be told."""
    known, sources = _named(arguments), _sources(tuple(limits.__path__))
    return f"{name} {known} {sources} {version('casadi')}" if known and sources else None


def _named(value: object) -> str | None:
    """Return what stands for an argument; None for what is not of the project's own catalogues.

    What is of a catalogue goes to other processes by its name as well.
    """
    if isinstance(value, tuple):
        names = [_named(one) for one in value]
        known = [name for name in names if name is not None]
        return f"({' '.join(known)})" if len(known) == len(names) else None
    if isinstance(value, bool | str | Enum):
        return repr(value)
    reduce = copyreg.dispatch_table.get(type(value))
    reduced = reduce(value) if reduce else ""
    if isinstance(reduced, str):
        return None
    _, arguments, *state = reduced
    by_name = not state and all(isinstance(one, str) for one in arguments)
    return f"{type(value).__name__}{arguments}" if by_name else None


def _sources(added: tuple[str, ...]) -> str | None:
    """Return a hash of all that a graph may be made by; None where any of it has just changed.

    A limit may be a file in another folder: these are `added`. A new file changes its folder.
    """
    try:
        files = _files(added)
        watched = {*files, *(path.parent for path in files)}
        if not files or any(path.stat().st_ctime_ns > _BEGAN for path in watched):
            return None
        return _hashed(files)
    except OSError:  # another program's: a link to nowhere, a file that has just gone
        return None


@cache
def _files(added: tuple[str, ...]) -> tuple[Path, ...]:
    folders = [*(_PROJECT / name for name in _PACKAGES), *map(Path, added)]
    return tuple(path for folder in folders for path in sorted(folder.rglob("*.py")))


@cache
def _hashed(files: tuple[Path, ...]) -> str:
    digest = hashlib.sha256()
    for path in files:
        digest.update(f"{path.name}\0".encode() + path.read_bytes() + b"\0")
    return digest.hexdigest()
