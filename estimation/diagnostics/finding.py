"""Assumptions of an estimate, what a test of one found, and the verdict on all of them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from expdesign.runfolder import described


class FindingOutcome(StrEnum):
    """What a test says of an assumption."""

    HOLDS = "holds"
    FAILS = "fails"
    NOT_TESTED = "not tested"


@dataclass(frozen=True)
class Finding:
    """What was found of one assumption."""

    assumption: Annotated[str, described("", "what is assumed")]
    outcome: Annotated[FindingOutcome, described("", "holds, fails or not tested")]
    sentence: Annotated[str, described("", "what was seen")]
    advice: Annotated[str, described("", "what to do next; empty when the assumption holds")] = ""
    serious: Annotated[
        bool, described("", "its failure makes the result doubtful: values or intervals are wrong")
    ] = True
    contradiction: Annotated[
        str, described("", "what is the case when the assumption fails; empty when it does not")
    ] = ""
    p: Annotated[
        float | None,
        described("1", "smallest p of the tests, corrected for their number; null: not tested"),
    ] = None
    level: Annotated[
        float | None, described("1", "level of these tests together; null: not tested")
    ] = None

    @property
    def failed(self) -> bool:
        """Whether the assumption fails."""
        return self.outcome is FindingOutcome.FAILS

    def of_experiment(self, number: int) -> Finding:
        """Return the finding with the number of its experiment in its words."""
        prefix = f"experiment {number}: "
        contradiction = self.contradiction and prefix + self.contradiction
        return replace(self, sentence=prefix + self.sentence, contradiction=contradiction)


@dataclass(frozen=True)
class Assumption:
    """What is assumed, what is the case when it fails, and what to do then."""

    text: str
    contradiction: str
    advice: str
    serious: bool = True

    def skip(self, reason: str, advice: str = "") -> Finding:
        """Say why there is no test."""
        return Finding(self.text, FindingOutcome.NOT_TESTED, reason, advice, self.serious)

    def report_failure(self, sentence: str) -> Finding:
        """Say that it was seen to fail where no test of its own asks."""
        return Finding(
            self.text, FindingOutcome.FAILS, sentence, self.advice, self.serious, self.contradiction
        )

    def holds(self, sentence: str, p: float, level: float) -> Finding:
        """Say that the test found nothing."""
        return Finding(
            self.text, FindingOutcome.HOLDS, sentence, serious=self.serious, p=p, level=level
        )

    def fails(
        self, sentence: str, p: float, level: float, where: str = "", advice: str = ""
    ) -> Finding:
        """Say that the test rejects the assumption, and where; with other advice than usual."""
        contradiction = f"{self.contradiction} ({where})" if where else self.contradiction
        advice = advice or self.advice
        return Finding(
            self.text, FindingOutcome.FAILS, sentence, advice, self.serious, contradiction, p, level
        )

    def decide(self, where: str, absent: str, present: str, p: float, level: float) -> Finding:
        """Say what the test found: where it rejects the assumption, or nothing."""
        if where:
            return self.fails(present, p, level, where)
        return self.holds(absent, p, level)


class Status(StrEnum):
    """Of an estimate or a prediction as a whole."""

    ACCEPTED = "accepted"
    DOUBTFUL = "doubtful"


@dataclass(frozen=True)
class DiagnosisVerdict:
    """All findings, and what follows."""

    status: Annotated[Status, described("", "accepted or doubtful")]
    summary: Annotated[str, described("", "one sentence")]
    findings: Annotated[tuple[Finding, ...], described("", "of every assumption")]

    @property
    def failed(self) -> tuple[Finding, ...]:
        """Findings that fail."""
        return tuple(finding for finding in self.findings if finding.failed)


def name_channels(kind: str, flags: NDArray[np.bool_]) -> str:
    """Return ``"struts 3 and 4"`` for the channels with these flags, (6,); empty for none."""
    numbers = [str(j + 1) for j in np.flatnonzero(flags)]
    return f"{kind}{'s' * (len(numbers) > 1)} {join_words(numbers)}" if numbers else ""


def join_words(words: Iterable[str]) -> str:
    """Return ``"a, b and c"`` of the words that are not empty."""
    *first, last = [word for word in words if word] or [""]
    return f"{', '.join(first)} and {last}" if first else last
