"""Which limits a motion reaches at which instant."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array, Mask
from expdesign.robot import LimitModel

REACHED = 0.99
"""Share of a limit that is used from which on it counts as one that is reached."""


def reached(model: LimitModel, values: Array) -> Mask:
    """Return which rows of limits are reached at which instant, (N, R).

    Parameters
    ----------
    model : LimitModel
    values : (N, R)
        As of `LimitModel.values`. One that is not a number is beyond its limit.
    """
    excess, found = model.excess(values), np.zeros(values.shape, dtype=bool)
    for limit, columns in zip(model.limits, model.columns, strict=True):
        own = values[:, columns]
        below, above = limit.lower - own, own - limit.upper
        bounds = np.where(below > above, limit.lower, limit.upper)
        with np.errstate(invalid="ignore"):
            used = limit.definition.shares_used(own, bounds, excess[:, columns])
        found[:, columns] = ~(used < REACHED) & ~limit.open_rows
    return found
