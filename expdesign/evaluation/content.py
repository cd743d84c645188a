"""Digests of the content of functions and data: keys of results that are made of them.

The content of a function is its instructions and constants, and those of every function, class and
constant that it uses. Docstrings, comments and the places of the source are no part of it, and
neither is code that the function does not use.
"""

from __future__ import annotations

import dis
import hashlib
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache, cached_property, partial
from importlib.metadata import version
from types import BuiltinFunctionType, CodeType, FunctionType, MethodWrapperType, ModuleType
from typing import Any

import casadi as ca
import numpy as np

_LIBRARIES = frozenset({*sys.stdlib_module_names, "casadi", "llvmlite", "numpy", "scipy"})
"""Objects of these packages are represented by their names; versions are part of every key."""
_NAMES_ONLY = {
    *("member_descriptor", "getset_descriptor", "_tuplegetter", "_abc_data"),
    "_HAS_DEFAULT_FACTORY_CLASS",
}
"""Types of objects in classes that have no content of their own."""
_PLAIN = (bool, int, float, complex, str, bytes, type(None), type(Ellipsis), range)


def content_key(*values: object) -> str | None:
    """Return a digest of the content of functions and data; None for content without a key.

    Examples
    --------
    >>> content_key(lambda x: x + 1) == content_key(lambda x: x + 1)
    True
    >>> content_key(lambda x: x + 1) == content_key(lambda x: x + 2)
    False
    """
    digest = hashlib.sha256(f"{sys.version} {version('casadi')} {np.__version__}".encode())
    numbers: dict[object, int] = {}
    waiting: list[object] = [values]
    try:
        while waiting:
            value = waiting.pop()
            # Only functions and classes may refer to each other in a circle.
            if isinstance(value, FunctionType | type):
                if value in numbers:
                    digest.update(f"again {numbers[value]}\0".encode())
                    continue
                numbers[value] = len(numbers)
            text, parts = _content(value)
            digest.update(f"{text} {len(parts)}\0".encode())
            waiting += reversed(parts)
    except _NoKeyError:
        return None
    return digest.hexdigest()


class _NoKeyError(Exception):
    """An object whose content is not known."""


def _content(value: object) -> tuple[str, list[object]]:
    """Return the own content of an object as text, and the objects that it consists of."""
    if type(value).__name__ in _NAMES_ONLY:
        return type(value).__name__, []
    if _is_of_library(value):
        return f"name {getattr(value, '__module__', '')} {_name(value)}", []
    for types, content in _CONTENTS:
        if isinstance(value, types):
            return content(value)
    if hasattr(value, "__wrapped__"):
        return type(value).__name__, [value.__wrapped__]
    if is_dataclass(value):
        return "instance", [type(value), *(getattr(value, field.name) for field in fields(value))]
    raise _NoKeyError


def _set(value: frozenset[object]) -> tuple[str, list[object]]:
    if not all(isinstance(one, _PLAIN) for one in value):
        raise _NoKeyError
    return "set", sorted(value, key=repr)


def _built_in(value: BuiltinFunctionType) -> tuple[str, list[object]]:
    own = value.__self__
    named = own is None or isinstance(own, type | ModuleType)
    return f"built-in {_name(value)}", [_name(own) if named else own]


def _function(value: FunctionType) -> tuple[str, list[object]]:
    cells = [cell.cell_contents for cell in value.__closure__ or ()]
    own = [value.__defaults__, value.__kwdefaults__, *cells]
    return f"function {_instructions(value.__code__)}", [*own, *_globals_of(value)]


_CONTENTS: tuple[tuple[Any, Callable[[Any], tuple[str, list[object]]]], ...] = (
    (Enum, lambda value: (f"member {value.name}", [type(value), value.value])),
    (_PLAIN, lambda value: (f"{type(value).__name__} {value!r}", [])),
    ((tuple, list), lambda value: (type(value).__name__, list(value))),
    ((set, frozenset), _set),
    (Mapping, lambda value: ("mapping", [part for item in value.items() for part in item])),
    (np.ndarray, lambda value: (f"array {value.dtype} {value.shape} {value.tobytes().hex()}", [])),
    ((ca.Sparsity, ca.DM), lambda value: (f"casadi {value.serialize()}", [])),
    ((BuiltinFunctionType, MethodWrapperType), _built_in),
    (FunctionType, _function),
    (partial, lambda value: ("partial", [value.func, value.args, value.keywords])),
    (property, lambda value: ("property", [value.fget])),
    (cached_property, lambda value: ("property", [value.func])),
    (type, lambda value: (f"class {value.__qualname__}", [*value.__bases__, *_attributes(value)])),
)
"""Content of an object by its type."""


def _name(value: object) -> str:
    return str(getattr(value, "__qualname__", getattr(value, "__name__", "")))


def _is_of_library(value: object) -> bool:
    """Return whether a module, a function or a class belongs to a library: its name is enough."""
    if isinstance(value, ModuleType):
        return value.__name__.partition(".")[0] in _LIBRARIES
    module = getattr(value, "__module__", None) or ""
    return (
        (isinstance(value, type) or callable(value))
        and module.partition(".")[0] in _LIBRARIES
        and bool(_name(value))
    )


def _attributes(cls: type) -> Iterator[object]:
    """Yield names and values of a class's own attributes, without its documentation."""
    for name, value in vars(cls).items():
        special = name.startswith("__") and not callable(value)
        if not (special or name in {"__annotate__", "__annotate_func__"}):
            yield from (name, value)


def _globals_of(function: FunctionType) -> Iterator[object]:
    """Yield names and values of the globals in a function's code, in alphabetical order.

    Of a module that is no library's only the attributes in the code count.
    """
    names = _names_in(function.__code__)
    for name in sorted(names & function.__globals__.keys()):
        value = function.__globals__[name]
        yield name
        if isinstance(value, ModuleType) and not _is_of_library(value):
            for attribute in sorted(names & vars(value).keys()):
                yield from (attribute, vars(value)[attribute])
        else:
            yield value


@cache
def _names_in(code: CodeType) -> frozenset[str]:
    inner = (constant for constant in code.co_consts if isinstance(constant, CodeType))
    return frozenset(code.co_names).union(*map(_names_in, inner))


@cache
def _instructions(code: CodeType) -> str:
    """Return a digest of the instructions with their arguments: docstrings are none of them."""
    counts = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
    names = code.co_names, code.co_varnames, code.co_cellvars, code.co_freevars
    found: list[object] = [counts, names, code.co_code, code.co_exceptiontable]
    higher = 0
    for operation, low in zip(code.co_code[::2], code.co_code[1::2], strict=True):
        argument = higher << 8 | low
        higher = argument if operation == dis.EXTENDED_ARG else 0
        if operation in _WITH_CONSTANT:
            constant = code.co_consts[argument]
            if isinstance(constant, CodeType):
                constant = _instructions(constant)
            elif isinstance(constant, frozenset):
                constant = sorted(constant, key=repr)
            found.append(constant)
        elif operation == _IMPORT and code.co_names[argument].partition(".")[0] not in _LIBRARIES:
            raise _NoKeyError
    return hashlib.sha256(repr(found).encode()).hexdigest()


_WITH_CONSTANT, _IMPORT = frozenset(dis.hasconst), dis.opmap["IMPORT_NAME"]
