"""The stage that drives the twin by a position controller, with and without the model's forces."""

from __future__ import annotations

from dataclasses import asdict

from estimation.feedforward.comparison import compare_feedforward
from expdesign.stages.outcome import Outcome
from expdesign.stages.table import STAGES
from expdesign.stages.workspace import Workspace


def perform(work: Workspace) -> Outcome:
    """Compare how well a motion is followed with each feed-forward."""
    configuration, saved = work.estimate()
    design = None
    if "design" in STAGES["feedforward"].needed(configuration):
        design = work.design().trajectory
    record = compare_feedforward(configuration, saved, design)
    summary = record.summary
    reduction = summary.case("identified").reduction
    return Outcome(
        result=record,
        record=record,
        summary={
            "machine": summary.machine,
            "motion": summary.motion,
            "cases": [asdict(each) for each in summary.cases],
            "left": summary.left,
            "warnings": list(summary.warnings),
        },
        message=f"error {reduction:.3g} times smaller with the identified model",
        warnings=summary.warnings[len(configuration.warnings) :],
        doubt="" if reduction > 1 else "the identified model does not make the error smaller",
    )
