"""Basin hopping: what 100 hops add to 8 starts, PaLiDA, n = 5."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

import expdesign
from benchmarks.design_seeds import BEST_KNOWN

TITLE = "Basin hopping"


def rows(hops: int = 100) -> Iterator[dict[str, Any]]:
    """Yield one row."""
    began = time.perf_counter()
    result = expdesign.design(
        {
            "name": "hopping",
            "robot": "palida",
            "design": {"search": "hopping", "starts": 8, "hops": hops},
        }
    )
    value = result.log_det_information
    yield {
        "hops": hops,
        "log det F": round(value, 3),
        "D-efficiency %": round(100 * float(np.exp((value - BEST_KNOWN) / 24)), 1),
        "seconds": round(time.perf_counter() - began),
    }


def summary(table: pd.DataFrame) -> str:
    """Return the efficiency reached."""
    return f"{table['hops'][0]} hops: {table['D-efficiency %'][0]} % of the best known"
