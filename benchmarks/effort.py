"""Designs by each effort over seeds: D-efficiency, and the time of the whole command."""

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
from benchmarks.totals import HELD
from expdesign.configuration import load_run, resolved_yaml
from expdesign.configuration.design import EFFORTS

TITLE = "Effort of a design"
BEST_KNOWN = 105.452
"""log det F of the best PaLiDA design that is known for n = 5, 200 samples."""
_OTHERS_KNOWN = {"n3": 95.259, "n8": 111.127}
"""The same for other numbers of harmonics; other robots are compared with their first seed."""
SECTIONS = {"quick": 20, "normal": 20, "thorough": 20, "n3": 5, "n8": 5, "linuxcnc": 5, "rubin": 5}
"""Number of seeds by effort of `palida`, and by harmonics or robot of the normal effort."""
_HERE = Path(__file__).resolve().parents[1]


def rows(section: str, repetitions: int | None = None) -> Iterator[dict[str, Any]]:
    """Yield one row per seed: of ``expdesign design RUN --effort EFFORT --seed S``."""
    effort = section if section in EFFORTS else "normal"
    robot = "palida" if effort == section or section.startswith("n") else section
    best = BEST_KNOWN if effort == section else _OTHERS_KNOWN.get(section)
    for seed in range(repetitions or SECTIONS[section]):
        with tempfile.TemporaryDirectory() as place:
            known = {"known": HELD.get(robot, [])}
            other = {"name": robot, "robot": robot, "design": known}
            run = load_run("palida" if robot == "palida" else other)
            if section in {"n3", "n8"}:
                run = run.with_section("trajectory", harmonics=int(section[1:]))
            file = Path(place) / "effort.yaml"
            file.write_text(resolved_yaml(run))
            command = ["design", str(file), "--effort", effort, "--seed", str(seed)]
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
        best = reached if best is None else best
        count = len(found["predicted_std"]["per_period"]) - 2  # samples and periods
        yield {
            "seed": seed,
            "log det F": round(reached, 3),
            "D-efficiency %": round(100 * float(np.exp((reached - best) / count)), 1),
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
