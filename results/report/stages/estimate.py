"""What a report says of an estimate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from constraints.arrays import Array
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
from results.report.estimates import differences_table, information_sentence, information_test
from results.report.folder import RunFolder
from results.report.numerals import readable
from results.report.stages.findings import (
    against,
    findings_table,
    model_findings,
    verdict_level,
)
from results.report.stages.noise import FIGURES as NOISE_FIGURES
from results.report.stages.noise import shows_noise
from results.report.table import Column, ReportTable, Value

FIGURES = ("estimates", "correlation")
DIAGNOSTIC_FIGURES = ("residuals", "residual_dependence", "position_periodic")
NAMES = {"ls": "LS", "gm": "GM", "ml": "ML"}


@dataclass(frozen=True, eq=False)
class EstimateRows:
    """`estimates.csv`, by estimator.

    Attributes
    ----------
    parameters, units : tuple of str
    values, std, low, high : dict of str to (m,)
        By estimator; NaN where there is no interval.
    relative : dict of str to (m,)
        Standard deviation in percent of the a-priori value.
    a_priori : (m,)
    identified : dict of str to tuple of bool
    """

    parameters: tuple[str, ...]
    units: tuple[str, ...]
    values: dict[str, Array]
    std: dict[str, Array]
    low: dict[str, Array]
    high: dict[str, Array]
    relative: dict[str, Array]
    a_priori: Array
    identified: dict[str, tuple[bool, ...]]

    @classmethod
    def read(cls, folder: RunFolder) -> EstimateRows:
        """Read the file of a run folder."""
        names = ("value", "std", "ci_low", "ci_high", "rel_std_percent", "a_priori")
        table = Table.read(
            folder.path / "estimates.csv", ["estimator", "parameter", "unit", *names, "identified"]
        )
        numbers = {name: table.numbers(name, blank=True) for name in names}
        estimators = table.columns["estimator"]
        rows = {
            key: np.flatnonzero([name == key for name in estimators])
            for key in dict.fromkeys(estimators)
        }
        first = next(iter(rows.values()), np.array([], dtype=np.intp))

        def by_estimator(name: str) -> dict[str, Array]:
            return {key: numbers[name][places] for key, places in rows.items()}

        return cls(
            tuple(table.columns["parameter"][k] for k in first),
            tuple(table.columns["unit"][k] for k in first),
            by_estimator("value"),
            by_estimator("std"),
            by_estimator("ci_low"),
            by_estimator("ci_high"),
            by_estimator("rel_std_percent"),
            numbers["a_priori"][first],
            {
                key: tuple(table.columns["identified"][k] == "True" for k in places)
                for key, places in rows.items()
            },
        )


def estimate_report(folder: RunFolder) -> StageReport:
    """Return what is to be said of the estimate in a folder."""
    document = folder.document("estimate")
    rows = EstimateRows.read(folder)
    best = document.text("best")
    truth = _truth(folder, document, rows.parameters)
    diagnostics = document.section("diagnostics") if "diagnostics" in document else None
    return StageReport(
        _verdict(document, diagnostics, best),
        _facts(rows, best, truth),
        (Section("estimate", "Estimate", _blocks(folder, document, rows, truth)),),
        document.texts("warnings"),
    )


def estimates_table(rows: EstimateRows, best: str, truth: Array | None) -> ReportTable:
    """Return the parameters of the best estimator, beside the truth where it is known."""
    columns = [
        Column("parameter", kind="parameter"),
        Column("unit", kind="text"),
        Column("a priori"),
        Column("estimate", digits=5),
        Column("σ", digits=3),
        Column("95 % from", digits=5),
        Column("95 % to", digits=5),
        Column("σ / a priori", "%", digits=3),
        Column("identified", kind="outcome"),
    ]
    if truth is not None:
        columns += [Column("truth"), Column("error / σ", digits=2)]
    table: list[tuple[Value, ...]] = []
    for k, name in enumerate(rows.parameters):
        value, std = float(rows.values[best][k]), float(rows.std[best][k])
        row: tuple[Value, ...] = (
            name,
            rows.units[k],
            float(rows.a_priori[k]),
            value,
            std,
            float(rows.low[best][k]),
            float(rows.high[best][k]),
            float(rows.relative[best][k]),
            "yes" if rows.identified[best][k] else "no",
        )
        if truth is not None:
            error = (value - float(truth[k])) / std if std > 0 else None
            row += (float(truth[k]), error)
        table.append(row)
    known = ", beside the truth of the simulated experiment" if truth is not None else ""
    caption = f"Parameters of the {NAMES.get(best, best)} estimate with 95 % intervals{known}"
    return ReportTable.of("estimates", caption, columns, table)


def _estimators_table(rows: EstimateRows) -> ReportTable:
    columns = [Column("parameter", kind="parameter"), Column("unit", kind="text")]
    for key in rows.values:
        columns += [Column(NAMES.get(key, key), digits=5), Column("σ", digits=3)]
    table: list[tuple[Value, ...]] = []
    for k, name in enumerate(rows.parameters):
        row: tuple[Value, ...] = (name, rows.units[k])
        for key in rows.values:
            row += (float(rows.values[key][k]), float(rows.std[key][k]))
        table.append(row)
    return ReportTable.of("estimators", "All estimators side by side", columns, table, folded=True)


def _blocks(
    folder: RunFolder, document: Document, rows: EstimateRows, truth: Array | None
) -> tuple[Block, ...]:
    best = document.text("best")
    blocks: list[Block] = [Facts(_details(document))]
    note = document.optional("intervals_note")
    if note and not document.flag("intervals_cover"):
        blocks.append(TextBlock((str(note),), Level.CAUTION))
    blocks.append(TableBlock(estimates_table(rows, best, truth)))
    weak = [
        str(entry.optional("text"))
        for entry in document.section("estimators").section(best).sections("combinations")
    ]
    if weak:
        told = "Combinations of parameters that the data do not tell apart: " + "; ".join(weak)
        blocks.append(TextBlock((told,), Level.CAUTION))
    blocks += folder.figures(*FIGURES)
    if len(rows.values) > 1:
        blocks.append(TableBlock(_estimators_table(rows)))
    test = information_test(document)
    if test is not None:
        disturbed = test.differ_jointly or bool(np.any(test.differs))
        sentence = f"{information_sentence(test)}."
        blocks.append(TextBlock((sentence,), Level.CAUTION if disturbed else Level.NEUTRAL))
        caption = "ML − GM against the share of ML's covariance that comes from the motion"
        blocks.append(
            TableBlock(differences_table("hausman", caption, rows.parameters, test, folded=True))
        )
    if "diagnostics" in document:
        found = model_findings(document.section("diagnostics"))
        blocks.append(TableBlock(findings_table("findings", found, "the estimate")))
    blocks += folder.figures(*DIAGNOSTIC_FIGURES)
    if not shows_noise(folder):
        blocks += folder.figures(*NOISE_FIGURES)
    blocks.append(TableBlock(_noise_table(document)))
    return tuple(blocks)


def _noise_table(document: Document) -> ReportTable:
    recordings = document.sections("recordings")
    rows: list[tuple[Value, ...]] = []
    for number, recording in enumerate(recordings, start=1):
        noise = recording.section("noise")
        force = np.sqrt(np.diag(noise.array("force_covariance", (6, 6))))
        length = np.sqrt(np.diag(noise.array("length_covariance", (6, 6))))
        rows += [
            (number, j + 1, float(force[j]), 1e3 * float(length[j]), noise.text("source"))
            for j in range(6)
        ]
    columns = (
        Column("recording"),
        Column("strut"),
        Column("force noise σ", "N"),
        Column("length noise σ", "mm"),
        Column("source", kind="text"),
    )
    caption = "Noise of one sample that the data were weighted with"
    return ReportTable.of("noise", caption, columns, rows, folded=True)


def _truth(folder: RunFolder, document: Document, names: tuple[str, ...]) -> Array | None:
    """Return the true parameters when the estimate is of the folder's own simulated experiment."""
    sources = [PurePath(entry.text("source")).name for entry in document.sections("recordings")]
    own = folder.configuration.run.data.file is None and sources == ["measurement.csv"]
    if not own or not folder.has("experiment"):
        return None
    parameters = folder.document("experiment").section("parameters")
    if any(name not in parameters for name in names):
        return None
    return np.array([parameters.number(name) for name in names])


def _verdict(document: Document, diagnostics: Document | None, best: str) -> Verdict:
    count = len(document.sections("recordings"))
    title = "Estimate"
    begin = f"{NAMES.get(best, best)} from {count} recording{'s' if count > 1 else ''}"
    estimator = document.section("estimators").section(best)
    if not estimator.flag("converged"):
        sentence = f"{begin}; the estimator did not converge: {estimator.text('status')}."
        return Verdict(title, Level.BAD, "not converged", sentence, "estimate")
    if diagnostics is None:
        reason = "the diagnostics were not made"
        if not document.flag("intervals_cover"):
            reason = str(document.optional("intervals_note") or "its intervals do not cover")
        return Verdict(title, Level.CAUTION, "not judged", f"{begin}; {reason}.", "estimate")
    verdict = diagnostics.section("verdict")
    told = against(diagnostics)
    if told:
        sentence = f"{begin}. Against the model: {told}."
    else:
        summary = verdict.text("summary")
        sentence = f"{begin}: {summary.partition(': ')[2] or summary}."
    level = verdict_level(diagnostics)
    return Verdict(title, level, verdict.text("status"), sentence, "estimate")


def _facts(rows: EstimateRows, best: str, truth: Array | None) -> tuple[Fact, ...]:
    flags = rows.identified[best]
    relative = rows.relative[best][np.isfinite(rows.relative[best])]
    facts = [
        Fact(
            "parameters identified",
            f"{sum(flags)} of {len(flags)}",
            f"σ below half of their scale, {NAMES.get(best, best)}",
        )
    ]
    if relative.size:
        facts.append(
            Fact("median σ", f"{readable(np.median(relative), 3)} %", "of the a-priori value")
        )
    if truth is not None:
        inside = (rows.low[best] <= truth) & (truth <= rows.high[best])
        judged = np.isfinite(rows.std[best]) & (rows.std[best] > 0)
        facts.append(
            Fact(
                "intervals that hold the truth",
                f"{int(np.sum(inside & judged))} of {int(np.sum(judged))}",
                "95 % intervals, simulated experiment",
            )
        )
    return tuple(facts)


def _details(document: Document) -> tuple[Fact, ...]:
    recordings = document.sections("recordings")
    facts = []
    for number, recording in enumerate(recordings, start=1):
        name = f"recording {number}" if len(recordings) > 1 else "recording"
        samples, periods = recording.integer("rows"), recording.number("periods")
        facts.append(
            Fact(
                name,
                f"{samples} samples",
                f"{readable(periods)} periods; {recording.text('source')}",
            )
        )
    harmonics = recordings[0].optional("harmonics") if recordings else None
    if harmonics is not None:
        facts.append(Fact("harmonics of the motion", str(harmonics)))
    return tuple(facts)
