"""PaLiDA with 1 to 12 harmonics and 50 to 1000 samples: what is reached, and in what time."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import Any

import pandas as pd

import expdesign
from benchmarks import effort

TITLE = "Harmonics and samples"

BEST_KNOWN = {3: 95.259, 5: effort.BEST_KNOWN, 8: 111.127}
"""log det F of the best PaLiDA designs that are known for 200 samples."""

_KNOWN_FOR = 200

_CASES = (*((n, 200, 2) for n in range(1, 13)), (12, 50, 2), (12, 1000, 2))


def rows(cases: Sequence[tuple[int, int, int]] = _CASES) -> Iterator[dict[str, Any]]:
    """Yield one row per case (harmonics, samples, starts), as soon as it is known."""
    for harmonics, samples, starts in cases:
        began = time.perf_counter()
        result = expdesign.design(
            {
                "name": f"palida-{harmonics}-{samples}",
                "robot": "palida",
                "trajectory": {"harmonics": harmonics, "samples": samples},
                "design": {"starts": starts, "search": "restarts"},
            }
        )
        known = BEST_KNOWN.get(harmonics) if samples == _KNOWN_FOR else None
        yield {
            "harmonics": harmonics,
            "samples": samples,
            "starts": starts,
            "log det F": round(result.log_det_information, 3),
            "best known": "" if known is None else known,
            "keeps the limits": result.passed,
            "seconds": round(time.perf_counter() - began),
        }


def summary(table: pd.DataFrame) -> str:
    """Return whether every case ended with a design that keeps the limits."""
    return f"{int(table['keeps the limits'].sum())} of {len(table)} designs keep every limit"
