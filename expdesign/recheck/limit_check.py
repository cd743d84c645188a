"""A judged limit: its worst moment along a motion, the one form that is made, written and shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

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
