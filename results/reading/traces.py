"""`tables/convergence.csv`: what the optimiser went through in every start."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from results.reading.table import Table

HOP = "hop"


@dataclass(frozen=True, eq=False)
class Trace:
    """The iterations of one start, in their order.

    Attributes
    ----------
    start : int
        Number of the start.
    kind : str
        ``"random"``, ``"hop"`` or another word for where it started from.
    stages : tuple of str
        Stage of every iteration.
    iteration : (K,)
        Number of the iteration, counted over the start's stages.
    objective : (K,)
        Smoothed criterion in the unit in which it is reported; NaN where it had no value.
    violation : (K,)
        Largest violation as a share of the limit's range; NaN where it had no value.
    """

    start: int
    kind: str
    stages: tuple[str, ...]
    iteration: Array
    objective: Array
    violation: Array

    @property
    def is_hop(self) -> bool:
        """True when it started from a disturbed earlier solution."""
        return self.kind == HOP


def read_traces(path: Path) -> tuple[Trace, ...]:
    """Read the traces of all starts, in the order of their numbers.

    Raises
    ------
    RunFolderError
        The file is missing or no such table.
    """
    table = Table.read(path, ["start", "kind", "stage", "iteration", "objective", "violation"])
    start = table.numbers("start").astype(int)
    iteration = table.numbers("iteration")
    objective = table.numbers("objective", blank=True)
    violation = table.numbers("violation", blank=True)
    traces = []
    for number in np.unique(start):
        rows = np.flatnonzero(start == number)
        rows = rows[np.argsort(iteration[rows], kind="stable")]
        stages = tuple(table.columns["stage"][row] for row in rows)
        kind = table.columns["kind"][rows[0]]
        traces.append(
            Trace(int(number), kind, stages, iteration[rows], objective[rows], violation[rows])
        )
    return tuple(traces)
