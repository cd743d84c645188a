"""Words for findings: struts by their numbers from 1, lists, singular and plural."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray


def struts(kind: str, struts: NDArray[np.intp]) -> str:
    """Return ``"struts 3 and 4"`` for the indices 2 and 3."""
    plural = "s" if len(struts) > 1 else ""
    return f"{kind}{plural} {listed(str(j + 1) for j in struts)}"


def verb(struts: NDArray[np.intp], one: str, many: str) -> str:
    """Return the word that goes with the number of struts."""
    return one if len(struts) == 1 else many


def listed(words: Iterable[str]) -> str:
    """Return ``"a, b and c"``."""
    items = list(words)
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]
