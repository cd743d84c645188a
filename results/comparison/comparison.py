"""The comparison of several run folders: a page, tables and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from expdesign.configuration import InputError, Problem
from expdesign.progress import track
from expdesign.runfolder.files import write_text
from expdesign.runfolder.lock import consistent_reading
from expdesign.runfolder.manifest import file_hash
from expdesign.runfolder.tables import write_csv
from results.notation import count_text
from results.render.figures import draw_figures
from results.render.markup import html_page, latex_table
from results.render.run_report import NAME, page_section
from results.views.folder import RunFolder, ViewedStage
from results.views.view import (
    Level,
    Page,
    PageSection,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    text_columns,
)

_FORMATS = ("png", "svg", "pdf")
_MOST_NAMED = 4
_FEWEST = 2


def write_comparison(
    paths: Sequence[Path],
    out: Path,
    stages: Mapping[str, ViewedStage],
    *,
    precision: float,
    quick: bool = False,
) -> tuple[list[Path], list[StageView]]:
    """Write `report.html`, `tables/` and `figures/` of run folders; return files and views.

    The folders, two or more, are compared in the stages that have a `compared` table, in their
    order. Periods of designs are counted for the relative standard deviation `precision`; a `quick`
    comparison leaves out the costs of limits, which take one local solve per design.
    """
    if out.resolve() in {path.resolve() for path in paths}:
        raise InputError(
            "the comparison would overwrite the report of a compared folder",
            file=out,
            key="--out",
            allowed="another folder",
        )
    with consistent_reading(*paths):
        folders = open_folders(paths, stages)
        views = list[StageView]()
        for name, stage in track("comparing", tuple(stages.items())):
            holding = {label: folder for label, folder in folders.items() if folder.has(name)}
            if not (stage.compared and holding):
                continue
            compare = stage.views().compare
            view = compare(holding, precision, quick) if compare else compare_facts(name, holding)
            views += [] if view is None else [view]
    written = [file for view in views for file in draw_figures(view, out, _FORMATS)]
    page = _page(folders, views, out)
    for table in page.tables:
        files = [out / "tables" / f"{table.key}{ending}" for ending in (".csv", ".tex")]
        write_report_csv(files[0], table)
        write_text(files[1], latex_table(table))
        written += files
    write_text(out / NAME, html_page(page))
    return [*written, out / NAME], views


def write_report_csv(path: Path, table: ReportTable) -> None:
    """Write a table as CSV, with all digits; empty where a value is missing."""
    write_csv(path, [column.heading for column in table.columns], table.rows)


def _page(folders: Mapping[str, RunFolder], views: Sequence[StageView], out: Path) -> Page:
    sections = [page_section(view.section, out) for view in views]
    return Page(
        title=" · ".join(folders) if len(folders) <= _MOST_NAMED else f"{len(folders)} runs",
        subtitle="Comparison",
        description="",
        verdicts=tuple(view.verdict for view in views),
        facts=tuple(fact for view in views for fact in view.facts),
        sections=(*sections, sources_section(folders)),
        warnings=(
            *(
                f"{label}: {change}"
                for label, folder in folders.items()
                for change in folder.changes.all
            ),
            *(warning for view in views for warning in view.warnings),
        ),
    )


def open_folders(paths: Sequence[Path], stages: Mapping[str, ViewedStage]) -> dict[str, RunFolder]:
    """Open run folders by the shortest ends of their paths that differ.

    Two or more are needed, each with a run and a stage that is compared, and none named twice.
    """
    compared = [name for name, stage in stages.items() if stage.compared]
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
            "the folder has no result that can be compared",
            file=folder.path,
            key="DIR",
            allowed=f"folders with {', '.join(stages[name].file for name in compared)}",
        )
        for folder in folders.values()
        if not any(folder.has(name) for name in compared)
    ]
    if problems:
        raise InputError(problems)
    return folders


def sources_section(folders: Mapping[str, RunFolder]) -> PageSection:
    """Return the sources of a comparison: folders, versions and hashes of their results."""
    rows = []
    for label, folder in folders.items():
        versions = {} if folder.manifest is None else folder.manifest.versions
        rows += [
            (
                label,
                name,
                str(folder.path),
                versions.get("expdesign", ""),
                file_hash(file) if (file := folder.path / stage.compared).is_file() else None,
            )
            for name, stage in folder.stages.items()
            if stage.compared and folder.has(name)
        ]
    columns = text_columns("name", "stage", "folder", "expdesign", "SHA-256 of the result")
    table = ReportTable.of("sources", "Compared results", columns, rows)
    return PageSection("sources", "Sources", (table,))


def _labels(paths: list[Path]) -> list[str]:
    longest = max(len(path.parts) for path in paths)
    for depth in range(1, longest + 1):
        labels = ["/".join(path.parts[-depth:]) for path in paths]
        if len(set(labels)) == len(labels):
            return labels
    return [str(path) for path in paths]


def compare_facts(stage: str, folders: Mapping[str, RunFolder]) -> StageView | None:
    """Return verdicts and facts of a stage's views, one column per folder; None without facts."""
    views = {label: replace(folder, brief=True).view(stage) for label, folder in folders.items()}
    facts = {label: {fact.name: fact.value for fact in view.facts} for label, view in views.items()}
    names = dict.fromkeys(name for own in facts.values() for name in own)
    if not names:
        return None
    rows = [
        ("verdict", *(view.verdict.word for view in views.values())),
        *((name, *(own.get(name) for own in facts.values())) for name in names),
    ]
    columns = [TableColumn(title, kind="text") for title in ("", *views)]
    title = next(iter(views.values())).verdict.title
    table = ReportTable.of(
        f"compared_{stage}", f"{title}: verdicts and main numbers", columns, rows, screen=True
    )
    sentence = f"{count_text(len(views), 'folder')}: verdicts and main numbers."
    verdict = StageVerdict(title, Level.NEUTRAL, "compared", sentence, f"compared_{stage}")
    return StageView(verdict, (table,))
