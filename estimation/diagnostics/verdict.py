"""The diagnostics in words: which assumption holds, which fails, and what to do next."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from estimation.diagnostics.diagnosis import ExperimentDiagnosis
from estimation.diagnostics.finding import Finding, Outcome
from estimation.diagnostics.measurement_findings import (
    constant_finding,
    motion_findings,
    normal_finding,
    outliers_finding,
    white_finding,
)
from estimation.diagnostics.model_findings import (
    bias_finding,
    columns_finding,
    delay_finding,
    left_finding,
    noise_level_finding,
    position_periodic_finding,
)
from estimation.diagnostics.wording import listed
from expdesign.runfolder import described


class Status(StrEnum):
    """Of an estimate or a prediction as a whole."""

    ACCEPTED = "accepted"
    DOUBTFUL = "doubtful"


@dataclass(frozen=True)
class Verdict:
    """All findings, and what follows."""

    status: Annotated[Status, described("", "accepted or doubtful")]
    summary: Annotated[str, described("", "one sentence")]
    findings: Annotated[tuple[Finding, ...], described("", "of every assumption")]

    @property
    def failed(self) -> tuple[Finding, ...]:
        """Findings that fail."""
        return tuple(f for f in self.findings if f.outcome is Outcome.FAILS)


def verdict(experiments: Sequence[ExperimentDiagnosis]) -> Verdict:
    """Judge an estimate by the diagnostics of its experiments."""
    findings: list[Finding] = []
    for number, experiment in enumerate(experiments, 1):
        prefix = f"experiment {number}: " if len(experiments) > 1 else ""
        findings += [
            Finding(f.assumption, f.outcome, prefix + f.sentence, f.advice, f.serious)
            for f in _findings(experiment)
        ]
    serious = [f for f in findings if f.outcome is Outcome.FAILS and f.serious]
    minor = [f for f in findings if f.outcome is Outcome.FAILS and not f.serious]
    untested = [f for f in findings if f.outcome is Outcome.NOT_TESTED]
    if serious:
        names = listed(dict.fromkeys(f.assumption for f in serious))
        return Verdict(Status.DOUBTFUL, f"doubtful: fails on {names}", tuple(findings))
    summary = "accepted: nothing speaks against the model"
    if untested:
        names = listed(dict.fromkeys(f.assumption for f in untested))
        summary += f"; not tested: {names}"
    if minor:
        names = listed(dict.fromkeys(f.assumption for f in minor))
        summary += f"; of little consequence: {names}"
    return Verdict(Status.ACCEPTED, summary, tuple(findings))


def _findings(diagnosis: ExperimentDiagnosis) -> list[Finding]:
    return [
        bias_finding(diagnosis),
        position_periodic_finding(diagnosis),
        columns_finding(diagnosis),
        delay_finding(diagnosis),
        left_finding(diagnosis),
        noise_level_finding(diagnosis),
        *motion_findings(diagnosis),
        white_finding(diagnosis),
        outliers_finding(diagnosis),
        normal_finding(diagnosis),
        constant_finding(diagnosis),
    ]
