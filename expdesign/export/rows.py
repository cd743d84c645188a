"""The rows of a controller table, in the controller's own coordinates and units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array

ON_THE_EDGE = 1e-9
"""s; how close to the measurement window's edge a row still belongs to it."""


class TableError(ValueError):
    """A controller table is not what its controller reads."""


@dataclass(frozen=True, eq=False)
class Rows:
    """What a table says at each of its times.

    Attributes
    ----------
    times : (N,)
        s from the start of the motion.
    position : (N, 6)
        In the units of the controller's axes.
    rate, acceleration : (N, 6) or None
        Per s and per s²; None when the table has none.
    record : dict of (N,)
        Further columns by name, SI, of tables that hold the whole motion.
    """

    times: Array
    position: Array
    rate: Array | None = None
    acceleration: Array | None = None
    record: Mapping[str, Array] = field(default_factory=dict)

    @property
    def velocities(self) -> Array:
        """The rates of a table that has to have them."""
        if self.rate is None:
            raise ValueError("the table needs velocities")
        return self.rate

    @property
    def accelerations(self) -> Array:
        """The accelerations of a table that has to have them."""
        if self.acceleration is None:
            raise ValueError("the table needs accelerations")
        return self.acceleration

    def checked(self) -> Rows:
        """Return the rows when they are complete, finite and in the order of time.

        Raises
        ------
        TableError
            Naming the first row that is not.
        """
        count = len(self.times)
        if count < 2:  # noqa: PLR2004 - a start and an end
            raise TableError(f"the table has {count} row(s)")
        columns = {
            "time": self.times[:, None],
            "position": self.position,
            "velocity": self.rate,
            "acceleration": self.acceleration,
            **{name: values[:, None] for name, values in self.record.items()},
        }
        for name, values in columns.items():
            if values is None:
                continue
            if len(values) != count:
                raise TableError(f"{name}: {len(values)} rows where there are {count} times")
            wrong = np.flatnonzero(~np.all(np.isfinite(values), axis=1))
            if wrong.size:
                raise TableError(f"row {wrong[0] + 1}: the {name} is not a finite number")
        late = np.flatnonzero(np.diff(self.times) <= 0)
        if late.size:
            raise TableError(f"row {late[0] + 2}: its time is not after that of the row before")
        return self


def in_window(times: Array, window: tuple[float, float]) -> NDArray[np.bool_]:
    """Tell which times are in the measurement window; its end is the first after it."""
    first, last = window
    return (times >= first - ON_THE_EDGE) & (times < last - ON_THE_EDGE)
