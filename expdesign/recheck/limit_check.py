"""The worst moment of every limit of a motion: what was found, what is proved, what it says."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from constraints import limit_definitions
from expdesign.runfolder import OpenNumber, described

TOLERANCE = 1e-6
"""Largest excess over a bound, as a share of the limit's range, that counts as kept."""


@dataclass(frozen=True)
class LimitCheck:
    """The worst moment of one limit: a row of ``tables/limits.csv``.

    `row` is empty for a limit of a single row. `value` may be NaN, where it could not be computed;
    such a limit is not kept.
    """

    key: Annotated[str, described("", "key of the limit in the YAML", name="limit")]
    title: Annotated[str, described("", "the limit in words")]
    row: Annotated[
        str, described("", "component, strut or pair of struts that comes closest to the bound")
    ]
    unit: Annotated[str, described("", "unit of value and bound")]
    value: Annotated[
        OpenNumber, described("see unit", "worst value over the whole period, unsmoothed model")
    ]
    bound: Annotated[OpenNumber, described("see unit", "bound that it comes closest to")]
    violation: Annotated[
        OpenNumber,
        described(
            "1",
            "excess over the bound as a share of the limit's range (max - min; |bound| of a "
            "one-sided limit); negative: what is left",
        ),
    ]
    time: Annotated[OpenNumber, described("s", "when, from the start of the period")]
    origin: Annotated[str, described("", "where the bound was given")]
    proved: Annotated[
        OpenNumber,
        described("1", "the same of every instant: proved to be no more; empty: only sampled"),
    ] = np.nan
    cells: Annotated[int, described("1", "cells of time that it was proved over")] = 0
    open_time: Annotated[
        OpenNumber, described("s", "how much of the motion is in cells that were left open")
    ] = 0.0
    stated: Annotated[
        OpenNumber,
        described("see unit", "the bound as it is stated: it is drawn in by the reserve"),
    ] = np.nan
    reserve: Annotated[
        float, described("1", "share of the stated range that is kept free (limits.reserve)")
    ] = 0.0

    @property
    def certified(self) -> bool:
        """Whether the limit is proved to be kept at every instant, within `TOLERANCE`."""
        return bool(self.proved <= TOLERANCE)

    @property
    def possible(self) -> float:
        """Largest excess that there may be: what is proved; where nothing is, what was found."""
        return float(np.fmax(self.proved, self.violation))

    @property
    def kept(self) -> bool:
        """Whether the limit is kept, within `TOLERANCE` of its range."""
        return bool(self.violation <= TOLERANCE)

    @property
    def used(self) -> float:
        """How much of the limit is used: 1 at the bound; see `LimitDefinition.share_used`."""
        definition = limit_definitions().get(self.key)
        if definition is None:
            return 1 + self.violation
        return definition.share_used(self.value, self.bound, self.violation)

    @property
    def strut(self) -> int | None:
        """Number of the strut, from 1; None for a row that is not one strut's."""
        word, _, number = self.row.partition(" ")
        return int(number) if word == "strut" else None

    def __str__(self) -> str:
        """Return it in words: what is how large, when, and which bound it comes closest to."""
        row = f" of {self.row}" if self.row else ""
        return (
            f"{self.title}{row} is {self.value:.6g} {self.unit} at {self.time:.4f} s, the bound "
            f"{self.bound:.6g} {self.unit}"
        )


def worst_of_each(checks: Iterable[LimitCheck]) -> tuple[LimitCheck, ...]:
    """Return the worst check of every limit, of parts of a motion that were judged apart.

    What is proved, and what it took, is that of all parts.
    """
    worst: dict[str, LimitCheck] = {}
    for check in checks:
        known = worst.get(check.key)
        if known is None:
            worst[check.key] = check
            continue
        worst[check.key] = replace(
            max(known, check, key=lambda one: one.violation),
            proved=float(np.maximum(known.proved, check.proved)),
            cells=known.cells + check.cells,
            open_time=known.open_time + check.open_time,
        )
    return tuple(worst.values())


@dataclass(frozen=True)
class Recheck:
    """All limits of one motion, at every instant of it."""

    limits: tuple[LimitCheck, ...]
    span: str = "one period"
    """What was looked at, in words."""

    @property
    def worst(self) -> float:
        """Largest violation as a share of its limit's range; −inf without limits."""
        return max((check.violation for check in self.limits), default=-np.inf)

    @property
    def possible(self) -> float:
        """Largest excess over a limit that there may be, as a share of its range."""
        return max((check.possible for check in self.limits), default=-np.inf)

    @property
    def passed(self) -> bool:
        """True when no limit was found broken by more than `TOLERANCE` of its range."""
        return self.worst <= TOLERANCE

    @property
    def certified(self) -> bool:
        """True when every limit is proved to be kept at every instant, within `TOLERANCE`."""
        return all(check.certified for check in self.limits)

    @property
    def method(self) -> str:
        """How the limits were checked, in words."""
        cells = max((check.cells for check in self.limits), default=0)
        said = f"unsmoothed model enclosed over up to {cells} cells of time of {self.span}"
        left = max((check.open_time for check in self.limits), default=0.0)
        if self.certified or not self.passed:
            return f"{said}: holds for every instant"
        return f"{said}: not proved for every instant, {left:.3g} s stayed open"
