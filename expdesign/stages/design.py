"""Stage that searches the optimal excitation trajectory."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from expdesign.configuration import RunConfiguration, quantity_text
from expdesign.information.fisher import SingularInformationError
from expdesign.information.identifiable import listed
from expdesign.interruption import interruptible
from expdesign.stages.stage import TABLES, Stage, run_sections
from expdesign.stages.workspace import Outcome, StageFailed, Workspace, short
from expdesign.workers import Monitor
from results.views.folder import RunFolder
from results.views.view import StageView

if TYPE_CHECKING:
    from expdesign.experiment import DesignResult

_KEPT = "if a start has a result by now, the best so far is finished and saved"
_DISCARDED = "discarded: nothing of this design is saved"


class DesignStage(Stage):
    """Search for the optimal excitation trajectory."""

    name = "design"
    does = "searches the optimal excitation trajectory"
    file = "design.json"
    writes = ("trajectory.csv", *TABLES)
    sections = run_sections("trajectory", "design", experiment={"periods", "sampling", "payload"})
    compared = "trajectory.csv"

    def run(self, work: Workspace) -> Outcome:
        """Design; Ctrl-C keeps the best so far."""
        from expdesign.experiment import design

        progress = work.progress
        with interruptible(progress.note, _KEPT, "discards the design", _DISCARDED) as stop:
            with progress.search(work.configuration) as report:
                monitor = Monitor(stop, report)
                result = name_unexcited(lambda: design(work.configuration, monitor))
            outcome = design_outcome(result, work)
        return replace(outcome, asked_to_stop=stop())

    def result_type(self) -> type[DesignResult]:
        """Return the type of the stored result."""
        from expdesign.experiment import DesignResult

        return DesignResult

    def view(self, folder: RunFolder, *, brief: bool = False) -> StageView:
        """Return the view of the design."""
        from results.views.design import design_view

        return design_view(folder, brief=brief)

    def compare(
        self, folders: Mapping[str, RunFolder], *, precision: float, quick: bool
    ) -> StageView:
        """Return the comparison of designs."""
        from results.comparison.designs import compare_designs

        return compare_designs(folders, precision, quick=quick)

    def reason_left_out(self, configuration: RunConfiguration) -> str:
        """Return the reason against a single design in a sweep."""
        sweeps = configuration.run.sweep is not None
        return "the sweep does it for each of its designs" if sweeps else ""


def design_outcome(result: DesignResult, work: Workspace) -> Outcome:
    """Return the outcome of a design."""
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
        failure="" if result.passed else _failure(result, short(work.folder)),
    )


def name_unexcited(make: Callable[[], DesignResult]) -> DesignResult:
    """Make a design; a singular information is a failure that names the parameters and a remedy."""
    try:
        return make()
    except SingularInformationError as error:
        shown = f" Identifiable are {listed(error.shows)}." if error.shows else ""
        remedy = (
            "Design for the identifiable ones (design.parameters: base)"
            if error.structural
            else "Widen speed, acceleration or workspace"
        )
        raise StageFailed(
            f"no motion within the limits excites these parameters: {error.combinations}.{shown} "
            f"{remedy}, or leave {', '.join(error.unexcited)} out of design.parameters.",
            error.details,
        ) from error


def _failure(result: DesignResult, folder: str) -> str:
    if result.status == "interrupted":
        return f"interrupted: the best so far is saved and marked in {folder}"
    broken = [check for check in result.check.limits if not check.kept]
    parts = []
    for check in sorted(broken, key=lambda check: -check.violation):
        row = f"{check.row}: " if check.row else ""
        parts.append(
            f"{check.key} ({row}{quantity_text(check.value, check.unit)} at {check.time:.4g} s, "
            f"bound {quantity_text(check.bound, check.unit)}: {100 * check.violation:.2g} % of its "
            "range)"
        )
    return f"the design breaks {'; '.join(parts)}. It is saved and marked in {folder}"
