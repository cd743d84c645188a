"""Report of a run folder: one page for all its stages."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from expdesign.configuration import RunConfiguration
from expdesign.stages.execution import keep_configuration
from expdesign.stages.stage import Outcome, StageFunctions, Workspace
from results.render.run_report import NAME, write_report
from results.views.folder import RunFolder, StageViews, ViewedStage
from results.views.view import Level, StageVerdict, StageView


def run_report(work: Workspace) -> Outcome:
    """Write the report as the last stage of a run."""
    if work.folder.is_dir():
        # The report shows it, and all other stages of the run are done by now.
        keep_configuration(work.configuration, work.folder)
    results = [made.result for made in work.made.values() if not made.kept]
    return report_folder(work.folder, work.stages, work.configuration, results)


def report_view(folder: RunFolder) -> StageView:
    """Return the view of a report: the place of its page."""
    del folder
    return StageView(StageVerdict("Report", Level.GOOD, "written", f"It is in {NAME}"))


REPORT = StageFunctions(run_report, StageViews(Path, report_view))


def report_folder(
    folder: Path,
    stages: Mapping[str, ViewedStage],
    configuration: RunConfiguration | None = None,
    results: Iterable[Any] = (),
) -> Outcome:
    """Write the report of a folder, with the parameters of `write_report`; return its outcome."""
    files = tuple(write_report(folder, stages, configuration, results))
    page = folder / NAME
    return Outcome(
        result=page,
        files=files,
        summary={
            "folder": str(folder),
            "report": str(page),
            "files": [str(path.relative_to(folder)) for path in files],
        },
    )
