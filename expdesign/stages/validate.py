"""The stage that predicts motions which were not used for the estimate."""

from __future__ import annotations

from estimation.validation import validate
from expdesign.robot import robot_from
from expdesign.stages.outcome import Outcome
from expdesign.stages.workspace import Workspace
from results import record_figures


def perform(work: Workspace) -> Outcome:
    """Validate, and write the run folder.

    Raises
    ------
    InputError
        The estimate is another robot's, or a motion cannot be made or read.
    ComputationError
        No motion has the measured lengths.
    """
    configuration, folder = work.configuration, work.folder
    record = validate(configuration, work.estimate(robot_from(configuration.robot)))
    summary, warnings = record.summary, record.summary.warnings
    figures = record_figures(record, folder, configuration.run.report.figures)
    return Outcome(
        "validate",
        folder,
        record,
        (*record.write(folder), *figures),
        summary={
            "accepted": summary.accepted,
            "motions": {each.name: each.diagnostics.verdict.summary for each in summary.motions},
            "seconds": summary.seconds,
            "warnings": list(warnings),
        },
        record=record,
        message="accepted" if summary.accepted else "doubtful",
        warnings=warnings[len(configuration.warnings) :],
        doubt="" if summary.accepted else "a motion speaks against the model",
    )
