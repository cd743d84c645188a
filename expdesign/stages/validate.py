"""Stage that predicts motions that were not used for the estimate."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from expdesign.stages.stage import TABLES, Stage, run_sections
from expdesign.stages.workspace import Outcome, Workspace
from results.views.folder import RunFolder
from results.views.view import StageView

if TYPE_CHECKING:
    from estimation.validation.validate import ValidationResult


class ValidateStage(Stage):
    """Validation of an estimate on other motions."""

    name = "validate"
    does = "predicts motions that were not used for the estimate"
    file = "validation.json"
    writes = TABLES
    sections = run_sections("trajectory", "experiment", "data", "estimate", "validation")
    needs = ("estimate",)
    compared = "tables/validation.csv"

    def result_type(self) -> type[Any]:
        """Return the type of the stored result."""
        from estimation.validation.validate import ValidationResult

        return ValidationResult

    def view(self, folder: RunFolder, *, brief: bool = False) -> StageView:
        """Return the view of the validation."""
        from results.views.validate import validation_view

        del brief
        return validation_view(folder)

    def run(self, work: Workspace) -> Outcome:
        """Predict motions, and compare with the measured forces."""
        from estimation.validation.validate import validate

        configuration, saved = work.estimate()
        record = validate(configuration, saved)
        summary, warnings = record, record.warnings
        return Outcome(
            result=record,
            record=record,
            summary={
                "accepted": summary.accepted,
                "motions": {
                    each.name: each.diagnostics.verdict.summary for each in summary.motions
                },
                "within_tolerance": {each.name: each.within for each in summary.motions},
                "seconds": summary.seconds,
                "warnings": list(warnings),
            },
            message="accepted" if summary.accepted else "doubtful",
            warnings=warnings[len(configuration.warnings) :],
            doubt="" if summary.accepted else _doubt(summary),
        )


def _doubt(summary: ValidationResult) -> str:
    if any(each.within is False for each in summary.motions):
        return "a motion is not predicted within its tolerance"
    return "a motion contradicts the model"
