"""Gross errors: rare samples of a channel that are far off."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import Outliers
from expdesign.mechanism.hexapod import ACTUATORS


def gross_errors(outliers: Outliers, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the gross errors of lengths (m) and forces (N), (count, 6) each; mostly zeros.

    Every sample of every channel is hit with the probability `share`, independently of the
    others, and is then off by the size given, up or down with the same probability.
    """
    uniform = rng.random((count, 2 * ACTUATORS))
    up, down = uniform < outliers.share / 2, uniform >= 1 - outliers.share / 2
    signs = up.astype(float) - down
    return outliers.length * signs[:, :ACTUATORS], outliers.force * signs[:, ACTUATORS:]
