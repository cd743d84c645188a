"""What a report says of a design."""

from __future__ import annotations

import numpy as np

from expdesign.configuration.open_rows import held_in_words
from expdesign.experiment import DesignResult
from expdesign.experiment.sensitivity import LimitSensitivity
from expdesign.information.criteria import CRITERIA, OF_A_CHANGE
from expdesign.information.identifiable import IDENTIFIABLE
from expdesign.recheck.limit_check import REACHED, LimitCheck
from results.figures.design import DESIGN_FIGURES
from results.notation import DisplayUnit, duration, handy_unit, percent, readable
from results.views.folder import RunFolder
from results.views.limit_gains import (
    EXPLAINED,
    costliest_fact,
    design_sensitivity,
    gains_table,
    reserve_in_words,
)
from results.views.parameter_blocks import combination_blocks
from results.views.view import (
    Block,
    Fact,
    Facts,
    Level,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
)

_LEVELS = {
    "converged": Level.GOOD,
    "not converged": Level.CAUTION,
    "interrupted": Level.BAD,
    "limits broken": Level.BAD,
}
_SCALINGS = {"si": "SI units", "nominal": "nominal scaling"}


def design_report(folder: RunFolder) -> StageView:
    """Return what is to be said of the design in a folder."""
    record = folder.record(DesignResult)
    sensitivity = design_sensitivity(record)
    cost = None if sensitivity is None else costliest_fact(sensitivity)
    blocks: tuple[Block, ...] = (
        Facts((*_details(record), *([] if cost is None else [cost]))),
        *([TextBlock(f"{OF_A_CHANGE}.")] if record.configuration.run.design.prior else []),
        limits_table(record),
        *_reserve(record, sensitivity),
        *_gains(sensitivity),
        *folder.figures(*DESIGN_FIGURES[:5]),
        parameters_table(record),
        *combination_blocks("design_combinations", record.base_parameters, record.parameter_names),
        *folder.figures(*DESIGN_FIGURES[5:7]),
        _starts_table(record),
        *folder.figures(*DESIGN_FIGURES[7:]),
    )
    return StageView(_verdict(record), blocks, _facts(record), record.warnings)


def limits_table(record: DesignResult) -> ReportTable:
    """Return the worst moment of every limit."""

    def unit(check: LimitCheck) -> DisplayUnit:
        return handy_unit(check.unit, [check.value, check.bound])

    kept = any(check.reserve for check in record.checks)
    reserved = (
        TableColumn("stated", of=lambda check: unit(check).factor * check.stated),
        TableColumn("reserve", "%", digits=3, of="reserve", factor=100),
    )
    # Earlier versions sampled, and proved nothing.
    certified = all(check.certified for check in record.checks)
    proved = (
        () if _sampled(record) else (TableColumn("left", "%", digits=3, of="proved", factor=-100),)
    )
    columns = (
        TableColumn("limit", kind="text", of="title"),
        TableColumn("where", kind="text", of=lambda check: check.row or "–"),
        TableColumn("worst", of=lambda check: unit(check).factor * check.value),
        TableColumn("bound", of=lambda check: unit(check).factor * check.bound),
        *(reserved if kept else ()),
        TableColumn("unit", kind="text", of=lambda check: unit(check).symbol or "–"),
        TableColumn("used", "%", of="used", factor=100),
        *proved,
        TableColumn("time", "s", of="time"),
    )
    caption = "Worst moment of every limit over the whole period, unsmoothed model"
    if proved:
        caption += "; left: what of the range is proved to be left at every instant"
    if proved and not certified:
        open_time = max(check.open_time for check in record.checks)
        caption += f", where it is not below zero: {open_time:.3g} s are not proved"
    if kept:
        caption += "; the bounds are the stated ones, drawn in by the reserve"
    held = [f". {text[:1].upper()}{text[1:]}" for text in held_in_words(record.configuration.robot)]
    return ReportTable.of("limits", f"{caption}{''.join(held)}", columns, record.checks)


def _sampled(record: DesignResult) -> bool:
    """Return whether the limits were only looked at on a grid, as earlier versions did."""
    return all(np.isnan(check.proved) for check in record.checks)


def parameters_table(record: DesignResult) -> ReportTable:
    """Return nominal parameters with their predicted standard deviations."""
    shared = record.predicted_std.systematic
    columns = (
        TableColumn("parameter", kind="parameter", of="name"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("nominal", of="nominal"),
        TableColumn("σ, one period", digits=3, of="std_per_period"),
        TableColumn("σ, one period", "%", digits=3, of="rel_std_percent_per_period"),
        TableColumn("σ, experiment", digits=3, of="std_experiment"),
        TableColumn("σ, experiment", "%", digits=3, of="rel_std_percent_experiment"),
        *([TableColumn("σ, tolerances", digits=3, of="std_systematic")] if shared else []),
    )
    experiment = record.predicted_std.experiment
    caption = (
        f"Nominal parameters and predicted standard deviations σ: over {record.samples} "
        f"samples of one period, and over {readable(experiment.periods)} periods with "
        f"{experiment.samples} samples; percent of the nominal value"
        f"{_TOLERANCES if shared else ''}"
    )
    return ReportTable.of("parameters", caption, columns, record.parameters)


_TOLERANCES = (
    "; what the robot's tolerances make comes on top of either, and more periods do not reduce it"
)


def _starts_table(record: DesignResult) -> ReportTable:
    columns = (
        TableColumn("start", of="index"),
        TableColumn("kind", kind="text", of="kind"),
        TableColumn("criterion", digits=6, of="criterion_value"),
        TableColumn("finished", digits=6, of="finished_value"),
        TableColumn("iterations", of="iterations"),
        TableColumn("how it ended", kind="text", of="status"),
        TableColumn("best", kind="text", of="best"),
    )
    starts = record.solver.starts
    return ReportTable.of("starts", "All starts of the search", columns, starts, folded=True)


def _verdict(record: DesignResult) -> StageVerdict:
    summary = record
    level = _LEVELS.get(summary.status, Level.NEUTRAL)
    held = [check.title for check in record.checks if check.used >= REACHED]
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
        left = [check.key for check in record.checks if not check.certified]
        how = "proved for every instant"
        if left:
            how = f"as far as was found; not proved for every instant: {', '.join(left)}"
            if _sampled(record):
                how = "checked anew between the samples"
        sentence += f" Every limit is kept over the whole period, {how}."
    if held:
        sentence += f" It is held by {', '.join(held)}."
    if summary.status == "not converged":
        sentence += f" Best start: {summary.status_text}."
    return StageVerdict("Design", level, summary.status, sentence, "design")


def _facts(record: DesignResult) -> tuple[Fact, ...]:
    summary = record
    criterion = CRITERIA.get(summary.criterion)
    information = record.configuration.run.design.information
    percents = np.array([parameter.rel_std_percent_experiment for parameter in record.parameters])
    relative = percents[np.isfinite(percents)]
    finite = np.isfinite(summary.criterion_value)
    value = readable(summary.criterion_value, 6) if finite else "singular"
    facts = [
        Fact(
            criterion.named(information) if criterion else summary.criterion,
            value,
            f"one period, {summary.samples} samples, {_SCALINGS.get(summary.scaling, '')}",
        )
    ]
    if relative.size:
        note = f"predicted σ below half of the value; median {readable(np.median(relative), 3)} %"
        if zeros := int(np.sum(np.isnan(percents))):
            note += f"; {zeros} others have the value zero in the robot file"
        known = int(np.sum(relative < 100 * IDENTIFIABLE))
        facts.append(Fact("parameters identifiable", f"{known} of {relative.size}", note))
    if record.checks:
        tightest = max(record.checks, key=lambda check: check.used)
        used = percent(tightest.used, 4)
        facts.append(Fact("tightest limit", used, f"used of {tightest.title}"))
    return tuple(facts)


def _details(record: DesignResult) -> tuple[Fact, ...]:
    summary, solver = record, record.solver
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
        log_det = CRITERIA["d"].named(record.configuration.run.design.information)
        facts.append(Fact(log_det, readable(summary.log_det_information, 6), "SI units"))
    facts.append(Fact("search", duration(solver.seconds), f"{solver.iterations} iterations"))
    return tuple(facts)


def _reserve(record: DesignResult, sensitivity: LimitSensitivity | None) -> tuple[Block, ...]:
    reserves = {limit.key: limit.reserve for limit in record.robot.limits}
    text = reserve_in_words(sensitivity, reserves, record.criterion)
    return (TextBlock(text),) if text else ()


def _gains(sensitivity: LimitSensitivity | None) -> tuple[Block, ...]:
    if sensitivity is None:
        return ()
    if sensitivity.unexplained > EXPLAINED:
        text = (
            f"The limits leave {percent(sensitivity.unexplained)} of the cost's gradient: the "
            "design is not near an optimum, and what each limit costs is not shown."
        )
        return (TextBlock(text),)
    return (gains_table({"gain": sensitivity}, "the design itself"),)
