"""What a report says of a design."""

from __future__ import annotations

import numpy as np

from constraints import limit_definitions
from expdesign.experiment.sensitivity import LimitSensitivity
from expdesign.information.catalogue import criteria_by_key
from results.reading.table import Table
from results.record import DesignRecord
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
from results.report.limit_gains import (
    EXPLAINED,
    costliest,
    design_sensitivity,
    gains_table,
    limit_title,
)
from results.report.numerals import duration, percent, readable
from results.report.table import Column, ReportTable, Value
from results.units import handy_unit

FIGURES = (
    "excitation",
    "path",
    "struts",
    "cardan_angles",
    "limits_used",
    "precision",
    "eigenvalues",
    "convergence",
)

_LEVELS = {
    "converged": Level.GOOD,
    "not converged": Level.CAUTION,
    "interrupted": Level.BAD,
    "limits broken": Level.BAD,
}
_IDENTIFIED = 50.0
"""Predicted standard deviation in percent below which a parameter counts as identifiable."""
_AT_BOUND = 0.99
"""Used share from which a limit counts as one that the design is held by."""
_SCALINGS = {"si": "SI units", "nominal": "nominal scaling"}


def design_report(folder: RunFolder) -> StageReport:
    """Return what is to be said of the design in a folder."""
    record = DesignRecord.load(folder.path)
    facts = _facts(record)
    sensitivity = design_sensitivity(record)
    blocks: tuple[Block, ...] = (
        Facts((*_details(folder, record), *_costliest(sensitivity))),
        TableBlock(limits_table(record)),
        *_gains(sensitivity),
        *folder.figures(*FIGURES[:5]),
        TableBlock(parameters_table(record)),
        *folder.figures("precision", "eigenvalues"),
        TableBlock(_starts_table(folder)),
        *folder.figures("convergence"),
    )
    summary = record.summary
    return StageReport(
        _verdict(folder, record),
        facts,
        (Section("design", "Design", blocks),),
        summary.warnings,
    )


def used_shares(record: DesignRecord) -> dict[str, float]:
    """Return how much of each limit the design uses, 1 at the bound."""
    definitions = limit_definitions()
    return {
        check.key: definitions[check.key].share_used(check.value, check.bound, check.violation)
        for check in record.checks
        if check.key in definitions
    }


def limits_table(record: DesignRecord) -> ReportTable:
    """Return the worst moment of every limit."""
    shares = used_shares(record)
    rows: list[tuple[Value, ...]] = []
    for check in record.checks:
        unit = handy_unit(check.unit, [check.value, check.bound])
        definition = limit_definitions().get(check.key)
        rows.append(
            (
                definition.title if definition else check.key,
                check.row or "–",
                unit.factor * check.value,
                unit.factor * check.bound,
                unit.symbol or "–",
                100 * shares[check.key] if check.key in shares else None,
                check.time,
            )
        )
    columns = (
        Column("limit", kind="text"),
        Column("where", kind="text"),
        Column("worst"),
        Column("bound"),
        Column("unit", kind="text"),
        Column("used", "%"),
        Column("time", "s"),
    )
    return ReportTable.of(
        "limits",
        "Worst moment of every limit over the whole period, unsmoothed model",
        columns,
        rows,
    )


def parameters_table(record: DesignRecord) -> ReportTable:
    """Return nominal parameters with their predicted standard deviations."""
    found = record.precision
    rows = list(
        zip(
            found.names,
            found.units,
            found.nominal.tolist(),
            found.per_period.tolist(),
            found.percent_per_period.tolist(),
            found.experiment.tolist(),
            found.percent_experiment.tolist(),
            strict=True,
        )
    )
    columns = (
        Column("parameter", kind="parameter"),
        Column("unit", kind="text"),
        Column("nominal"),
        Column("σ, one period", digits=3),
        Column("σ, one period", "%", digits=3),
        Column("σ, experiment", digits=3),
        Column("σ, experiment", "%", digits=3),
    )
    summary = record.summary
    caption = (
        f"Nominal parameters and predicted standard deviations σ: over {summary.samples} samples "
        f"of one period, and over {readable(summary.experiment_periods)} periods with "
        f"{summary.experiment_samples} samples; percent of the nominal value"
    )
    return ReportTable.of("parameters", caption, columns, rows)


def _starts_table(folder: RunFolder) -> ReportTable:
    table = Table.read(
        folder.table_file("starts"),
        [
            "start",
            "kind",
            "criterion_value",
            "finished_value",
            "iterations",
            "converged",
            "status",
            "best",
        ],
    )
    rows = list(
        zip(
            table.numbers("start").tolist(),
            table.columns["kind"],
            table.numbers("criterion_value", blank=True).tolist(),
            table.numbers("finished_value", blank=True).tolist(),
            table.numbers("iterations").tolist(),
            table.columns["status"],
            [cell == "True" for cell in table.columns["best"]],
            strict=True,
        )
    )
    columns = (
        Column("start"),
        Column("kind", kind="text"),
        Column("criterion", digits=6),
        Column("finished", digits=6),
        Column("iterations"),
        Column("how it ended", kind="text"),
        Column("best", kind="text"),
    )
    return ReportTable.of("starts", "All starts of the search", columns, rows, folded=True)


def _verdict(folder: RunFolder, record: DesignRecord) -> Verdict:
    summary = record.summary
    document = folder.document("design")
    told = document.optional("status_text") or ""
    level = _LEVELS.get(summary.status, Level.NEUTRAL)
    held = [
        limit_definitions()[key].title
        for key, share in used_shares(record).items()
        if share >= _AT_BOUND
    ]
    sentence = (
        f"Trajectory of {summary.harmonics} harmonics with a period of "
        f"{readable(2 * np.pi / summary.omega)} s."
    )
    if summary.status == "limits broken":
        broken = [check.key for check in record.checks if check.violation > 0]
        sentence += f" It breaks {', '.join(broken) or 'a limit'}."
    elif summary.status == "interrupted":
        sentence += " The search was interrupted: this is the best found until then."
    else:
        sentence += " Every limit is kept over the whole period, checked anew between the samples."
    if held:
        sentence += f" It is held by {', '.join(held)}."
    if summary.status == "not converged" and isinstance(told, str) and told:
        sentence += f" Best start: {told}."
    return Verdict("Design", level, summary.status, sentence, "design")


def _facts(record: DesignRecord) -> tuple[Fact, ...]:
    summary, precision = record.summary, record.precision
    criterion = criteria_by_key().get(summary.criterion)
    relative = precision.percent_experiment[np.isfinite(precision.percent_experiment)]
    value = "singular" if summary.criterion_value is None else readable(summary.criterion_value, 6)
    facts = [
        Fact(
            criterion.title if criterion else summary.criterion,
            value,
            f"one period, {summary.samples} samples, {_SCALINGS.get(summary.scaling, '')}",
        )
    ]
    if relative.size:
        facts.append(
            Fact(
                "parameters identifiable",
                f"{int(np.sum(relative < _IDENTIFIED))} of {relative.size}",
                f"predicted σ below half of the value; median {readable(np.median(relative), 3)} %",
            )
        )
    shares = used_shares(record)
    if shares:
        key = max(shares, key=lambda name: shares[name])
        title = limit_definitions()[key].title
        facts.append(Fact("tightest limit", percent(shares[key], 4), f"used of {title}"))
    return tuple(facts)


def _details(folder: RunFolder, record: DesignRecord) -> tuple[Fact, ...]:
    summary = record.summary
    solver = folder.document("design").section("solver")
    seconds, iterations = solver.optional("seconds"), solver.optional("iterations")
    facts = [
        Fact("base frequency", f"{readable(summary.omega / (2 * np.pi))} Hz"),
        Fact(
            "period",
            f"{readable(2 * np.pi / summary.omega)} s",
            f"{readable(summary.samples_per_period, 6)} controller steps",
        ),
        Fact("harmonics", str(summary.harmonics)),
    ]
    if summary.log_det_information is not None:
        facts.append(Fact("log det F", readable(summary.log_det_information, 6), "SI units"))
    if isinstance(seconds, int | float) and isinstance(iterations, int):
        facts.append(Fact("search", duration(seconds), f"{iterations} iterations"))
    return tuple(facts)


def _costliest(sensitivity: LimitSensitivity | None) -> tuple[Fact, ...]:
    key = None if sensitivity is None else costliest(sensitivity)
    if sensitivity is None or key is None:
        return ()
    gain = f"+{readable(100 * sensitivity.gains[key], 2)} %"
    return (Fact("costliest limit", gain, f"10 % more {limit_title(key)}"),)


def _gains(sensitivity: LimitSensitivity | None) -> tuple[Block, ...]:
    if sensitivity is None:
        return ()
    if sensitivity.unexplained > EXPLAINED:
        text = (
            f"The limits leave {percent(sensitivity.unexplained)} of the cost's gradient: the "
            "design is not near an optimum, and what each limit costs is not told."
        )
        return (TextBlock((text,)),)
    return (TableBlock(gains_table({"gain": sensitivity}, "the design itself")),)
