"""What a search reports while it runs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchEvent:
    """One iteration, or the end, of one start.

    Attributes
    ----------
    start : int
        Number of the start, from 1; hops go on counting.
    phase : str
        ``"blunt"``, ``"sharp"``, ``"hop"``, then ``"done"``; for some ``"finish"``, then
        ``"finished"``.
    iteration : int
        Iterations of this start so far.
    objective : float
        The criterion in the units in which it is reported (log det F for ``d``): smoothed, and
        that of the unsmoothed model when it is done or finished.
    violation : float
        Largest violation of the limits in the NLP, as a share of their range.
    seconds : float
        Since this start began.
    status : str
        Empty while it runs; then how it ended.
    """

    start: int
    phase: str
    iteration: int
    objective: float
    violation: float
    seconds: float
    status: str = ""
