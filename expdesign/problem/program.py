"""Limits along a motion as rows of a nonlinear program, whatever the motion's variables are."""

from __future__ import annotations

from typing import Any, Protocol, Self

import numpy as np
from scipy.ndimage import maximum_filter1d

from constraints.arrays import Array, Mask
from expdesign.robot import LimitModel


class Path(Protocol):
    """How a motion follows from its variables; `points` say where on it one looks."""

    def states(self, variables: Array, points: Any) -> Array:
        """Return the states (K, 18), or (K, 24) with the pose's third derivative, at points."""

    def to_variables(self, variables: Array, points: Any, sensitivities: Array) -> Array:
        """Carry derivatives (K, r, 18 or 24) to the states over to the variables: (K, r, z)."""


class LimitedProgram:
    """The rows and bounds of `expdesign.solver.ipopt.NonlinearProgram`; who inherits adds a cost.

    Parameters
    ----------
    points
        K points of the path.
    mask : (K, R) of bool
        Which limit holds at which point: the rows that the program contains.
    width : float
        Smoothing of dry friction, m/s.
    bounds : ((z,), (z,))
        Of the variables.
    margins : (K, R), optional
        How far the natural bounds are drawn in, as shares of their ranges.
    """

    def __init__(
        self,
        limits: LimitModel,
        path: Path,
        points: Any,
        mask: Mask,
        width: float,
        bounds: tuple[Array, Array],
        margins: Array | None = None,
    ) -> None:
        self._limits, self._path, self._points, self._mask = limits, path, points, mask
        self._width = width
        self._scale = np.broadcast_to(limits.scale, mask.shape)[mask]
        self.row_lower, self.row_upper = (
            np.broadcast_to(side, mask.shape)[mask] / self._scale
            for side in limits.smooth_bounds(margins)
        )
        self.lower, self.upper = bounds

    def within(self, center: Array, radius: float | None) -> Self:
        """Confine the variables to a box about a point; None leaves them free."""
        if radius is not None:
            self.lower = np.maximum(self.lower, center - radius)
            self.upper = np.minimum(self.upper, center + radius)
        return self

    def rows(self, x: Array) -> Array:
        """Return the scaled limit rows."""
        states = self._path.states(x, self._points)
        return self._limits.smooth_values(states, self._width)[self._mask] / self._scale

    def rows_jacobian(self, x: Array) -> tuple[Array, Array]:
        """Return the scaled limit rows and their Jacobian."""
        states = self._path.states(x, self._points)
        values, slopes = self._limits.smooth_slopes(states, self._width)
        dense = self._path.to_variables(x, self._points, slopes)[self._mask]
        return values[self._mask] / self._scale, dense / self._scale[:, None]

    def excess(self, x: Array) -> float:
        """Return how far the rows are broken at most, in the program's own scaling."""
        values = self.rows(x)
        beyond = np.maximum(self.row_lower - values, values - self.row_upper)
        worst = float(np.max(beyond, initial=0.0))
        return worst if np.isfinite(worst) else np.inf


def hidden_by_smoothing(
    limits: LimitModel, states: Array, width: float, reach: int, *, periodic: bool
) -> tuple[Array, Array]:
    """Return the unsmoothed violations, and how far the smoothed ones are below them, (N, R) each.

    The latter is the largest within `reach` states to either side: that covers the jumps of dry
    friction where a sign changes. It is zero for rows that are bounded on one side only.
    """
    exact = limits.violations(states)
    smooth = limits.smooth_violations(states, width)
    comparable = limits.two_sided & np.isfinite(exact) & np.isfinite(smooth)
    excess = np.subtract(exact, smooth, out=np.zeros_like(exact), where=comparable)
    mode = "wrap" if periodic else "nearest"
    hidden = maximum_filter1d(np.maximum(excess, 0.0), 2 * reach + 1, axis=0, mode=mode)
    return exact, hidden
