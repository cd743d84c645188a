"""The comparison of several run folders: a page, tables and figures."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

from estimation.identification.record import EstimateRecord
from estimation.montecarlo.result import MonteCarloResult
from expdesign.configuration import InputError, Problem
from expdesign.experiment import DesignResult
from expdesign.experiment.sensitivity import limit_sensitivity
from expdesign.progress import report_progress, track
from expdesign.runfolder.files import write_text
from expdesign.runfolder.manifest import file_hash
from results.comparison.compared_design import ComparedDesign, DesignComparison
from results.comparison.designs import designs_report, precision_series
from results.comparison.estimates import ComparedEstimate, estimates_report, estimates_series
from results.figures.drawing import FigureDefinition, save_figures
from results.figures.parameters import (
    ParameterSeries,
    compared_estimates_figure,
    compared_precision_figure,
)
from results.notation import counted
from results.render.html import latex_table, rendered
from results.render.run_report import NAME
from results.views.estimate import NAMES
from results.views.folder import ReportedStage, RunFolder, embedded
from results.views.view import (
    FigureBlock,
    Level,
    Page,
    ReportSection,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    text_columns,
)

_FORMATS = ("png", "svg", "pdf")
_MOST_NAMED = 4
_FEWEST = 2
COMPARED = {
    "design": "trajectory.csv",
    "estimate": "estimates.csv",
    "montecarlo": "tables/montecarlo.csv",
}
"""Stages that can be compared, and the table that is the result of each: the same seeds give the
same bytes, while the documents beside them hold times."""


def write_comparison(
    paths: Sequence[Path],
    out: Path,
    stages: Mapping[str, ReportedStage],
    *,
    precision: float,
    with_sensitivity: bool = True,
) -> list[Path]:
    """Compare run folders and write `report.html`, `tables/` and `figures/`.

    Return the files. Two or more folders are compared, none of them the one to write to, by the
    stages that they may hold. Periods are counted for a precision, a relative standard deviation;
    what every limit costs takes one local solve per design.

    Raises
    ------
    InputError
        Folders that cannot be compared, or a file of one is missing or does not hold what it
        should.
    """
    folders = open_folders(paths, stages)
    if out.resolve() in {path.resolve() for path in paths}:
        raise InputError(
            "the comparison would overwrite the report of a folder that it compares",
            file=out,
            key="--out",
            allowed="another folder",
        )
    page, written = _page(folders, out, precision, with_sensitivity=with_sensitivity)
    for table in page.tables:
        for ending, text in ((".csv", csv_table(table)), (".tex", latex_table(table))):
            file = out / "tables" / f"{table.key}{ending}"
            write_text(file, text)
            written.append(file)
    write_text(out / NAME, rendered(page))
    return [*written, out / NAME]


def csv_table(table: ReportTable) -> str:
    """Return a table as CSV, with all digits; empty where there is nothing."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.heading for column in table.columns])
    for row in table.rows:
        writer.writerow([None if value != value else value for value in row])  # noqa: PLR0124 - NaN
    return text.getvalue()


def _page(
    folders: dict[str, RunFolder], out: Path, precision: float, *, with_sensitivity: bool
) -> tuple[Page, list[Path]]:
    reports: list[StageView] = []
    written: list[Path] = []

    def drawn(figure: FigureDefinition[ParameterSeries], series: ParameterSeries) -> FigureBlock:
        written.extend(save_figures((figure,), series, out / "figures", formats=_FORMATS))
        return embedded(out / "figures" / f"{figure.key}.svg", figure.caption)

    def holding(stage: str) -> dict[str, RunFolder]:
        return {label: folder for label, folder in folders.items() if folder.has(stage)}

    designs = tuple(
        ComparedDesign(label, folder.record(DesignResult))
        for label, folder in holding("design").items()
    )
    if designs:
        comparison = DesignComparison(designs, precision)
        figure = None
        if comparison.comparable:
            report_progress("drawing figures")
            figure = drawn(compared_precision_figure, precision_series(comparison))
        costs = {}
        if with_sensitivity:
            costs = {
                design.label: limit_sensitivity(
                    design.record.configuration, design.record.trajectory
                )
                for design in track("what each limit costs", designs)
            }
        reports.append(designs_report(comparison, costs, figure))
    estimates = tuple(
        ComparedEstimate(label, folder, folder.record(EstimateRecord).summary)
        for label, folder in holding("estimate").items()
    )
    if estimates:
        pictured = None
        if len(estimates) >= _FEWEST:  # one alone differs from no other
            pictured = drawn(compared_estimates_figure, estimates_series(estimates))
        reports.append(estimates_report(estimates, pictured))
    if studies := holding("montecarlo"):
        reports.append(_achieved_report(studies))
    page = Page(
        title=" · ".join(folders) if len(folders) <= _MOST_NAMED else f"{len(folders)} runs",
        subtitle="Comparison",
        description="",
        verdicts=tuple(report.verdict for report in reports),
        facts=tuple(fact for report in reports for fact in report.facts),
        sections=(*(report.section for report in reports), sources_section(folders)),
        warnings=tuple(warning for report in reports for warning in report.warnings),
    )
    return page, written


def _achieved_report(folders: dict[str, RunFolder]) -> StageView:
    """Return what is to be said of Monte-Carlo studies side by side."""
    found = {label: folder.record(MonteCarloResult).rows for label, folder in folders.items()}
    keys = dict.fromkeys((row.parameter, row.unit) for rows in found.values() for row in rows)
    columns = [
        TableColumn("parameter", kind="parameter", of=[parameter for parameter, _ in keys]),
        TableColumn("unit", kind="text", of=[unit for _, unit in keys]),
    ]
    for label, rows in found.items():
        bounds = {(row.parameter, row.unit): row.bound for row in rows}
        columns.append(
            TableColumn(f"bound, {label}", digits=3, of=[bounds.get(key) for key in keys])
        )
        for estimator in dict.fromkeys(row.estimator for row in rows):
            own = [row for row in rows if row.estimator == estimator]
            spread = {(row.parameter, row.unit): row.spread for row in own}
            title = f"{NAMES.get(estimator, estimator)}, {label}"
            columns.append(TableColumn(title, digits=3, of=[spread.get(key) for key in keys]))
    caption = (
        "Standard deviations that the estimators achieved in simulated experiments, beside the "
        "Cramér–Rao bound of each, SI units"
    )
    table = ReportTable.of("achieved", caption, columns)
    number = counted(len(folders), "study", "studies")
    sentence = f"{number}: achieved standard deviations beside the bound."
    title = "Monte-Carlo studies"
    return StageView(StageVerdict(title, Level.NEUTRAL, "compared", sentence, "studies"), (table,))


def open_folders(
    paths: Sequence[Path], stages: Mapping[str, ReportedStage]
) -> dict[str, RunFolder]:
    """Open run folders; the keys are the shortest ends of their paths that tell them apart.

    Raises
    ------
    InputError
        There are fewer than two, one is named twice, one is no run folder, or has nothing that
        could be compared.
    """
    problems = []
    if len(paths) < _FEWEST:
        problems.append(
            Problem("a comparison needs two run folders", key="DIR", allowed="two or more folders")
        )
    resolved = [path.resolve() for path in paths]
    problems += [
        Problem("the folder is named twice", file=path, key="DIR")
        for position, path in enumerate(paths)
        if resolved[position] in resolved[:position]
    ]
    if problems:
        raise InputError(problems)
    folders = dict(
        zip(_labels(resolved), (RunFolder.open(path, stages) for path in paths), strict=True)
    )
    problems += [
        Problem(
            "it has nothing that could be compared",
            file=folder.path,
            key="DIR",
            allowed=f"folders with {', '.join(stages[stage].file for stage in COMPARED)}",
        )
        for folder in folders.values()
        if not any(folder.has(stage) for stage in COMPARED)
    ]
    if problems:
        raise InputError(problems)
    return folders


def sources_section(folders: dict[str, RunFolder]) -> ReportSection:
    """Return what was compared: folders, versions and the hashes of their files."""
    rows = []
    for label, folder in folders.items():
        versions = {} if folder.manifest is None else folder.manifest.versions
        rows += [
            (
                label,
                stage,
                str(folder.path),
                versions.get("expdesign", ""),
                file_hash(folder.path / table) if (folder.path / table).is_file() else None,
            )
            for stage, table in COMPARED.items()
            if folder.has(stage)
        ]
    columns = text_columns("name", "stage", "folder", "expdesign", "SHA-256 of the result")
    table = ReportTable.of("sources", "What was compared", columns, rows)
    return ReportSection("sources", "Sources", (table,))


def _labels(paths: list[Path]) -> list[str]:
    longest = max(len(path.parts) for path in paths)
    for depth in range(1, longest + 1):
        labels = ["/".join(path.parts[-depth:]) for path in paths]
        if len(set(labels)) == len(labels):
            return labels
    return [str(path) for path in paths]
