"""A limit with its bounds: what one robot or one run asks of a quantity."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from constraints.definition import LimitDefinition


@dataclass(frozen=True, eq=False)
class Limit:
    """Bounds on the rows of one `LimitDefinition`: from the configuration to the report."""

    definition: LimitDefinition
    lower: Array
    upper: Array
    """(k,) Bounds on the natural expression, SI; ±inf where a row is not bounded on that side."""
    labels: tuple[str, ...]
    """What each row stands for: ``"x"``, ``"strut 3"``, ``"struts 1-4"`` or ``""``."""
    origin: str
    """Where the bounds were given, e.g. ``"palida.yaml: limits.strut_speed"``."""
    file: Path | None = None
    line: int | None = None
    """That file and the line there; None for a mapping."""

    @property
    def key(self) -> str:
        """The limit's name."""
        return self.definition.key

    @property
    def unit(self) -> str:
        """SI unit of bounds and quantity."""
        return self.definition.unit

    @property
    def range(self) -> Array:
        """(k,) Width of the admitted range; |bound| where only one side is bounded.

        Violations are judged relative to it. A bound of zero on one side has the range 1.
        """
        both = np.isfinite(self.lower) & np.isfinite(self.upper)
        with np.errstate(invalid="ignore"):
            width = self.upper - self.lower
        one = np.where(np.isfinite(self.lower), np.abs(self.lower), np.abs(self.upper))
        one = np.where(np.isfinite(one) & (one > 0), one, 1.0)
        return np.where(both & (width > 0), width, one)

    def smooth_bounds(self, margin: Array | float = 0.0) -> tuple[Array, Array]:
        """Return lower and upper bounds on the rows in their smooth form.

        Parameters
        ----------
        margin : (k,) or float
            How far the natural bounds are drawn in first, as a share of `range`.
        """
        draw = np.asarray(margin) * self.range
        lower, upper = self.lower + draw, self.upper - draw
        transform = self.definition.transform
        if self.definition.decreasing:
            return _finite(transform, upper, -np.inf), _finite(transform, lower, np.inf)
        return _finite(transform, lower, -np.inf), _finite(transform, upper, np.inf)

    def violation(self, values: Array) -> Array:
        """Return how far values (…, k) break the bounds, as a share of `range`; ≤ 0 is kept."""
        return np.maximum(self.lower - values, values - self.upper) / self.range

    def violation_of(self, row: int, value: float) -> float:
        """Return how far one row's value breaks its bounds, as a share of its range."""
        return float(max(self.lower[row] - value, value - self.upper[row]) / self.range[row])

    def nearest_bound(self, row: int, value: float) -> float:
        """Return the bound of a row that a value breaks most, or comes closest to."""
        below, above = self.lower[row] - value, value - self.upper[row]
        return float(self.lower[row] if below > above else self.upper[row])


def _finite(transform: Callable[[Array], Array], bound: Array, absent: float) -> Array:
    given = np.isfinite(bound)
    return np.where(given, transform(np.where(given, bound, 1.0)), absent)
