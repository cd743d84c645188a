"""The best finished motions so far, of different descent: hops set out from each in turn."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from expdesign.solver.finish import Finished
from expdesign.solver.start import StartResult

CAPACITY = 3
"""Motions that are kept. From a single one a hundred hops were seen to gain 0.04 in log det F."""


@dataclass(frozen=True)
class Candidate:
    """A finished motion, what it is worth, and where it came from.

    Attributes
    ----------
    merit : float
        The judged criterion, larger is better.
    lineage : int
        Index of the random start that it descends from.
    """

    merit: float
    finished: Finished
    start: StartResult
    lineage: int

    @property
    def rank(self) -> tuple[bool, float]:
        """Larger is better: what passed the recheck by merit, the rest by its worst limit."""
        passed = self.finished.check.passed
        return passed, self.merit if passed else -self.finished.check.worst


@dataclass(frozen=True)
class Population:
    """At most `CAPACITY` candidates, the best first, one of each lineage."""

    members: tuple[Candidate, ...]

    @property
    def best(self) -> Candidate:
        """The best member."""
        return self.members[0]

    @property
    def least(self) -> Candidate | None:
        """The member that a new lineage must be as good as; None while there is room."""
        passed = [member for member in self.members if member.finished.check.passed]
        return passed[-1] if len(passed) == CAPACITY else None

    def origin(self, turn: int) -> Candidate:
        """Return the member whose turn it is, counted from 0."""
        return self.members[turn % len(self.members)]

    @classmethod
    def of(cls, candidates: Iterable[Candidate]) -> Population:
        """Return the best of them, which must be of different lineages."""
        ranked = sorted(candidates, key=lambda candidate: candidate.rank, reverse=True)
        return cls(tuple(ranked[:CAPACITY]))

    def admit(self, candidate: Candidate) -> Population:
        """Return the population with a candidate, if it is good enough.

        It takes the place of its ancestor if it is better. Of a new lineage it joins, and the
        worst leaves if there are too many.
        """
        others = [member for member in self.members if member.lineage != candidate.lineage]
        same = [member for member in self.members if member.lineage == candidate.lineage]
        if same and same[0].rank >= candidate.rank:
            return self
        return Population.of([*others, candidate])
