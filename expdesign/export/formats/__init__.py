"""The formats of controller tables: every module of this folder declares one, ``FORMAT``."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

from constraints.modules import modules_of
from expdesign.export.definition import TableFormat


@cache
def table_formats() -> Mapping[str, TableFormat]:
    """Return every format by its name, in alphabetical order of the modules.

    A file dropped into ``expdesign/export/formats``, and its name and options in
    ``expdesign/configuration/sections/export.py``, are all that a new format needs.
    """
    found: dict[str, TableFormat] = {}
    for name, module in modules_of(sys.modules[__name__]).items():
        made = module.FORMAT
        if not isinstance(made, TableFormat):
            raise TypeError(f"{__name__}.{name}: FORMAT is no TableFormat")
        if made.name in found:
            raise ValueError(f"{__name__}.{name}: '{made.name}' is taken")
        found[made.name] = made
    return MappingProxyType(found)
