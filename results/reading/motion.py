"""`trajectory.csv`: one period of the motion that was checked."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from results.errors import RunFolderError
from results.reading.table import Table

COORDINATES = ("x", "y", "z", "phi", "theta", "psi")
_STRUTS = range(1, 7)
_LEAST_ROWS = 2


@dataclass(frozen=True, eq=False)
class Motion:
    """The motion at the controller's steps; SI units and radians, the end left out.

    Attributes
    ----------
    time : (N,)
        s, from 0.
    pose : (N, 6)
        x, y, z, φ, θ, ψ.
    length, speed, acceleration : (N, 6)
        Of the struts.
    alpha, beta : (N, 6)
        Cardan angles of the struts.
    force : (N, 6)
        Actuator forces at the nominal parameters.
    """

    time: Array
    pose: Array
    length: Array
    speed: Array
    acceleration: Array
    alpha: Array
    beta: Array
    force: Array

    @classmethod
    def read(cls, path: Path) -> Motion:
        """Read the file.

        Raises
        ------
        RunFolderError
            It is missing, has not the columns, or its time does not increase.
        """
        groups = [COORDINATES] + [
            tuple(f"{prefix}{j}" for j in _STRUTS)
            for prefix in ("q", "dq", "ddq", "alpha", "beta", "Q")
        ]
        table = Table.read(path, ["t", *(name for group in groups for name in group)])
        time = table.numbers("t")
        if time.size < _LEAST_ROWS or np.any(np.diff(time) <= 0):
            raise RunFolderError(path, "column t: expected at least two increasing times")
        return cls(time, *(table.block(group) for group in groups))

    @property
    def period(self) -> float:
        """Duration, s: one step more than the last time."""
        return float(self.time[-1] + (self.time[-1] - self.time[0]) / (self.time.size - 1))
