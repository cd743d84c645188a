"""The second harmonic of `cogging`, whose pitch it takes: two periods in every pitch."""

from __future__ import annotations

from expdesign.mechanism.term import Columns, Instant, Term
from expdesign.mechanism.terms import cogging


def _columns(instant: Instant) -> Columns:
    return cogging.columns_of(instant, 2)


TERM = Term(
    name="cogging_second",
    place=140,
    meaning="second harmonic of the cogging, with half its period",
    parameters=cogging.parameters_of("d", "second"),
    columns=_columns,
    beside=cogging.TERM.name,
)
