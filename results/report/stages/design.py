"""What a report says of a design."""

from __future__ import annotations

import numpy as np

from expdesign.experiment import DesignRecord
from expdesign.experiment.identifiable import IDENTIFIABLE
from expdesign.experiment.sensitivity import LimitSensitivity
from expdesign.information.catalogue import criteria_by_key
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
    costliest_fact,
    design_sensitivity,
    gains_table,
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
_AT_BOUND = 0.99
"""Used share from which a limit counts as one that the design is held by."""
_SCALINGS = {"si": "SI units", "nominal": "nominal scaling"}


def design_report(folder: RunFolder) -> StageReport:
    """Return what is to be said of the design in a folder."""
    record = folder.record(DesignRecord)
    facts = _facts(record)
    sensitivity = design_sensitivity(record)
    cost = None if sensitivity is None else costliest_fact(sensitivity)
    blocks: tuple[Block, ...] = (
        Facts((*_details(record), *([] if cost is None else [cost]))),
        TableBlock(limits_table(record)),
        *_gains(sensitivity),
        *folder.figures(*FIGURES[:5]),
        TableBlock(parameters_table(record)),
        *folder.figures("precision", "eigenvalues"),
        TableBlock(_starts_table(record)),
        *folder.figures("convergence"),
    )
    summary = record.summary
    return StageReport(
        _verdict(record),
        facts,
        (Section("design", "Design", blocks),),
        summary.warnings,
    )


def limits_table(record: DesignRecord) -> ReportTable:
    """Return the worst moment of every limit."""
    rows: list[tuple[Value, ...]] = []
    for check in record.checks:
        unit = handy_unit(check.unit, [check.value, check.bound])
        rows.append(
            (
                check.title,
                check.row or "–",
                unit.factor * check.value,
                unit.factor * check.bound,
                unit.symbol or "–",
                100 * check.used,
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
    rows = [
        (
            parameter.name,
            parameter.unit,
            parameter.nominal,
            parameter.std_per_period,
            parameter.rel_std_percent_per_period,
            parameter.std_experiment,
            parameter.rel_std_percent_experiment,
        )
        for parameter in record.parameters
    ]
    columns = (
        Column("parameter", kind="parameter"),
        Column("unit", kind="text"),
        Column("nominal"),
        Column("σ, one period", digits=3),
        Column("σ, one period", "%", digits=3),
        Column("σ, experiment", digits=3),
        Column("σ, experiment", "%", digits=3),
    )
    experiment = record.summary.predicted_std.experiment
    caption = (
        f"Nominal parameters and predicted standard deviations σ: over {record.summary.samples} "
        f"samples of one period, and over {readable(experiment.periods)} periods with "
        f"{experiment.samples} samples; percent of the nominal value"
    )
    return ReportTable.of("parameters", caption, columns, rows)


def _starts_table(record: DesignRecord) -> ReportTable:
    rows = [
        (
            start.index,
            start.kind,
            start.criterion_value,
            start.finished_value,
            start.iterations,
            start.status,
            start.best,
        )
        for start in record.summary.solver.starts
    ]
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


def _verdict(record: DesignRecord) -> Verdict:
    summary = record.summary
    level = _LEVELS.get(summary.status, Level.NEUTRAL)
    held = [check.title for check in record.checks if check.used >= _AT_BOUND]
    sentence = (
        f"Trajectory of {summary.harmonics} harmonics with a period of "
        f"{readable(2 * np.pi / summary.omega)} s."
    )
    if summary.status == "limits broken":
        broken = [check.key for check in record.checks if not check.kept]
        sentence += f" It breaks {', '.join(broken) or 'a limit'}."
    elif summary.status == "interrupted":
        sentence += " The search was interrupted: this is the best found until then."
    else:
        sentence += " Every limit is kept over the whole period, checked anew between the samples."
    if held:
        sentence += f" It is held by {', '.join(held)}."
    if summary.status == "not converged":
        sentence += f" Best start: {summary.status_text}."
    return Verdict("Design", level, summary.status, sentence, "design")


def _facts(record: DesignRecord) -> tuple[Fact, ...]:
    summary = record.summary
    criterion = criteria_by_key().get(summary.criterion)
    percents = np.array([parameter.rel_std_percent_experiment for parameter in record.parameters])
    relative = percents[np.isfinite(percents)]
    finite = np.isfinite(summary.criterion_value)
    value = readable(summary.criterion_value, 6) if finite else "singular"
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
                f"{int(np.sum(relative < 100 * IDENTIFIABLE))} of {relative.size}",
                f"predicted σ below half of the value; median {readable(np.median(relative), 3)} %",
            )
        )
    if record.checks:
        tightest = max(record.checks, key=lambda check: check.used)
        used = percent(tightest.used, 4)
        facts.append(Fact("tightest limit", used, f"used of {tightest.title}"))
    return tuple(facts)


def _details(record: DesignRecord) -> tuple[Fact, ...]:
    summary, solver = record.summary, record.summary.solver
    facts = [
        Fact("base frequency", f"{readable(summary.omega / (2 * np.pi))} Hz"),
        Fact(
            "period",
            f"{readable(2 * np.pi / summary.omega)} s",
            f"{readable(summary.samples_per_period, 6)} controller steps",
        ),
        Fact("harmonics", str(summary.harmonics)),
    ]
    if np.isfinite(summary.log_det_information):
        facts.append(Fact("log det F", readable(summary.log_det_information, 6), "SI units"))
    facts.append(Fact("search", duration(solver.seconds), f"{solver.iterations} iterations"))
    return tuple(facts)


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
