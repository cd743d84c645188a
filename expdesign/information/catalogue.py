"""The criteria that exist: every module of `expdesign.information.criteria` declares one."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Mapping
from functools import cache
from types import MappingProxyType

from expdesign.information import criteria
from expdesign.information.spectral import Criterion


@cache
def criteria_by_key() -> Mapping[str, Criterion]:
    """Return every criterion by its key; a file dropped into the folder adds one."""
    found: dict[str, Criterion] = {}
    for module in pkgutil.iter_modules(criteria.__path__):
        criterion = importlib.import_module(f"{criteria.__name__}.{module.name}").CRITERION
        if criterion.key != module.name:
            raise ValueError(f"information/criteria/{module.name}.py declares '{criterion.key}'")
        found[criterion.key] = criterion
    return MappingProxyType(found)
