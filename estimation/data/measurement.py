"""A recorded experiment in SI units, whatever file or simulation it came from."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.configuration import FORCE_CHANNELS, LENGTH_CHANNELS
from expdesign.mechanism.hexapod import ACTUATORS


@dataclass(frozen=True, eq=False)
class Measurement:
    """Strut lengths and actuator forces over time."""

    time: Array
    """(T,), time stamps, s, strictly increasing. Uniform recordings hold the fitted grid, stamped
    ones the stamps as they were."""
    lengths: Array
    """(T, 6), q1…q6, m."""
    forces: Array
    """(T, 6), Q1…Q6, N, positive when they extend."""
    step: float
    """Time between two samples, s (the mean one when stamped)."""
    stamped: bool = False
    """True when the stamps jitter and are to be used as they are."""
    period: NDArray[np.int64] | None = None
    """(T,), number of the period that each row belongs to, when the file has that column."""
    length_delay: float = 0.0
    force_delay: float = 0.0
    """By how much the channels lag behind the time stamps, s: a length recorded at t is the
    one at t − length_delay."""
    jitter: float = 0.0
    """Largest deviation of the stamps from the uniform grid, as a share of a step."""
    lost: int = 0
    """Samples that are missing between the rows: gaps in a uniform grid, or in stamps."""
    source: str = ""
    warnings: tuple[str, ...] = ()
    """What a user should know about how it was read."""

    def __post_init__(self) -> None:
        """Refuse shapes that do not fit together."""
        count = len(self.time)
        shapes = {"lengths": (count, ACTUATORS), "forces": (count, ACTUATORS), "period": (count,)}
        for name, shape in shapes.items():
            found = getattr(self, name)
            if found is not None and np.shape(found) != shape:
                raise ValueError(f"{name}: expected {shape}, got {np.shape(found)}")

    @property
    def channels(self) -> dict[str, NDArray[Any]]:
        """(T,) of every channel, by the name of its column; the period where it is known."""
        values: dict[str, NDArray[Any]] = {"t": self.time}
        for names, rows in ((LENGTH_CHANNELS, self.lengths), (FORCE_CHANNELS, self.forces)):
            values |= dict(zip(names, rows.T, strict=True))
        return values if self.period is None else values | {"period": self.period}

    @property
    def gapless(self) -> bool:
        """True when the rows follow each other on a uniform grid."""
        return not self.stamped and not self.lost

    @property
    def places(self) -> NDArray[np.intp]:
        """(T,), steps from the first row to each, rounded."""
        if self.gapless:
            return np.arange(len(self))
        return np.rint((self.time - self.time[0]) / self.step).astype(np.intp)

    def __len__(self) -> int:
        """Return the number of rows T."""
        return len(self.time)
