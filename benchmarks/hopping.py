"""Basin hopping: what 100 hops add to 8 starts, PaLiDA, n = 5."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
import pandas as pd

import expdesign
from benchmarks.design_seeds import BEST_KNOWN

TITLE = "Basin hopping"

_STARTS = 8


def rows(hops: int = 100, seeds: Iterable[int] = (0,)) -> Iterator[dict[str, Any]]:
    """Yield one row per seed, as soon as it is known."""
    for seed in seeds:
        began = time.perf_counter()
        result = expdesign.design(
            {
                "name": "hopping",
                "robot": "palida",
                "design": {"search": "hopping", "starts": _STARTS, "hops": hops, "seed": seed},
            }
        )
        value = result.log_det_information
        tried = [start for start in result.search.starts if start.index > _STARTS]
        yield {
            "seed": seed,
            "hops": len(tried),
            "given up": sum(not np.isfinite(start.merit) for start in tried),
            "log det F": round(value, 3),
            "D-efficiency %": round(100 * float(np.exp((value - BEST_KNOWN) / 24)), 1),
            "seconds": round(time.perf_counter() - began),
        }


def summary(table: pd.DataFrame) -> str:
    """Return the efficiency reached."""
    reached = ", ".join(f"{value} %" for value in table["D-efficiency %"])
    return f"{table['hops'][0]} hops: {reached} of the best known"
