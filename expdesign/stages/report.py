"""The stage that writes the report of a run folder."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

from expdesign.configuration import RunConfiguration
from expdesign.stages.outcome import Outcome
from expdesign.stages.record import keep_configuration
from expdesign.stages.table import STAGES, loaded
from expdesign.stages.workspace import Workspace
from results.render.run_report import write_report
from results.views.folder import ReportedStage, RunFolder
from results.views.view import StageView


def perform(work: Workspace) -> Outcome:
    """Write the report as the last stage of a run."""
    if work.folder.is_dir():
        # It is shown in the report. All other stages of the run are done by now.
        keep_configuration(work.configuration, work.folder)
    records = [made.record for made in work.made.values() if made.record is not None]
    return written_report(work.folder, work.configuration, records)


def written_report(
    folder: Path, configuration: RunConfiguration | None = None, records: Iterable[Any] = ()
) -> Outcome:
    """Write the report of a folder, with the sections of the stages that it holds.

    Parameters
    ----------
    folder : Path
    configuration : RunConfiguration, optional
        Whose `report` section counts; the folder's `run.yaml` by default.
    records : iterable
        What the run has just made, and is not read from the folder therefore.
    """
    files = tuple(write_report(folder, reported_stages(), configuration, records))
    page = folder / STAGES["report"].record
    return Outcome(
        result=page,
        files=files,
        summary={
            "folder": str(folder),
            "report": str(page),
            "files": [str(path.relative_to(folder)) for path in files],
        },
    )


def reported_stages() -> dict[str, ReportedStage]:
    """Return what reports know of the stages, in the order of their sections."""
    found: dict[str, ReportedStage] = {}
    for place in STAGES:
        for name, stage in STAGES.items():
            if stage.report is not None and (stage.reported_after or name) == place:
                found[name] = ReportedStage(stage.record, partial(_report_by, stage.report))
    return found


def _report_by(place: str, folder: RunFolder) -> StageView:
    """Return what a function, as ``module:function``, says of a folder that holds its stage."""
    report: StageView = loaded(place)(folder)
    return report
