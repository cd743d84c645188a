"""The shipped run of PaLiDA over ten seeds: D-efficiency, limits, time and memory."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

import expdesign
from benchmarks.memory import largest_memory
from expdesign.configuration import load_run
from expdesign.robot import LimitModel

TITLE = "Main job over ten seeds"
BEST_KNOWN = 105.452
"""log det F of the best PaLiDA design that is known for n = 5, 200 samples: palida_best.json."""
GRID = 4000


def rows(seeds: range = range(10)) -> Iterator[dict[str, Any]]:
    """Yield one row per seed, as soon as it is known."""
    job = load_run("palida").run.model_dump(mode="json", exclude_none=True, by_alias=True)
    for seed in seeds:
        began = time.perf_counter()
        with largest_memory() as memory:
            result = expdesign.design(job | {"design": job["design"] | {"seed": seed}})
        seconds = time.perf_counter() - began
        motion = result.trajectory.sample(result.trajectory.sample_times(GRID))
        states = np.concatenate([motion.pose, motion.rate, motion.acceleration], axis=1)
        worst = float(np.max(LimitModel.of(result.robot).violations(states)))
        starts = result.solver.starts
        yield {
            "seed": seed,
            "log det F": round(result.log_det_information, 3),
            "D-efficiency %": round(
                100 * float(np.exp((result.log_det_information - BEST_KNOWN) / 24)), 1
            ),
            "worst violation": f"{worst:.1e}",
            "converged starts": f"{sum(s.converged for s in starts)}/{len(starts)}",
            "seconds": round(seconds),
            "CPU seconds": round(result.solver.cpu_seconds),
            "all processes GiB": round(memory[-1], 2),
        }


def summary(table: pd.DataFrame) -> str:
    """Return the figures that the claims are about."""
    efficiency = table["D-efficiency %"]
    return (
        f"D-efficiency: median {efficiency.median():.1f} %, smallest {efficiency.min():.1f} %; "
        f"time: median {table['seconds'].median():.0f} s, longest {table['seconds'].max()} s"
    )
