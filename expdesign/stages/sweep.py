"""Stage that makes a design for every point of a grid."""

from __future__ import annotations

from typing import Any

from expdesign.configuration import RunConfiguration
from expdesign.interruption import interruptible
from expdesign.stages.stage import TABLES, Stage, run_sections
from expdesign.stages.workspace import Outcome, Workspace
from expdesign.workers import Monitor
from results.views.folder import RunFolder
from results.views.view import StageView

_KEPT = "finished designs are kept, and of the running ones the best so far"


class SweepStage(Stage):
    """Designs over a grid."""

    name = "sweep"
    does = "designs at every point of a grid"
    file = "sweep.json"
    writes = (*TABLES, "designs/*/design.json")
    sections = run_sections(
        "trajectory", "design", "sweep", experiment={"periods", "sampling", "payload"}
    )

    def result_type(self) -> type[Any]:
        """Return the type of the stored result."""
        from expdesign.experiment.sweep import SweepResult

        return SweepResult

    def view(self, folder: RunFolder, *, brief: bool = False) -> StageView:
        """Return the view of the sweep."""
        from results.views.sweep import sweep_view

        del brief
        return sweep_view(folder)

    def reason_left_out(self, configuration: RunConfiguration) -> str:
        """Return no reason: a run that names the sweep does it."""
        del configuration
        return ""

    def run(self, work: Workspace) -> Outcome:
        """Design every point that is not done; a failed design does not end the others."""
        from expdesign.stages.sweep_designs import make_sweep

        progress = work.progress
        with (
            progress.count("designs") as advanced,
            interruptible(progress.note, _KEPT, "discards the running ones") as stop,
        ):
            return make_sweep(work, Monitor(stop, advanced=advanced))
