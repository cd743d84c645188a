"""The stage that predicts motions which were not used for the estimate."""

from __future__ import annotations

from estimation.validation import validate
from estimation.validation.record import ValidationRecord
from expdesign.robot import robot_from
from expdesign.stages.outcome import Outcome
from expdesign.stages.workspace import Workspace
from results import validation_figures


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
    result = validate(configuration, work.estimate(robot_from(configuration.robot)))
    record = ValidationRecord.of(result)
    figures = validation_figures(record, folder, configuration.run.report.figures)
    return Outcome(
        "validate",
        folder,
        result,
        (*record.write(folder), *figures),
        summary={
            "accepted": result.accepted,
            "motions": {motion.name: motion.diagnosis.verdict.summary for motion in result.motions},
            "seconds": result.seconds,
            "warnings": list(result.warnings),
        },
        record=record,
        message="accepted" if result.accepted else "doubtful",
        warnings=result.warnings[len(configuration.warnings) :],
        doubt="" if result.accepted else "a motion speaks against the model",
    )
