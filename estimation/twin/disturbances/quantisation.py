"""The resolution of encoders and converters."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array


def quantised(values: Array, step: float) -> Array:
    """Return the values rounded to multiples of `step`; as they are where it is 0."""
    return np.round(values / step) * step if step > 0 else values
