"""Curvature from differences of gradients: the damped BFGS update."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array

_DAMPED = 0.2
"""Share of the curvature along a step that an update leaves at least: Powell's."""


def updated(hessian: Array, step: Array, change: Array) -> Array:
    """Return a Hessian (z, z) that explains what a step has changed the gradient by, (z,) each.

    What is positive semidefinite stays so: where the change says otherwise it counts in part
    (Nocedal, Wright 2006, procedure 18.2). A step along which there is no curvature tells nothing.
    """
    along = hessian @ step
    expected, found = float(step @ along), float(step @ change)
    if not (np.isfinite(found) and expected > np.finfo(float).eps * float(step @ step)):
        return hessian
    if found < _DAMPED * expected:
        share = (1 - _DAMPED) * expected / (expected - found)
        change = share * change + (1 - share) * along
        found = _DAMPED * expected
    return (
        hessian
        + np.multiply.outer(change, change / found)
        - np.multiply.outer(along, along / expected)
    )
