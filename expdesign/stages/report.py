"""Stage that writes the report of a run folder."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from expdesign.configuration import RunConfiguration
from expdesign.stages.execution import keep_configuration
from expdesign.stages.stage import FIGURES, Stage
from expdesign.stages.workspace import Outcome, Workspace
from results.views.folder import RunFolder, ViewedStage
from results.views.view import Level, StageVerdict, StageView

PAGE = "report.html"


class ReportStage(Stage):
    """One page for everything in the folder."""

    name = "report"
    does = "writes one page for everything in the folder"
    file = PAGE
    writes = ("tables/*.tex", FIGURES)
    needs = ("folder",)

    def result_type(self) -> type[Any]:
        """Return the path of the page, the only result."""
        return Path

    def view(self, folder: RunFolder, *, brief: bool = False) -> StageView:
        """Return the place of the page."""
        del brief
        sentence = f"All stages of {folder.configuration.run.name} in one page"
        return StageView(StageVerdict("Report", Level.GOOD, "written", sentence))

    def reason_left_out(self, configuration: RunConfiguration) -> str:
        """Return no reason: every run can be reported."""
        del configuration
        return ""

    def run(self, work: Workspace) -> Outcome:
        """Write the report as the last stage of a run."""
        if work.folder.is_dir():
            # The report shows it, and all other stages of the run are done by now.
            keep_configuration(work.configuration, work.folder)
        results = [made.record for made in work.made.values() if made.record is not None]
        return report_folder(work.folder, work.stages, work.configuration, results)


def report_folder(
    folder: Path,
    stages: Mapping[str, ViewedStage],
    configuration: RunConfiguration | None = None,
    results: Iterable[Any] = (),
) -> Outcome:
    """Write the report of a folder, with the sections of the stages that it holds.

    Parameters
    ----------
    folder : Path
    stages : mapping of str to ViewedStage
        Stages in the order of their sections.
    configuration : RunConfiguration, optional
        Run whose `report` section is used; the folder's `run.yaml` by default.
    results : iterable
        Results in memory, which are not read from the folder.
    """
    from results.render.run_report import write_report

    files = tuple(write_report(folder, stages, configuration, results))
    page = folder / PAGE
    verdict = StageVerdict("Report", Level.GOOD, "written", f"It is in {page.name}")
    return Outcome(
        result=page,
        files=files,
        summary={
            "folder": str(folder),
            "report": str(page),
            "files": [str(path.relative_to(folder)) for path in files],
        },
        view=StageView(verdict),
    )
