"""Stage that writes controller tables of the motion."""

from __future__ import annotations

from typing import Any

from expdesign.stages.stage import Stage, run_sections
from expdesign.stages.workspace import Outcome, Workspace
from results.views.folder import RunFolder
from results.views.view import StageView


class ExportStage(Stage):
    """Controller tables."""

    name = "export"
    does = "writes controller tables of the motion"
    file = "exports/exports.json"
    writes = ("exports/*",)
    sections = run_sections(
        "trajectory",
        "motion",
        "export",
        design={"parameters"},
        experiment={"periods", "sampling", "payload"},
    )
    needs = ("design",)
    shown_after = "design"

    def result_type(self) -> type[Any]:
        """Return the type of the stored result."""
        from expdesign.export.result import ExportResult

        return ExportResult

    def view(self, folder: RunFolder, *, brief: bool = False) -> StageView:
        """Return the view of the controller tables."""
        from results.views.export import export_view

        del brief
        return export_view(folder)

    def run(self, work: Workspace) -> Outcome:
        """Write every table that the run names."""
        from expdesign.stages.exporting import export_tables

        return export_tables(self, work)
