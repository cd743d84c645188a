"""The stage that writes the report of a run folder."""

from __future__ import annotations

from pathlib import Path

from expdesign.configuration import RunConfiguration
from expdesign.stages.outcome import Outcome
from expdesign.stages.record import keep_configuration
from expdesign.stages.table import STAGES
from expdesign.stages.workspace import Workspace
from results.report.run_report import write_report


def perform(work: Workspace) -> Outcome:
    """Write the report as the last stage of a run.

    Raises
    ------
    InputError
        The folder has no results, or a file of it does not hold what it should.
    """
    if work.folder.is_dir():
        # It is shown in the report. All other stages of the run are done by now.
        keep_configuration(work.configuration, work.folder)
    return written_report(work.folder, work.configuration)


def written_report(folder: Path, configuration: RunConfiguration | None = None) -> Outcome:
    """Write the report of a folder, with the sections of the stages that it holds.

    Parameters
    ----------
    folder : Path
    configuration : RunConfiguration, optional
        Whose `report` section counts; the folder's `run.yaml` by default.

    Raises
    ------
    InputError
        It is no run folder, or a file of it does not hold what it should.
    """
    files = tuple(write_report(folder, configuration))
    page = folder / STAGES["report"].record
    return Outcome(
        "report",
        folder,
        page,
        files,
        summary={
            "folder": str(folder),
            "report": str(page),
            "files": [str(path.relative_to(folder)) for path in files],
        },
    )
