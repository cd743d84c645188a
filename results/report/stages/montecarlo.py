"""What a report says of a Monte-Carlo study."""

from __future__ import annotations

from results.reading.document import Document
from results.reading.table import Table
from results.report.content import Block, Fact, Level, Section, StageReport, TableBlock, Verdict
from results.report.folder import RunFolder
from results.report.numerals import percent, readable
from results.report.stages.estimate import NAMES
from results.report.table import Column, ReportTable, Value

FIGURES = ("montecarlo_bias", "montecarlo_efficiency")
_STATISTICS = (
    "truth",
    "bias",
    "bias_t",
    "spread",
    "rmse",
    "bound",
    "rmse_over_bound",
    "coverage",
)


def montecarlo_report(folder: RunFolder) -> StageReport:
    """Return what is to be said of the study in a folder."""
    document = folder.document("montecarlo")
    repetitions = document.section("repetitions")
    done, wanted = repetitions.integer("done"), repetitions.integer("wanted")
    estimators = dict(document.section("estimators").items())
    interrupted = document.flag("interrupted")
    failures = sum(len(entry.sections("failures")) for entry in estimators.values())
    sentence = f"{done} simulated experiments, estimators {_listed(estimators)}."
    if interrupted:
        sentence += f" Interrupted: {wanted} were wanted."
    if failures:
        sentence += f" {failures} estimates failed."
    level = Level.BAD if interrupted else Level.CAUTION if failures else Level.GOOD
    verdict = Verdict(
        "Monte-Carlo study", level, "interrupted" if interrupted else "done", sentence, "montecarlo"
    )
    blocks: list[Block] = [TableBlock(_pooled_table(estimators))]
    blocks += folder.figures(*FIGURES)
    blocks.append(TableBlock(_statistics_table(folder)))
    return StageReport(verdict, _facts(estimators), (_section(blocks),))


def _section(blocks: list[Block]) -> Section:
    return Section("montecarlo", "Monte-Carlo study", tuple(blocks))


def _listed(estimators: dict[str, Document]) -> str:
    return ", ".join(NAMES.get(name, name) for name in estimators)


def _facts(estimators: dict[str, Document]) -> tuple[Fact, ...]:
    name = "ml" if "ml" in estimators else next(iter(estimators), "")
    if not name or "pooled" not in estimators[name]:
        return ()
    pooled = estimators[name].section("pooled")
    title = NAMES.get(name, name)
    return (
        Fact(
            f"{title}: RMSE / bound",
            readable(pooled.number("rmse_over_bound"), 3),
            f"pooled; 95 %: {readable(pooled.number('rmse_over_bound_low'), 3)} … "
            f"{readable(pooled.number('rmse_over_bound_high'), 3)}",
        ),
        Fact(
            f"{title}: coverage",
            percent(pooled.number("coverage")),
            "of its 95 % intervals",
        ),
    )


def _pooled_table(estimators: dict[str, Document]) -> ReportTable:
    rows: list[tuple[Value, ...]] = []
    for name, entry in estimators.items():
        pooled = entry.section("pooled") if "pooled" in entry else None

        def of(key: str, section: Document | None = pooled) -> float | None:
            return None if section is None else section.number_or_none(key)

        rows.append(
            (
                NAMES.get(name, name),
                entry.integer("estimates"),
                len(entry.sections("failures")),
                of("rmse_over_bound"),
                of("rmse_over_bound_low"),
                of("rmse_over_bound_high"),
                of("coverage"),
                of("coverage_low"),
                of("coverage_high"),
                of("largest_bias_t"),
            )
        )
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


def _statistics_table(folder: RunFolder) -> ReportTable:
    table = Table.read(
        folder.table_file("montecarlo"), ["estimator", "parameter", "unit", *_STATISTICS]
    )
    cells = {name: table.numbers(name, blank=True).tolist() for name in _STATISTICS}
    rows = [
        (
            NAMES.get(table.columns["estimator"][k], table.columns["estimator"][k]),
            table.columns["parameter"][k],
            table.columns["unit"][k],
            *(cells[name][k] for name in _STATISTICS),
        )
        for k in range(len(table))
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
