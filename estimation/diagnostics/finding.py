"""One assumption and what became of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class Outcome(Enum):
    """What became of an assumption."""

    HOLDS = "holds"
    FAILS = "fails"
    NOT_TESTED = "not tested"


@dataclass(frozen=True)
class Finding:
    """One assumption.

    Attributes
    ----------
    assumption : str
    outcome : Outcome
    sentence : str
        What was seen.
    advice : str
        What to do next; empty when the assumption holds.
    serious : bool
        Its failure makes the result doubtful: parameters or intervals are wrong.
    """

    assumption: str
    outcome: Outcome
    sentence: str
    advice: str = ""
    serious: bool = True
