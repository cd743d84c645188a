"""Extensions: the declarations in the modules of a folder and in installed plug-ins.

A limit, a criterion, a term, a file format or a stage is declared in one module. It lies in the
folder of its kind, or in a package of somebody else that names the module in its entry points::

    [project.entry-points."expdesign.plugins"]
    my_limits = "my_package.limits"
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Collection, Iterable, Mapping
from functools import cache
from importlib.metadata import entry_points
from types import MappingProxyType, ModuleType
from typing import TypeVar

GROUP = "expdesign.plugins"
"""Entry-point group; each of its entry points is a module."""

Kind = TypeVar("Kind")


def declarations(
    kind: type[Kind], package: ModuleType | str | None = None, *names: str
) -> tuple[Kind, ...]:
    """Return the instances of a class that a package's modules and all plug-ins declare.

    Every instance that a module binds to a public name, or to one of `names`, counts, and every one
    in a tuple or list bound to it. Each is returned once, in alphabetical order of the modules,
    those of the package first. A caller on a lower floor of the architecture gives its name.

    Examples
    --------
    >>> from constraints import LimitDefinition, limits
    >>> len(declarations(LimitDefinition, limits)) > 10
    True
    """
    found: dict[int, Kind] = {}
    for module in _search_modules(package):
        for value in _public_values(module, names):
            items = value if isinstance(value, tuple | list) else (value,)
            found |= {id(item): item for item in items if isinstance(item, kind)}
    return tuple(found.values())


def declared_classes(
    base: type[Kind], package: ModuleType | str | None = None
) -> tuple[type[Kind], ...]:
    """Return the subclasses of a class that a package's modules and all plug-ins define.

    A class is taken from the module that defines it, not from those that import it.
    """
    return tuple(
        value
        for module in _search_modules(package)
        for value in _public_values(module)
        if isinstance(value, type)
        and issubclass(value, base)
        and value is not base
        and value.__module__ == module.__name__
    )


@cache
def plugin_modules() -> Mapping[str, ModuleType]:
    """Return the modules of the installed plug-ins by entry-point name, in alphabetical order."""
    points = sorted(entry_points(group=GROUP), key=lambda point: point.name)
    return MappingProxyType({point.name: importlib.import_module(point.value) for point in points})


def _search_modules(package: ModuleType | str | None) -> Iterable[ModuleType]:
    if package is None:
        return plugin_modules().values()
    package = importlib.import_module(package) if isinstance(package, str) else package
    names = sorted(one.name for one in pkgutil.iter_modules(package.__path__))
    own = [importlib.import_module(f"{package.__name__}.{name}") for name in names]
    return (*own, *plugin_modules().values())


def _public_values(module: ModuleType, names: Collection[str] = ()) -> list[object]:
    return [
        value
        for name, value in vars(module).items()
        if name in names or not (names or name.startswith("_"))
    ]
