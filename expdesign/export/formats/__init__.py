"""The formats of controller tables: a module of this folder for each, with its ``FORMAT``."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from types import MappingProxyType

from expdesign.configuration.sections.export import OFFERS
from expdesign.export.definition import TableFormat


@cache
def table_formats() -> Mapping[str, TableFormat]:
    """Return every format by its name, in alphabetical order.

    A name among the `OFFERS` of the configuration, and the module here that is spelt so, are all
    that a new format needs.
    """
    modules = {
        name: import_module(f"{__name__}.{name.replace('-', '_')}") for name in sorted(OFFERS)
    }
    return MappingProxyType({name: module.FORMAT for name, module in modules.items()})
