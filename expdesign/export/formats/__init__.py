"""The formats of controller tables: every module of this folder declares one, ``FORMAT``."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

from expdesign.export.definition import TableFormat


@cache
def table_formats() -> Mapping[str, TableFormat]:
    """Return every format by its name, in alphabetical order of the modules.

    A file dropped into ``expdesign/export/formats``, and its name and options in
    ``expdesign/configuration/export.py``, are all that a new format needs.
    """
    found: dict[str, TableFormat] = {}
    for module in sorted(pkgutil.iter_modules(__path__), key=lambda item: item.name):
        made = importlib.import_module(f"{__name__}.{module.name}").FORMAT
        if not isinstance(made, TableFormat):
            raise TypeError(f"{__name__}.{module.name}: FORMAT is no TableFormat")
        if made.name in found:
            raise ValueError(f"{__name__}.{module.name}: '{made.name}' is taken")
        found[made.name] = made
    return MappingProxyType(found)
