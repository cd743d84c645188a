"""`expdesign report`: one page for everything that a run folder holds."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from expdesign.cli.folder import refuse_unwritable
from expdesign.cli.output import JsonOption, results, short, write_json

if TYPE_CHECKING:
    from expdesign.configuration import RunConfiguration

STAGE = "report"

FolderArgument = Annotated[
    Path, typer.Argument(metavar="DIR", help="A run folder.", show_default=False)
]


def report(folder: FolderArgument, as_json: JsonOption = False) -> None:
    """Write the report of a run folder: report.html, one page that needs nothing else.

    It shows every stage that the folder holds. Its main tables are also written as LaTeX into
    tables/.
    """
    place = folder.absolute()
    written = _written(place)
    summary = _summary(place, written)
    if as_json:
        write_json({"status": 0, **summary})
    else:
        _show(place)


def report_stage(configuration: RunConfiguration, folder: Path, *, as_json: bool) -> dict[str, Any]:
    """Write the report as the last stage of a run and return what came out for machines."""
    from expdesign.cli.stages import keep_configuration, record_stage

    with record_stage(STAGE, configuration, folder, folder_stages(folder)) as stage:
        if folder.is_dir():
            # It is shown in the report. All other stages of the run are done by now.
            refuse_unwritable(folder)
            keep_configuration(configuration, folder)
        stage.files = _written(folder, configuration)
        stage.status = "done"
    if not as_json:
        _show(folder)
    return _summary(folder, stage.files)


def folder_stages(folder: Path) -> str:
    """Return what a report is made from beside the configuration: what the other stages wrote."""
    from results.report.run_report import stages_text

    return stages_text(folder)


def _written(folder: Path, configuration: RunConfiguration | None = None) -> list[Path]:
    from results.report.run_report import write_report

    if folder.is_dir():
        refuse_unwritable(folder)
    return write_report(folder, configuration)


def _summary(folder: Path, written: list[Path]) -> dict[str, Any]:
    return {
        "folder": str(folder),
        "report": str(folder / "report.html"),
        "files": [str(path.relative_to(folder)) for path in written],
    }


def _show(folder: Path) -> None:
    results().print(f"report: {short(folder / 'report.html')}", soft_wrap=True)
