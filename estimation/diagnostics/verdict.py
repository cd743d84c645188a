"""The one call: diagnostics and verdict of an estimate, or of its prediction of held-out data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from estimation.diagnostics.diagnosis import ExperimentDiagnosis, diagnose_experiments
from estimation.diagnostics.finding import Finding, Outcome, of_experiment
from estimation.diagnostics.findings import experiment_findings
from estimation.estimators.experiment import Experiment
from estimation.estimators.knowledge import Knowledge
from estimation.estimators.result import ParameterEstimate
from expdesign.robot import Robot
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
        return tuple(finding for finding in self.findings if finding.failed)


def verdict(experiments: Sequence[ExperimentDiagnosis]) -> Verdict:
    """Judge an estimate by the diagnostics of its experiments."""
    findings = tuple(
        of_experiment(finding, number) if len(experiments) > 1 else finding
        for number, experiment in enumerate(experiments, 1)
        for finding in experiment_findings(experiment)
    )
    serious = [f.contradiction for f in findings if f.failed and f.serious]
    if serious:
        return Verdict(Status.DOUBTFUL, f"doubtful: {'; '.join(serious)}", findings)
    summary = "accepted: nothing speaks against the model"
    untested = dict.fromkeys(f.assumption for f in findings if f.outcome is Outcome.NOT_TESTED)
    if untested:
        summary += f"; not tested: {', '.join(untested)}"
    minor = [f.contradiction for f in findings if f.failed]
    if minor:
        summary += f"; of little consequence: {'; '.join(minor)}"
    return Verdict(Status.ACCEPTED, summary, findings)


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Everything that is known of how well an estimate fits."""

    estimator: str
    experiments: tuple[ExperimentDiagnosis, ...]
    verdict: Verdict


def diagnose(
    robot: Robot,
    experiments: Sequence[Experiment],
    knowledge: Knowledge,
    estimate: ParameterEstimate,
    *,
    held_out: bool = False,
) -> Diagnosis:
    """Diagnose an estimate.

    Parameters
    ----------
    experiments : sequence of Experiment
        Those that the estimate was made from, in the same order; or others, with motions of their
        own, when `held_out`.
    knowledge : Knowledge
        What the estimate knew besides the data.
    estimate : ParameterEstimate
        Of any estimator.
    held_out : bool
        The forces of the experiments were not used for the estimate: Cov(p̂) is part of what the
        residuals may be.
    """
    results = diagnose_experiments(robot, experiments, knowledge, estimate, held_out=held_out)
    return Diagnosis(estimate.estimator, results, verdict(results))
