"""How often something was seen in repeated runs, with the uncertainty of its probability."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from estimation.montecarlo.statistics import share_interval


@dataclass(frozen=True)
class Share:
    """How often something was seen.

    Attributes
    ----------
    hits, trials : int
    low, high : float
        95 % interval of the probability.
    """

    hits: int
    trials: int
    low: float
    high: float

    @classmethod
    def of(cls, outcomes: Sequence[bool]) -> Share:
        """Count."""
        hits, trials = sum(outcomes), len(outcomes)
        return cls(hits, trials, *share_interval(hits / trials, trials))
