"""What a report says of the noise of a recording."""

from __future__ import annotations

import numpy as np

from results.reading.document import Document
from results.reading.table import Table
from results.report.content import (
    Block,
    Fact,
    Facts,
    Level,
    Section,
    StageReport,
    TableBlock,
    TextBlock,
    Verdict,
)
from results.report.folder import RunFolder
from results.report.numerals import readable
from results.report.stages.findings import failures, findings_table
from results.report.table import Column, ReportTable, Value

FIGURES = ("noise_distribution", "noise_quantiles", "noise_covariance")
"""Figures of the noise; an estimate of the same recording draws the same ones."""

_STRUTS = 6
_MM = 1e3


def shows_noise(folder: RunFolder) -> bool:
    """Tell whether the noise figures of a folder are those of its noise analysis.

    Both the analysis and an estimate draw them; with an estimate of another recording they are the
    estimate's.
    """
    if not folder.has("noise"):
        return False
    if not folder.has("estimate"):
        return True
    recordings = folder.document("estimate").sections("recordings")
    # The figures of several recordings have numbers, and leave those of the analysis alone.
    return len(recordings) > 1 or any(
        recording.text("source") == folder.document("noise").text("recording")
        for recording in recordings
    )


def noise_report(folder: RunFolder) -> StageReport:
    """Return what is to be said of the noise analysis in a folder."""
    document = folder.document("noise")
    findings = document.sections("findings")
    failed = [finding for finding in findings if finding.text("outcome") == "fails"]
    serious = any(finding.flag("serious") for finding in failed)
    level = Level.BAD if serious else Level.CAUTION if failed else Level.GOOD
    sentence = (
        f"{_count(document)}: standard deviation of the forces "
        f"{_range(document, 'force_std', 1.0)} N, of the lengths "
        f"{_range(document, 'length_std', _MM)} mm."
    )
    if failed:
        sentence += f" Against what is assumed of it: {'; '.join(failures(findings))}."
    word = "doubtful" if serious else "conspicuous" if failed else "as assumed"
    blocks: list[Block] = [
        Facts(_details(document)),
        TableBlock(_channels_table(document, "force", "N", 1.0)),
        TableBlock(_channels_table(document, "length", "mm", _MM)),
    ]
    if not document.flag("averaged"):
        text = (
            "The periods are no whole number of samples: the scatter is that about a Fourier "
            "series, and no two periods can be compared sample by sample."
        )
        blocks.append(TextBlock((text,), Level.CAUTION))
    blocks.append(TableBlock(findings_table("noise_findings", findings, "the noise")))
    if shows_noise(folder):
        blocks += folder.figures(*FIGURES)
    blocks.append(TableBlock(_covariance_table(folder)))
    return StageReport(
        Verdict("Noise", level, word, sentence, "noise"),
        (),
        (Section("noise", "Noise", tuple(blocks)),),
    )


def _count(document: Document) -> str:
    periods = document.number("periods")
    return f"{document.integer('rows')} samples in {readable(periods)} periods"


def _range(document: Document, key: str, factor: float) -> str:
    std = factor * document.array(key, (_STRUTS,))
    return f"{readable(np.min(std), 3)} to {readable(np.max(std), 3)}"


def _details(document: Document) -> tuple[Fact, ...]:
    freedom = document.number("force_freedom")
    # With F degrees of freedom a standard deviation is known to 1/√(2F).
    relative = 100 / np.sqrt(2 * freedom) if freedom > 0 else float("nan")
    return (
        Fact("recording", f"{document.integer('rows')} samples", document.text("recording")),
        Fact("periods", readable(document.number("periods"))),
        Fact("period", f"{readable(document.number('period'))} s"),
        Fact(
            "degrees of freedom",
            readable(freedom),
            f"a standard deviation is known to {readable(relative, 2)} %",
        ),
    )


def _channels_table(document: Document, what: str, unit: str, factor: float) -> ReportTable:
    std = factor * document.array(f"{what}_std", (_STRUTS,))
    normality, whiteness = document.section("normality"), document.section("whiteness")
    shape = normality.section(f"{what}s") if f"{what}s" in normality else None
    memory = whiteness.section(f"{what}_noise") if f"{what}_noise" in whiteness else None
    cells: tuple[list[Value], ...] = (
        [j + 1 for j in range(_STRUTS)],
        list(std.tolist()),
        _channels(shape, "skewness"),
        _channels(shape, "excess_kurtosis"),
        _channels(shape, "outliers"),
        _memory(memory),
    )
    columns = (
        Column("strut"),
        Column("σ", unit),
        Column("skewness", digits=2),
        Column("excess kurtosis", digits=2),
        Column("outliers"),
        Column("largest autocorrelation", digits=2),
    )
    caption = f"Noise of one sample of the {what}s: size, shape and memory"
    return ReportTable.of(f"noise_{what}s", caption, columns, list(zip(*cells, strict=True)))


def _channels(section: Document | None, key: str) -> list[Value]:
    if section is None:
        return [None] * _STRUTS
    return list(section.array(key, (_STRUTS,)).tolist())


def _memory(section: Document | None) -> list[Value]:
    if section is None:
        return [None] * _STRUTS
    found = section.array("autocorrelation", (_STRUTS, section.integer("lags")))
    return [float(row[np.argmax(np.abs(row))]) for row in found]


def _covariance_table(folder: RunFolder) -> ReportTable:
    numbers = ("row", "column", "covariance", "std_error", "correlation")
    table = Table.read(folder.table_file("noise_covariance"), ["quantity", *numbers])
    cells = {name: table.numbers(name).tolist() for name in numbers}
    rows = [
        (table.columns["quantity"][k], *(cells[name][k] for name in numbers))
        for k in range(len(table))
    ]
    columns = (
        Column("quantity", kind="text"),
        Column("row"),
        Column("column"),
        Column("covariance"),
        Column("its standard error", digits=2),
        Column("correlation", digits=3),
    )
    caption = "Covariances of forces, in N², and of lengths, in m², element by element"
    return ReportTable.of("noise_covariance", caption, columns, rows, folded=True)
