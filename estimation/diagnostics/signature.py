"""What an effect adds to measured forces and lengths: columns that a regression can take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics.linearisation import Linearisation


@dataclass(frozen=True, eq=False)
class Signature:
    """Columns of q effects, per unit of each."""

    forces: Array
    """(R, 6, q), N."""
    lengths: Array
    """(R', 6, q), m; R' = 0 after pointwise kinematics."""

    @classmethod
    def of_forces(cls, part: Linearisation, columns: Array) -> Self:
        """Take effects, (R, 6, q), that move no length."""
        rows = len(part.length_counts)
        return cls(columns, np.zeros((rows, *columns.shape[1:])))

    @classmethod
    def joined(cls, parts: Sequence[Signature]) -> Self:
        """Put effects side by side; at least one part."""
        return cls(
            np.concatenate([part.forces for part in parts], axis=2),
            np.concatenate([part.lengths for part in parts], axis=2),
        )

    @property
    def count(self) -> int:
        """How many effects, q."""
        return self.forces.shape[2]

    def picked(self, places: Sequence[int] | NDArray[np.intp]) -> Signature:
        """Return the effects at these places."""
        chosen = np.asarray(places, dtype=np.intp)
        return Signature(self.forces[:, :, chosen], self.lengths[:, :, chosen])
