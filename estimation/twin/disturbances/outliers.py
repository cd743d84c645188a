"""Gross errors: rare samples of a channel that are far off."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from expdesign.schema.experiment import Outliers

Array = NDArray[np.float64]

STRUTS = 6


def gross_errors(outliers: Outliers, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the gross errors of lengths (m) and forces (N), (count, 6) each; mostly zeros.

    Every sample of every channel is hit with the probability `share`, independently of the
    others, and is then off by the size given, up or down with the same probability.
    """
    uniform = rng.random((count, 2 * STRUTS))
    up, down = uniform < outliers.share / 2, uniform >= 1 - outliers.share / 2
    signs = up.astype(float) - down
    return outliers.length * signs[:, :STRUTS], outliers.force * signs[:, STRUTS:]
