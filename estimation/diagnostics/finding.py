"""Assumptions of an estimate, findings of their tests, and the verdict on all findings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from expdesign.runfolder import described


class FindingOutcome(StrEnum):
    """Outcome of the test of an assumption."""

    HOLDS = "holds"
    NEGLIGIBLE = "violated, negligibly"
    """The test rejects it, but by so little that nothing of the estimate changes."""
    FAILS = "fails"
    NOT_TESTED = "not tested"


@dataclass(frozen=True)
class Finding:
    """Result of the test of one assumption, in words and numbers."""

    assumption: Annotated[str, described("", "the assumption")]
    outcome: Annotated[
        FindingOutcome, described("", "holds; violated, negligibly; fails; not tested")
    ]
    sentence: Annotated[str, described("", "observation in one sentence")]
    advice: Annotated[str, described("", "recommended action; empty when the assumption holds")] = (
        ""
    )
    serious: Annotated[
        bool, described("", "a failure makes the result doubtful: values or intervals are wrong")
    ] = True
    contradiction: Annotated[
        str, described("", "statement that contradicts it; empty unless it fails")
    ] = ""
    p: Annotated[
        float | None,
        described("1", "smallest p of the tests, corrected for their number; null: not tested"),
    ] = None
    level: Annotated[
        float | None, described("1", "level of these tests together; null: not tested")
    ] = None
    first: Annotated[
        bool,
        described("", "first cause: correct it and repeat; other failures may be consequences"),
    ] = False

    @property
    def failed(self) -> bool:
        """Whether the assumption fails."""
        return self.outcome is FindingOutcome.FAILS

    def name_part(self, part: str) -> Finding:
        """Return the finding with a part of the data, ``experiment 2``, named in its sentences."""
        prefix = f"{part}: "
        contradiction = self.contradiction and prefix + self.contradiction
        return replace(self, sentence=prefix + self.sentence, contradiction=contradiction)

    def name_experiment(self, number: int, experiments: int) -> Finding:
        """Return the finding with the number of its experiment, if there are several."""
        return self.name_part(f"experiment {number}") if experiments > 1 else self


@dataclass(frozen=True)
class Assumption:
    """Assumption, the statement that contradicts it, and the advice if it fails."""

    text: str
    contradiction: str
    advice: str
    serious: bool = True

    def skip(self, reason: str, advice: str = "") -> Finding:
        """Return the finding of an assumption without a test, and the reason."""
        return Finding(self.text, FindingOutcome.NOT_TESTED, reason, advice, self.serious)

    def holds(self, sentence: str, p: float, level: float) -> Finding:
        """Return the finding of a test that rejects the assumption negligibly, or not at all."""
        outcome = FindingOutcome.NEGLIGIBLE if p < level else FindingOutcome.HOLDS
        return Finding(self.text, outcome, sentence, serious=self.serious, p=p, level=level)

    def fails(
        self,
        sentence: str,
        p: float | None = None,
        level: float | None = None,
        where: str = "",
        advice: str = "",
    ) -> Finding:
        """Return the finding of a failure at a place; without p it was seen without a test."""
        contradiction = f"{self.contradiction} ({where})" if where else self.contradiction
        advice = advice or self.advice
        return Finding(
            self.text, FindingOutcome.FAILS, sentence, advice, self.serious, contradiction, p, level
        )

    def decide(self, where: str, absent: str, present: str, p: float, level: float) -> Finding:
        """Return the finding of a test: it rejects the assumption if it names a place."""
        if where:
            return self.fails(present, p, level, where)
        return self.holds(absent, p, level)


class Status(StrEnum):
    """Overall status of an estimate or a prediction."""

    ACCEPTED = "accepted"
    DOUBTFUL = "doubtful"


@dataclass(frozen=True)
class DiagnosisVerdict:
    """Verdict of a diagnosis, with all its findings."""

    status: Annotated[Status, described("", "accepted or doubtful")]
    summary: Annotated[str, described("", "summary in one sentence")]
    findings: Annotated[tuple[Finding, ...], described("", "findings, one per assumption")]

    @property
    def failed(self) -> tuple[Finding, ...]:
        """Findings that fail."""
        return tuple(finding for finding in self.findings if finding.failed)

    @property
    def causes(self) -> tuple[Finding, ...]:
        """First cause, or the two that are needed together; empty for an accepted estimate."""
        return tuple(finding for finding in self.findings if finding.first)


def name_channels(kind: str, flags: NDArray[np.bool_]) -> str:
    """Name the channels with these flags, (6,); empty if there are none.

    Examples
    --------
    >>> name_channels("strut", np.arange(6) == 2), name_channels("strut", np.arange(6) > 3)
    ('strut 3', 'struts 5 and 6')
    """
    numbers = [str(j + 1) for j in np.flatnonzero(flags)]
    return f"{kind}{'s' * (len(numbers) > 1)} {join_words(numbers)}" if numbers else ""


def join_words(words: Iterable[str]) -> str:
    """Join the words that are not empty.

    Examples
    --------
    >>> join_words(["a", "", "b", "c"])
    'a, b and c'
    """
    *first, last = [word for word in words if word] or [""]
    return f"{', '.join(first)} and {last}" if first else last
