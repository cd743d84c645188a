"""Designs of PaLiDA by each effort over seeds: D-efficiency, and the time of the whole command."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from benchmarks.memory import largest_memory

TITLE = "Effort of a design"
BEST_KNOWN = 105.452
"""log det F of the best PaLiDA design that is known for n = 5, 200 samples."""
PARAMETERS = 24
SECTIONS = {"quick": 20, "normal": 20, "thorough": 20}
"""Number of seeds by effort."""
_HERE = Path(__file__).resolve().parents[1]


def rows(section: str, repetitions: int | None = None) -> Iterator[dict[str, Any]]:
    """Yield one row per seed: of ``expdesign design palida --effort SECTION --seed S``."""
    for seed in range(repetitions or SECTIONS[section]):
        with tempfile.TemporaryDirectory() as place:
            command = ["design", "palida", "--effort", section, "--seed", str(seed)]
            before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            with largest_memory() as memory:
                subprocess.run(
                    [sys.executable, "-m", "expdesign", *command, "--out", place],
                    env={**os.environ, "PYTHONPATH": str(_HERE)},
                    capture_output=True,
                    check=True,
                )
            seconds = time.perf_counter() - began
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            found = json.loads((Path(place) / "design.json").read_text())
        used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        reached = found["log_det_information"]
        yield {
            "seed": seed,
            "log det F": round(reached, 3),
            "D-efficiency %": round(100 * float(np.exp((reached - BEST_KNOWN) / PARAMETERS)), 1),
            "status": found["status"],
            "every limit proved": all(limit["certified"] for limit in found["limits"].values()),
            "seconds": round(seconds, 1),
            "processor seconds": round(used, 1),
            "all processes GiB": round(memory[-1], 2),
        }


def summary(table: pd.DataFrame) -> str:
    """Return the figures that the claims are about."""
    efficiency, proved = table["D-efficiency %"], table["every limit proved"]
    low = float(np.quantile(efficiency, 0.05, method="lower"))
    seconds, used = table["seconds"], table["processor seconds"]
    return (
        f"D-efficiency: median {efficiency.median():.1f} %, 19 of 20 at least {low:.1f} %, "
        f"smallest {efficiency.min():.1f} %; whole command: median {seconds.median():.1f} s, "
        f"longest {seconds.max():.1f} s, median of processor time {used.median():.1f} s; "
        f"{proved.sum()} of {len(table)} proved"
    )
