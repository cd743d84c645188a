"""How controllers move between the rows of a table."""

from __future__ import annotations

from enum import Enum

import numpy as np
from scipy.interpolate import PPoly

from constraints.arrays import Array
from expdesign.export.rows import Rows


class Interpolation(Enum):
    """The path between two rows; its value is the word for it."""

    LINEAR = "straight lines between the rows"
    CUBIC = "cubic Hermite polynomials of position and velocity"
    QUINTIC = "quintic Hermite polynomials of position, velocity and acceleration"


def interpolated(kind: Interpolation, rows: Rows) -> PPoly:
    """Return the path of the axes as a piecewise polynomial in time.

    Parameters
    ----------
    kind : Interpolation
    rows : Rows
        With the velocities that a cubic path needs, and the accelerations of a quintic one.

    Returns
    -------
    scipy.interpolate.PPoly
        (N,) times → (N, 6) in the axes' units.
    """
    h = np.diff(rows.times)[:, None]
    p0, p1 = rows.position[:-1], rows.position[1:]
    if kind is Interpolation.LINEAR:
        return PPoly(np.stack([(p1 - p0) / h, p0]), rows.times)
    if rows.rate is None:
        raise ValueError("a Hermite path needs velocities")
    v0, v1 = rows.rate[:-1], rows.rate[1:]
    if kind is Interpolation.CUBIC:
        slope = (p1 - p0) / h
        third = (v0 + v1 - 2 * slope) / h**2
        second = (3 * slope - 2 * v0 - v1) / h
        return PPoly(np.stack([third, second, v0, p0]), rows.times)
    if rows.acceleration is None:
        raise ValueError("a quintic path needs accelerations")
    a0, a1 = rows.acceleration[:-1], rows.acceleration[1:]
    # What a parabola from the first row leaves over at the second one.
    position = p1 - p0 - v0 * h - a0 * h**2 / 2
    rate = v1 - v0 - a0 * h
    acceleration = a1 - a0
    cubic = (10 * position - 4 * rate * h + acceleration * h**2 / 2) / h**3
    quartic = (-15 * position + 7 * rate * h - acceleration * h**2) / h**4
    quintic = (6 * position - 3 * rate * h + acceleration * h**2 / 2) / h**5
    return PPoly(np.stack([quintic, quartic, cubic, a0 / 2, v0, p0]), rows.times)


def refined(times: Array, points: int) -> Array:
    """Return a grid with this many points to a step, the steps' beginnings and the end in it."""
    shares = np.arange(points) / points
    inner = times[:-1, None] + np.diff(times)[:, None] * shares
    return np.append(inner.ravel(), times[-1])


def differences(times: Array, values: Array) -> tuple[Array, Array]:
    """Return first and second derivatives at the rows from differences, at rest at both ends.

    Parameters
    ----------
    times : (N,)
        s, increasing.
    values : (N, 6)
    """
    h = np.diff(times)[:, None]
    slopes = np.diff(values, axis=0) / h
    first, second = np.zeros_like(values), np.zeros_like(values)
    both = h[1:] + h[:-1]
    first[1:-1] = (slopes[:-1] * h[1:] + slopes[1:] * h[:-1]) / both
    second[1:-1] = 2 * np.diff(slopes, axis=0) / both
    return first, second
