"""The folders of a comparison, each with a name of its own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from expdesign.configuration import InputError, Problem
from expdesign.runfolder.manifest import file_hash
from results.report.content import Section
from results.report.folder import ReportedStage, RunFolder
from results.report.table import ReportTable, text_columns

_FEWEST = 2
COMPARED = {
    "design": "trajectory.csv",
    "estimate": "estimates.csv",
    "montecarlo": "tables/montecarlo.csv",
    "study": "study.json",
}
"""Stages that can be compared, and the table that is the result of each: the same seeds give the
same bytes, while the documents beside them hold times."""


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


def sources_section(folders: dict[str, RunFolder]) -> Section:
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
    return Section("sources", "Sources", (table,))


def _labels(paths: list[Path]) -> list[str]:
    longest = max(len(path.parts) for path in paths)
    for depth in range(1, longest + 1):
        labels = ["/".join(path.parts[-depth:]) for path in paths]
        if len(set(labels)) == len(labels):
            return labels
    return [str(path) for path in paths]
