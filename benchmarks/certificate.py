"""Certificates of random motions against samples, a million of each of the first motions.

A motion is drawn at random and made as large as the machine's limits admit. Then every limit is
moved to where the motion's largest sample, found on many points and by local search about the
highest of them, leaves a share of its range to spare or exceeds it by one: all limits are active
at once. A contradiction is a limit whose largest sample exceeds what is proved, or one that is
certified though a sample exceeds it by more than 2e-6 of its range.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from expdesign.enclosure.paths import EnclosedSeries
from expdesign.recheck.certificate import certify
from expdesign.robot import LimitModel
from tests.enclosure.machines import ALL, robot
from tests.enclosure.motions import drawn, highest, lowered, near_limits, with_jerk

TITLE = "Certificates against samples"
SECTIONS = tuple(name.replace(" ", "-") for name in ALL)
MOTIONS = {"palida": 1000}
"""Of each machine, unless a number is given; a hundred of the others."""
POINTS, FEWER = 1_000_000, 20_000
DENSE = 20
"""The first motions, which are sampled at `POINTS`; the others, at `FEWER`, show more motions."""
SPARES = (1e-3, 1e-5, -2.5e-6, -1e-3)
_BROKEN = 2e-6
_ROUNDED = 1e-11
"""Of a sampled value, as a share of a limit's range."""


def rows(section: str, repetitions: int | None) -> Iterator[dict[str, Any]]:
    """Yield, of each share that is left to spare, what was certified of how many limits."""
    count = repetitions or MOTIONS.get(section, 100)
    limits = LimitModel.of(robot(dict(zip(SECTIONS, ALL, strict=True))[section]))
    counted: dict[float, list[dict[str, float]]] = {spare: [] for spare in SPARES}
    for seed in range(count):
        rng = np.random.default_rng(seed)
        motion = near_limits(limits, drawn(limits, rng), 0.0)
        bounded = with_jerk(limits, motion, 1e-3)
        found = highest(bounded, motion, POINTS if seed < DENSE else FEWER)
        for spare in SPARES:
            moved = [
                lowered(limit, moment, -spare)
                for limit, moment in zip(bounded.limits, found, strict=True)
            ]
            counted[spare].append(_compared(LimitModel(bounded.robot, tuple(moved)), motion, found))
    for spare in SPARES:
        table = pd.DataFrame(counted[spare])
        yield {
            "to spare": f"{spare:g}",
            "motions": count,
            "limits": int(table["limits"].sum()),
            "certified": f"{100 * table['certified'].sum() / table['limits'].sum():.2f} %",
            "motions certified whole": f"{100 * table['whole'].mean():.2f} %",
            "contradictions": int(table["contradictions"].sum()),
            "proved above found, at most": f"{table['apart'].max():.2g}",
            "cells, median": int(table["cells"].median()),
            "CPU time, median": f"{table['seconds'].median():.2f} s",
            "longest": f"{table['seconds'].max():.2f} s",
        }


def _compared(limits: LimitModel, motion: Any, found: list[Any]) -> dict[str, float]:
    """Return how a certificate compares with the values that were found."""
    start = time.process_time()
    checks = certify(limits, EnclosedSeries(motion))
    seconds = time.process_time() - start
    excess = np.array(
        [
            limit.violation_of(moment.row, moment.value)
            for limit, moment in zip(limits.limits, found, strict=True)
        ]
    )
    proved = np.array([check.proved for check in checks])
    certified = np.array([check.certified for check in checks])
    wrong = (excess > proved + _ROUNDED) | (certified & (excess > _BROKEN))
    return {
        "limits": len(checks),
        "certified": int(certified.sum()),
        "whole": float(certified.all()),
        "contradictions": int(wrong.sum()),
        "apart": float(np.max(proved - excess)),
        "cells": max(check.cells for check in checks),
        "seconds": seconds,
    }


def summary(table: pd.DataFrame) -> str:
    """Return what the table says in a sentence."""
    wrong = int(table["contradictions"].sum())
    return (
        f"{wrong} contradictions in {int(table['limits'].sum())} certificates of limits, each "
        f"against {POINTS:,} samples of the first {DENSE} motions, {FEWER:,} of the others, and a "
        "local search about the highest of them."
    )
