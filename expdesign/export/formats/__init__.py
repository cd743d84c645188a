"""Formats of controller tables: a module for each, with its ``FORMAT`` and its options."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

from constraints.plugins import declarations
from expdesign.export.definition import TableFormat


@cache
def table_formats() -> Mapping[str, TableFormat]:
    """Return every format by its name, in alphabetical order.

    A new format is one file in this folder, or a plug-in.

    Examples
    --------
    >>> table_formats()["csv"].suffix
    '.csv'
    """
    found = {form.name: form for form in declarations(TableFormat, __name__, "FORMAT")}
    return MappingProxyType(dict(sorted(found.items())))
