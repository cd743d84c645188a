"""What a report says of a Monte-Carlo study."""

from __future__ import annotations

from estimation.montecarlo.record import EstimatorKeys, MonteCarloRecord
from results.report.content import Block, Fact, Level, Section, StageReport, TableBlock, Verdict
from results.report.folder import RunFolder
from results.report.numerals import percent, readable
from results.report.stages.estimate import NAMES
from results.report.table import Column, ReportTable, Value

FIGURES = ("montecarlo_bias", "montecarlo_efficiency")
_TITLE = "Monte-Carlo study"


def montecarlo_report(folder: RunFolder) -> StageReport:
    """Describe the study in a folder."""
    record = folder.record(MonteCarloRecord)
    summary, estimators = record.summary, record.summary.estimators
    failures = sum(len(entry.failures) for entry in estimators.values())
    names = ", ".join(NAMES.get(name, name) for name in estimators)
    sentence = f"{summary.repetitions.done} simulated experiments, estimators {names}."
    if summary.interrupted:
        sentence += f" Interrupted: {summary.repetitions.wanted} were wanted."
    if failures:
        sentence += f" {failures} estimates failed."
    level = Level.BAD if summary.interrupted else Level.CAUTION if failures else Level.GOOD
    word = "interrupted" if summary.interrupted else "done"
    blocks: list[Block] = [TableBlock(_pooled_table(estimators))]
    blocks += folder.figures(*FIGURES)
    blocks.append(TableBlock(_statistics_table(record)))
    return StageReport(
        Verdict(_TITLE, level, word, sentence, "montecarlo"),
        _facts(estimators),
        (Section("montecarlo", _TITLE, tuple(blocks)),),
    )


def _facts(estimators: dict[str, EstimatorKeys]) -> tuple[Fact, ...]:
    name = "ml" if "ml" in estimators else next(iter(estimators), "")
    pooled = estimators[name].pooled if name else None
    if pooled is None:
        return ()
    title = NAMES.get(name, name)
    return (
        Fact(
            f"{title}: RMSE / bound",
            readable(pooled.rmse_over_bound, 3),
            f"pooled; 95 %: {readable(pooled.rmse_over_bound_low, 3)} … "
            f"{readable(pooled.rmse_over_bound_high, 3)}",
        ),
        Fact(f"{title}: coverage", percent(pooled.coverage), "of its 95 % intervals"),
    )


def _pooled_table(estimators: dict[str, EstimatorKeys]) -> ReportTable:
    shown = (
        "rmse_over_bound",
        "rmse_over_bound_low",
        "rmse_over_bound_high",
        "coverage",
        "coverage_low",
        "coverage_high",
        "largest_bias_t",
    )
    rows: list[tuple[Value, ...]] = [
        (
            NAMES.get(name, name),
            entry.estimates,
            len(entry.failures),
            *(None if entry.pooled is None else getattr(entry.pooled, key) for key in shown),
        )
        for name, entry in estimators.items()
    ]
    columns = (
        Column("estimator", kind="text"),
        Column("estimates"),
        Column("failed"),
        Column("RMSE / bound"),
        Column("95 % from"),
        Column("95 % to"),
        Column("coverage"),
        Column("95 % from"),
        Column("95 % to"),
        Column("largest bias / its error", digits=3),
    )
    caption = "All identified parameters together"
    return ReportTable.of("montecarlo_pooled", caption, columns, rows)


def _statistics_table(record: MonteCarloRecord) -> ReportTable:
    rows: list[tuple[Value, ...]] = [
        (
            NAMES.get(row.estimator, row.estimator),
            row.parameter,
            row.unit,
            row.truth,
            row.bias,
            row.bias_t,
            row.spread,
            row.rmse,
            row.bound,
            row.rmse_over_bound,
            row.coverage,
        )
        for row in record.rows
    ]
    columns = (
        Column("estimator", kind="text"),
        Column("parameter", kind="parameter"),
        Column("unit", kind="text"),
        Column("truth"),
        Column("bias", digits=3),
        Column("bias / its error", digits=3),
        Column("spread", digits=3),
        Column("RMSE", digits=3),
        Column("bound", digits=3),
        Column("RMSE / bound", digits=3),
        Column("coverage", digits=3),
    )
    caption = "Every estimator and parameter against the truth"
    return ReportTable.of("montecarlo", caption, columns, rows, folded=True)
