"""The stage that searches the optimal excitation trajectory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from expdesign.configuration import quantity_text
from expdesign.experiment import DesignResult, design
from expdesign.information.fisher import SingularInformationError
from expdesign.information.identifiable import listed
from expdesign.interruption import interruptible
from expdesign.stages.outcome import Outcome, StageFailed, short
from expdesign.stages.workspace import Workspace
from expdesign.workers import Monitor

_KEPT = "if a start has a result by now, the best so far is finished and saved"
_ABANDONED = "abandoned: nothing of this design is saved"


def perform(work: Workspace) -> Outcome:
    """Design."""
    progress = work.progress
    with interruptible(progress.note, _KEPT, "abandons the design", _ABANDONED) as stop:
        with progress.search(work.configuration) as report:
            result = searched(lambda: design(work.configuration, Monitor(stop, report)))
        outcome = outcome_of(result, work)
    return replace(outcome, asked_to_stop=stop())


def outcome_of(result: DesignResult, work: Workspace) -> Outcome:
    """Return what becomes of a design that was made."""
    return Outcome(
        result=result,
        record=result,
        summary={
            "design_status": result.status,
            "log_det_information": result.log_det_information,
            "criterion": result.configuration.run.design.criterion,
            "criterion_value": result.criterion_value,
            "worst_violation": result.check.worst,
            "warnings": list(result.warnings),
        },
        status="done" if result.passed else result.status,
        message=result.status_text,
        warnings=result.warnings[len(work.configuration.warnings) :],
        failure="" if result.passed else _what_is_wrong(result, short(work.folder)),
    )


def searched(make: Callable[[], DesignResult]) -> DesignResult:
    """Design; `StageFailed` says which parameters no motion shows, and what would help."""
    try:
        return make()
    except SingularInformationError as error:
        shown = f" What shows is {listed(error.shows)}." if error.shows else ""
        remedy = (
            "Design for what shows (design.parameters: base)"
            if error.structural
            else "Widen speed, acceleration or workspace"
        )
        raise StageFailed(
            f"no motion within the limits shows these parameters: {error.combinations}.{shown} "
            f"{remedy}, or leave {', '.join(error.unexcited)} out of design.parameters.",
            error.details,
        ) from error


def _what_is_wrong(result: DesignResult, folder: str) -> str:
    if result.status == "interrupted":
        return f"interrupted: the best so far is saved, and marked, in {folder}"
    broken = [check for check in result.check.limits if not check.kept]
    parts = []
    for check in sorted(broken, key=lambda check: -check.violation):
        row = f"{check.row}: " if check.row else ""
        parts.append(
            f"{check.key} ({row}{quantity_text(check.value, check.unit)} at {check.time:.4g} s, "
            f"bound {quantity_text(check.bound, check.unit)}: {100 * check.violation:.2g} % of its "
            "range too far)"
        )
    return f"the design breaks {'; '.join(parts)}. It is saved, and marked, in {folder}"
