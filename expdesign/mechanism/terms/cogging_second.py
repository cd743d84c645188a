"""The second harmonic of `cogging`, whose pitch it takes: two periods in every pitch."""

from __future__ import annotations

from expdesign.mechanism.term import Term
from expdesign.mechanism.terms import cogging

TERM = Term(
    name="cogging_second",
    meaning="the same with half the period, beside it",
    parameters=cogging.parameters_of("d", "second"),
    columns=lambda instant: cogging.columns_of(instant, 2),
    beside=cogging.TERM.name,
)
