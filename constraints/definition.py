"""Limits: their definitions, the catalogue of these, and the bounds of one robot or one run."""

from __future__ import annotations

import copyreg
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array, Mask
from constraints.plugins import declarations

Quantities = Mapping[str, ca.SX]
"""Named symbolic quantities of one instant; the mechanism says what it offers and their shapes."""

BoundKind = Literal["interval", "symmetric", "upper", "lower"]


def _by_none(limits: Mapping[str, Limit]) -> None:
    del limits


@dataclass(frozen=True, eq=False)
class LimitDefinition:
    """A kind of limit: what is bounded and how the user states the bound.

    It is the same only as itself, as functions are.
    """

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
    """Quantities → column of rows in `unit`, as the user reads it, or of what `numerical` makes
    them from. Reports and rechecks use it."""
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
    numerical: Callable[[Array], Array] | None = None
    """Values of `natural`, (N, k), → the rows that the user reads, (N, R), where no expression
    gives them: singular values. `smooth` is needed then. None: they are those of `natural`."""
    transform: Callable[[NDArray[np.float64]], NDArray[np.float64]] = np.positive
    """Maps bounds on `natural` to bounds on `smooth`; strictly monotone."""
    decreasing: bool = False
    """True when `transform` is decreasing (tilt → cosine), so that the bounds swap."""
    conservative: bool = False
    """True when `smooth` is an inner approximation: it never admits what `natural` forbids, and
    may forbid a little more."""
    about_home: float | None = None
    """Default bound on the distance of a component from home in both directions, in `unit`. The
    components are then coordinates of the pose, and ``none`` as a bound removes it. None: none."""
    standing: float | None = None
    """Default bound of a symmetric limit, in `unit`, that ``none`` does not remove. None: none."""
    widest: float | None = None
    """Largest size of a bound that may be given, in `unit`; None: any."""
    held_by: Callable[[Mapping[str, Limit]], str | None] = field(default=_by_none)
    """Limits by key → the key of one that holds the bound `standing` as well, or None: that has no
    rows of its own then, for optimiser and judge alike."""

    remedy: str = ""
    """What to do, in a sentence, where a home pose breaks it; empty: nothing of its own."""

    def __post_init__(self) -> None:
        """Refuse rows that no optimiser could see."""
        if self.numerical is not None and self.smooth is None:
            raise ValueError(f"limit '{self.key}': `numerical` needs `smooth` for the optimiser")

    def rows(self, quantities: Quantities) -> ca.SX:
        """Return the rows in the form that an optimiser can differentiate."""
        return ca.densify((self.smooth or self.natural)(quantities))

    def shares_used(self, values: Array, bounds: Array, violations: Array) -> Array:
        """Return how much of a limit is used: 1 at the bound, more beyond it.

        Of a limit with two sides it is counted from the middle of the range (for ±b that is
        |value| / b), of an upper bound it is value / bound, of a lower bound bound / value. The
        arguments are rows' values, the bounds that they come closest to, and the excess over those
        as a share of the row's range.
        """
        if self.kind in ("interval", "symmetric"):
            return 1 + 2 * violations
        if self.kind == "lower":
            both = (bounds > 0) & (values > 0)
            ratio = np.divide(bounds, values, out=np.ones(np.shape(values)), where=both)
            return np.where(both, ratio, 1 + violations)
        return 1 + violations


@cache
def plain_limit(key: str, title: str, unit: str, kind: BoundKind) -> LimitDefinition:
    """Return the limit, actuator by actuator, on the quantity of the same name; always the same."""
    return LimitDefinition(
        key=key,
        title=title,
        unit=unit,
        kind=kind,
        natural=lambda quantities: quantities[key],
        requires=(key,),
        per_actuator=True,
    )


@dataclass(frozen=True, eq=False)
class Limit:
    """Bounds on the rows of one `LimitDefinition`: from the configuration to the report."""

    definition: LimitDefinition
    lower: Array
    upper: Array
    """(k,) Bounds on the natural expression, SI, that motions are planned and judged with; ±inf
    where a row is not bounded on that side."""
    labels: tuple[str, ...]
    """What each row stands for: ``"x"``, ``"strut 3"``, ``"struts 1-4"`` or ``""``."""
    origin: str
    """Where the bounds were given, e.g. ``"palida.yaml: limits.strut_speed"``."""
    file: Path | None = None
    line: int | None = None
    """That file and the line there; None for a mapping."""
    by_default: tuple[str, ...] = ()
    """Labels of the rows without a stated bound: they have the default, `about_home` or
    `standing`."""
    reserve: float = 0.0
    """Share of the stated range that is kept free: `lower` and `upper` are drawn in by it."""
    before_reserve: tuple[Array, Array] | None = None
    """The bounds as they are stated; None: `lower` and `upper`."""

    @classmethod
    def boundless(cls, definition: LimitDefinition, labels: tuple[str, ...]) -> Limit:
        """Return the limit that bounds nothing: its rows can be evaluated, and none is broken."""
        endless = np.full(len(labels), np.inf)
        return cls(definition, -endless, endless, labels, "")

    def with_reserve(self, share: float) -> Limit:
        """Return the limit with a share, below 0.5, of its stated range kept free at every bound.

        Of a row with one bound the share is of the bound's size: of a bound of zero nothing.
        Without a reserve it is the limit as it is stated, to the last bit.
        """
        lower, upper = self.stated_bounds
        if share == 0:
            return replace(self, lower=lower, upper=upper, reserve=0.0, before_reserve=None)
        both = np.isfinite(lower) & np.isfinite(upper)
        width = np.subtract(upper, lower, out=np.zeros(lower.shape), where=both)
        drawn = []
        for bound, inwards in ((lower, 1.0), (upper, -1.0)):
            size = np.where(both, width, np.where(np.isfinite(bound), np.abs(bound), 0.0))
            side = np.asarray(bound + inwards * share * size)
            side.setflags(write=False)
            drawn.append(side)
        return replace(
            self, lower=drawn[0], upper=drawn[1], reserve=share, before_reserve=(lower, upper)
        )

    @property
    def key(self) -> str:
        """The limit's name."""
        return self.definition.key

    @property
    def stated_bounds(self) -> tuple[Array, Array]:
        """(k,) Lower and upper bounds as they are stated, without the reserve."""
        return self.before_reserve or (self.lower, self.upper)

    @property
    def unit(self) -> str:
        """SI unit of bounds and quantity."""
        return self.definition.unit

    @property
    def open_rows(self) -> Mask:
        """(k,) which rows are bounded on neither side."""
        return np.isinf(self.lower) & np.isinf(self.upper)

    @property
    def is_default(self) -> bool:
        """Whether the limit is a default, with no value given by the user."""
        return bool(self.by_default) and self.by_default == self.labels

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

        The natural bounds are drawn in first by the `margin`, (k,) or one, as a share of `range`.
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

    def nearest_bound(self, row: int, value: float, *, stated: bool = False) -> float:
        """Return the bound of a row that a value breaks most, or comes closest to.

        A `stated` one is without the reserve.
        """
        below, above = self.lower[row] - value, value - self.upper[row]
        bounds = self.stated_bounds if stated else (self.lower, self.upper)
        return float(bounds[0 if below > above else 1][row])


def _finite(transform: Callable[[Array], Array], bound: Array, absent: float) -> Array:
    given = np.isfinite(bound)
    return np.where(given, transform(np.where(given, bound, 1.0)), absent)


@cache
def limit_definitions() -> Mapping[str, LimitDefinition]:
    """Return every limit by its YAML key, in alphabetical order.

    A new limit is one file in ``constraints/limits`` or one module of a plug-in.
    """
    found: dict[str, LimitDefinition] = {}
    for definition in declarations(LimitDefinition, "constraints.limits"):
        if definition.key in found:
            raise ValueError(f"the limit '{definition.key}' is declared twice")
        found[definition.key] = definition
    return MappingProxyType(dict(sorted(found.items())))


def _by_key(key: str) -> LimitDefinition:
    return limit_definitions()[key]


def _reduce(definition: LimitDefinition) -> str | tuple[Any, ...]:
    if limit_definitions().get(definition.key) is definition:
        return _by_key, (definition.key,)
    stated = definition.key, definition.title, definition.unit, definition.kind
    if plain_limit(*stated) is definition:
        return plain_limit, stated
    return definition.__reduce_ex__(2)


# A worker process has the same files: a definition goes there by its name, since the functions
# that it holds may be lambdas.
copyreg.pickle(LimitDefinition, _reduce)
