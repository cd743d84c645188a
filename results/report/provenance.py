"""The last part of a report: what made the run folder."""

from __future__ import annotations

from results.report.content import (
    Block,
    Fact,
    Facts,
    Level,
    ListingBlock,
    Section,
    TextBlock,
)
from results.report.folder import RunFolder
from results.report.numerals import duration
from results.report.table import Column, ReportTable

OWN_STAGE = "report"
"""Stage of the manifest that tells of the report itself: a report says nothing of it."""


def provenance(folder: RunFolder) -> Section:
    """Return what made a run folder: stages, versions, seeds, files and the configuration."""
    blocks: list[Block] = []
    manifest = folder.manifest
    if manifest is None:
        known = ", ".join(stage.file for stage in folder.stages.values())
        text = f"The folder has no manifest.json: a stage is there when its file is, of {known}."
        blocks.append(TextBlock(text, Level.CAUTION))
    else:
        stages = {name: entry for name, entry in manifest.stages.items() if name != OWN_STAGE}
        columns = (
            Column("stage", kind="text"),
            Column("status", kind="outcome"),
            Column("time", kind="text"),
            Column("finished (UTC)", kind="text"),
            Column("message", kind="text"),
        )
        rows = [
            (name, entry.status, duration(entry.seconds), entry.finished, entry.message)
            for name, entry in stages.items()
        ]
        blocks.append(ReportTable.of("stages", "Stages of the run", columns, rows))
        blocks.append(
            Facts(tuple(Fact(name, str(value)) for name, value in manifest.versions.items()))
        )
        seeds = ", ".join(f"{name} {seed}" for name, seed in manifest.seeds.items())
        blocks.append(TextBlock(f"Seeds: {seeds}. Evaluation: {manifest.evaluation}."))
        files = [
            (file, name, digest)
            for name, entry in stages.items()
            for file, digest in entry.files.items()
        ]
        heads = tuple(Column(title, kind="text") for title in ("file", "stage", "SHA-256"))
        blocks.append(ReportTable.of("files", "Files of the run folder", heads, files, folded=True))
    blocks.append(ListingBlock("run.yaml: the resolved configuration", folder.run_text()))
    return Section("provenance", "Configuration and versions", tuple(blocks))
