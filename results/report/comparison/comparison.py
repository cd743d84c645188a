"""The comparison of several run folders: a page, tables and figures."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from estimation.identification.record import EstimateRecord
from expdesign.configuration import InputError
from expdesign.experiment import DesignRecord
from expdesign.experiment.sensitivity import LimitSensitivity, limit_sensitivity
from expdesign.runfolder.atomic import write_text
from results.figures.drawing import FigureDefinition, save_figures
from results.figures.parameters import (
    ParameterSeries,
    compared_estimates_figure,
    compared_precision_figure,
)
from results.report.comparison.design_tables import (
    criteria_table,
    efficiencies,
    effort_table,
    limits_table,
    precision_series,
    precision_table,
)
from results.report.comparison.designs import COUNTED, ComparedDesign, DesignComparison
from results.report.comparison.estimates import (
    ComparedEstimate,
    estimates_report,
    estimates_series,
)
from results.report.comparison.sources import open_folders, sources_section
from results.report.comparison.studies import achieved_report, claims_report
from results.report.content import (
    Block,
    Fact,
    FigureBlock,
    Level,
    Page,
    StageReport,
    TextBlock,
    Verdict,
)
from results.report.folder import ReportedStage, RunFolder, embedded
from results.report.latex import latex_table
from results.report.limit_gains import EXPLAINED, costliest_fact, gains_table
from results.report.numerals import counted, duration, percent
from results.report.rendering import rendered
from results.report.run_report import NAME
from results.report.table import ReportTable, Value

_FORMATS = ("png", "svg", "pdf")
_MOST_NAMED = 4


def write_comparison(
    paths: Sequence[Path],
    out: Path,
    stages: Mapping[str, ReportedStage],
    *,
    precision: float,
    with_sensitivity: bool = True,
) -> list[Path]:
    """Compare run folders and write `report.html`, `tables/` and `figures/`.

    Parameters
    ----------
    paths : sequence of Path
        Two or more run folders.
    out : Path
        Where to write; none of the folders that are compared.
    stages : mapping of str to ReportedStage
        Those that a folder may hold.
    precision : float
        Relative standard deviation for which periods are counted.
    with_sensitivity : bool
        True to say what every limit costs: one local solve per design.

    Returns
    -------
    list of Path
        The files written.

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
    writer.writerows([[_plain(value) for value in row] for row in table.rows])
    return text.getvalue()


def _plain(value: Value) -> str:
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return ""
    return repr(value) if isinstance(value, float) else str(value)


def _page(
    folders: dict[str, RunFolder], out: Path, precision: float, *, with_sensitivity: bool
) -> tuple[Page, list[Path]]:
    reports: list[StageReport] = []
    written: list[Path] = []

    def drawn(figure: FigureDefinition[ParameterSeries], series: ParameterSeries) -> FigureBlock:
        written.extend(save_figures((figure,), series, out / "figures", formats=_FORMATS))
        return embedded(out / "figures" / f"{figure.key}.svg", figure.caption)

    def holding(stage: str) -> dict[str, RunFolder]:
        return {label: folder for label, folder in folders.items() if folder.has(stage)}

    if asked := holding("study"):
        reports.append(claims_report(asked))
    designs = tuple(
        ComparedDesign(label, folder.record(DesignRecord))
        for label, folder in holding("design").items()
    )
    if designs:
        comparison = DesignComparison(designs, precision)
        figure = None
        if comparison.comparable:
            figure = drawn(compared_precision_figure, precision_series(comparison))
        costs = {}
        if with_sensitivity:
            costs = {
                design.label: limit_sensitivity(
                    design.record.configuration, design.record.summary.trajectory
                )
                for design in designs
            }
        reports.append(_designs_report(comparison, costs, figure))
    estimates = tuple(
        ComparedEstimate(label, folder, folder.record(EstimateRecord).summary)
        for label, folder in holding("estimate").items()
    )
    if estimates:
        figure = drawn(compared_estimates_figure, estimates_series(estimates))
        reports.append(estimates_report(estimates, figure))
    if studies := holding("montecarlo"):
        reports.append(achieved_report(studies))
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


def _designs_report(
    comparison: DesignComparison, costs: dict[str, LimitSensitivity], figure: FigureBlock | None
) -> StageReport:
    designs = comparison.designs
    blocks: list[Block] = []
    facts: list[Fact] = []
    sentence = f"{counted(len(designs), 'design')}."
    if figure is not None:
        blocks += [
            criteria_table(comparison),
            figure,
            effort_table(comparison),
            precision_table(comparison),
        ]
        text, best = _efficiencies_in_words(comparison)
        sentence += text
        facts += best
    blocks.append(limits_table(designs))
    if costs:
        blocks.append(gains_table(costs, "the optimum beside the design"))
        found = (costliest_fact(cost, f"{label}: ") for label, cost in costs.items())
        facts += [fact for fact in found if fact is not None]
        if any(each.unexplained > EXPLAINED for each in costs.values()):
            text = (
                "Where the limits leave more than 10 % of the cost's gradient unexplained, the "
                "design is not near an optimum, and what its limits cost is not shown."
            )
            blocks.append(TextBlock(text, Level.CAUTION))
    # No column of a table: tables are the same bytes whenever the same seeds were used.
    seconds = {design.label: design.record.summary.solver.seconds for design in designs}
    each = ", ".join(f"{label}: {duration(value)}" for label, value in seconds.items())
    facts.append(Fact("search", duration(sum(seconds.values())), each))
    verdict = Verdict("Designs", Level.NEUTRAL, "compared", sentence, "designs")
    return StageReport(verdict, tuple(blocks), tuple(facts), comparison.differences())


def _efficiencies_in_words(comparison: DesignComparison) -> tuple[str, list[Fact]]:
    """Return which design has most information, and what the others have of it, by machine."""
    every = efficiencies(comparison)
    several = len(comparison.machines) > 1
    text, facts = "", []
    for designs in comparison.machines:
        shares = {
            design.label: share for design in designs if (share := every[design.label]) is not None
        }
        if not shares:
            continue
        best = max(shares, key=lambda label: shares[label])
        others = ", ".join(
            f"{label} has {percent(value)} of its information per parameter"
            for label, value in shares.items()
            if label != best
        )
        among = f" of {' and '.join(shares)}" if several else ""
        text += f" {best} has the largest log det F{among}{f'; {others}' if others else ''}."
        facts.append(Fact("largest log det F", best, f"for {comparison.samples} samples"))
    if several:
        text += (
            f" They are for {len(comparison.machines)} different robots ({COUNTED}), between which "
            "there is no efficiency; precision is relative to each one's own nominal values."
        )
    return text, facts
