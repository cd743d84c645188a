"""What a limit is: data that says which quantity is bounded, how, and in which unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

Quantities = Mapping[str, ca.SX]
"""Named symbolic quantities of one instant; the mechanism says what it offers and their shapes."""

BoundKind = Literal["interval", "symmetric", "upper", "lower"]


def _identity(bound: NDArray[np.float64]) -> NDArray[np.float64]:
    return bound


@dataclass(frozen=True)
class LimitDefinition:
    """A kind of limit: what is bounded and how the user states the bound."""

    key: str
    """Key under ``limits:`` in the YAML, and the limit's name in every report."""
    title: str
    """The limit in words, for figures and messages."""
    unit: str
    """SI unit of bound and quantity (``"m"``, ``"rad"``, ``"N"``, ``"1"`` …)."""
    kind: BoundKind
    """``interval``: the user gives ``[min, max]``; ``symmetric``: one value b, −b ≤ q ≤ b;
    ``upper``: q ≤ b; ``lower``: b ≤ q."""
    natural: Callable[[Quantities], ca.SX]
    """Quantities → column of rows in `unit`, as the user reads it. Reports and rechecks use it."""
    requires: tuple[str, ...]
    """Names of the quantities that are read; a mechanism that does not offer them refuses the
    limit."""
    components: tuple[str, ...] = ()
    """Names of the rows when the user bounds them by name (``("x", "y", "z")``), else empty."""
    per_actuator: bool = False
    """True when there is one row per actuator, whose bounds may then differ."""
    pairs: bool = False
    """True when a row stands for a pair of actuators, in the order of
    ``itertools.combinations``; pairs that share a joint are then left out."""
    smooth: Callable[[Quantities], ca.SX] | None = None
    """Quantities → column of the same rows in an equivalent form that an optimiser can
    differentiate (tan α for α). None: `natural` is smooth."""
    transform: Callable[[NDArray[np.float64]], NDArray[np.float64]] = field(default=_identity)
    """Maps bounds on `natural` to bounds on `smooth`; strictly monotone."""
    decreasing: bool = False
    """True when `transform` is decreasing (tilt → cosine), so that the bounds swap."""
    conservative: bool = False
    """True when `smooth` is an inner approximation: it never admits what `natural` forbids, and
    may forbid a little more."""

    def rows(self, quantities: Quantities) -> ca.SX:
        """Return the rows in the form that an optimiser can differentiate."""
        return ca.densify((self.smooth or self.natural)(quantities))

    def share_used(self, value: float, bound: float, violation: float) -> float:
        """Return how much of a limit is used: 1 at the bound, more beyond it.

        Of a limit with two sides it is counted from the middle of the range (for ±b that is
        |value| / b), of an upper bound it is value / bound, of a lower bound bound / value.

        Parameters
        ----------
        value, bound : float
            The row's value, and the bound that it comes closest to.
        violation : float
            Excess over that bound as a share of the row's range.
        """
        if self.kind in ("interval", "symmetric"):
            return 1 + 2 * violation
        if self.kind == "lower" and bound > 0 and value > 0:
            return bound / value
        return 1 + violation


def plain_limit(key: str, title: str, unit: str, kind: BoundKind) -> LimitDefinition:
    """Return the limit, actuator by actuator, on the quantity of the same name."""
    return LimitDefinition(
        key=key,
        title=title,
        unit=unit,
        kind=kind,
        natural=lambda quantities: quantities[key],
        requires=(key,),
        per_actuator=True,
    )
