"""The axes of a controller: their units, order, signs and zeros."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from expdesign.configuration import Space
from expdesign.export.rotation import from_roll_pitch_yaw, roll_pitch_yaw
from expdesign.export.rows import Rows

LENGTH_UNITS = {"m": 1.0, "mm": 1e3, "um": 1e6, "in": 1 / 0.0254}
ANGLE_UNITS = {"rad": 1.0, "deg": 180 / np.pi}


@dataclass(frozen=True, eq=False)
class Axes:
    """Six axes of a controller.

    position of axis k = sign · (coordinate − zero) · scale, of the coordinate that it moves.

    Attributes
    ----------
    space : {"strut", "pose"}
    names, units : (6,) tuples of str
    source : (6,)
        Index of the strut, or of the pose's coordinate, that each axis moves.
    factor : (6,)
        Units of the axis for 1 m or 1 rad of its coordinate, with the sign.
    zero : (6,)
        Coordinate at which the axis reads zero, m or rad.
    fixed : bool
        Whether the rotations are roll, pitch and yaw about fixed axes; such a table holds
        positions only.
    """

    space: Space
    names: tuple[str, ...]
    units: tuple[str, ...]
    source: NDArray[np.intp]
    factor: Array
    zero: Array
    fixed: bool = False

    def rows(
        self,
        times: Array,
        coordinates: Array,
        rates: Array | None = None,
        accelerations: Array | None = None,
    ) -> Rows:
        """Return what the axes do for coordinates (N, 6) and their derivatives, SI."""
        if self.fixed:
            rates = accelerations = None
            angles = roll_pitch_yaw(coordinates[:, 3:])
            coordinates = np.concatenate([coordinates[:, :3], angles], axis=1)
        return Rows(
            times,
            (coordinates - self.zero)[:, self.source] * self.factor,
            None if rates is None else rates[:, self.source] * self.factor,
            None if accelerations is None else accelerations[:, self.source] * self.factor,
        )

    def coordinates(self, position: Array) -> Array:
        """Return the coordinates (N, 6), SI, of the axes' positions."""
        values = self.derivatives(position) + self.zero
        if self.fixed:
            values[:, 3:] = from_roll_pitch_yaw(values[:, 3:])
        return values

    def derivatives(self, values: Array) -> Array:
        """Return the coordinates' derivatives (N, 6), SI, of those of the axes."""
        found = np.empty_like(values)
        found[:, self.source] = values / self.factor
        return found
