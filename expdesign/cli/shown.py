"""What each stage's command prints of its result: a function named as the stage."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.table import Table

from expdesign.cli.output import note, results, say
from expdesign.cli.result_lines import (
    concise,
    printed_choice,
    printed_findings,
    printed_place,
    printed_verdict,
    result_table,
)
from expdesign.stages.outcome import Outcome, short

if TYPE_CHECKING:
    from estimation.identification.record import EstimateRecord


def design(outcome: Outcome) -> None:
    """Print how the design ended, with the value of its own criterion first, and its limits."""
    from constraints import limit_definitions
    from expdesign.configuration import quantity_text
    from expdesign.information.criteria import CRITERIA, OF_A_CHANGE

    result = outcome.result
    section = result.configuration.run.design
    criterion = CRITERIA[section.criterion]
    scaling = {"si": "SI units", "nominal": "nominal scaling"}[section.scaling]
    value = f"{criterion.named(section.information)} = {result.criterion_value:.7g}"
    if not criterion.invariant:
        log_det = CRITERIA["d"].named(section.information)
        value += f" ({scaling}), {log_det} = {result.log_det_information:.7g}"
    hop = result.solver.best_start - section.starts
    say(
        f"{result.name}: {result.status} in {result.solver.seconds:.0f} s. {value} over "
        f"{result.samples} samples of one period of {result.trajectory.period:.4f} s, from start "
        f"{result.solver.best_start}{f', hop {hop}' if hop > 0 else ''}. The search: "
        f"{result.solver.ended}."
    )
    if section.prior is not None:
        say(f"{OF_A_CHANGE}.")
    known = limit_definitions()
    kept = any(check.reserve for check in result.check.limits)
    rows = [
        (
            check.key,
            check.row,
            quantity_text(check.value, check.unit, 5),
            *([quantity_text(check.stated, check.unit, 5)] if kept else []),
            *([f"{100 * check.reserve:.4g} %"] if kept else []),
            quantity_text(check.bound, check.unit, 5),
            f"{100 * known[check.key].share_used(check.value, check.bound, check.violation):.1f} %",
            f"{-100 * check.proved:.2g} %" if check.certified else "not proved",
        )
        for check in result.check.limits
    ]
    title = "Limits at every instant of the period (left: proved, of the range)"
    reserved = ("stated", "reserve") if kept else ()
    heads, left = (
        ("limit", "where", "worst", *reserved, "bound", "used", "left"),
        ("limit", "where"),
    )
    table = result_table(title, heads, rows, left, no_wrap=True)
    table.box, table.pad_edge, table.show_edge = box.SIMPLE_HEAD, False, False
    results().print(table)
    printed_place(outcome)


def experiment(outcome: Outcome) -> None:
    """Print what was measured, and with which disturbances."""
    truth, repetitions = outcome.result.truth, outcome.summary["repetitions"]
    section = truth.experiment
    times = "" if repetitions == 1 else f", {repetitions} times"
    say(
        f"{truth.name}: {section.periods} periods of {truth.design.period:.4f} s measured at "
        f"{section.sampling:g} Hz{times}: {section.samples} samples, "
        f"{section.samples_per_period:.6g} per period."
    )
    if truth.table is not None:
        say(
            f"executed: {truth.table.file} ({truth.table.format}), measured from "
            f"{truth.table.window[0]:.4f} s after its start; struts within "
            f"{1e6 * truth.table.position_error:.2g} µm of the design"
        )
    if truth.machine is not None:
        say(f"measured: {truth.machine.name} of experiment.truth, not the run's robot")
    named = ", ".join(truth.disturbances.active) or "none"
    say(f"noise as the robot states it, {truth.memory}; disturbances: {named}")
    printed_place(outcome)


def noise(outcome: Outcome) -> None:
    """Print size and correlation of the noise, and what was found about it."""
    from estimation.diagnostics.noise_result import correlation_of

    console, record, found = results(), outcome.result, outcome.record.summary
    parts = (
        f"{record.periods:.6g} periods of {record.period:.6g} s (from the {record.source.value})"
    )
    if found.at_rest:
        parts = f"at rest, compared in {record.periods:.6g} parts of {record.period:.4g} s"
    say(f"{record.rows} rows, {parts}")
    for title, covariance, factor, unit in (
        ("forces", found.force_covariance, 1.0, "N"),
        ("lengths", found.length_covariance, 1e3, "mm"),
    ):
        std = np.sqrt(np.diag(covariance))
        struts = [str(number) for number in range(1, len(std) + 1)]
        rows = [
            (strut, f"{factor * size:.4g}", *(f"{cell:.3f}" for cell in row))
            for strut, size, row in zip(struts, std, correlation_of(covariance), strict=True)
        ]
        heading = f"Noise of the {title}: standard deviation [{unit}] and correlation"
        console.print(result_table(heading, ("strut", "std", *struts), rows, ("strut",)))
    printed_findings(found.findings, outcomes=True)
    console.print(f"\n{outcome.record.block}", markup=False, highlight=False, soft_wrap=True)
    printed_place(outcome)
    if not record.averaged:
        note(
            "a period is no whole number of samples: the noise is what a Fourier series of the "
            "motion leaves, not what differs between periods"
        )


def montecarlo(outcome: Outcome) -> None:
    """Print bias, spread and coverage of each estimator over all parameters."""
    console, study = results(), outcome.result
    experiment = study.settings["experiment"]
    say(
        f"{study.name}: {study.counts.done} repetitions of "
        f"{experiment['periods']} periods at {experiment['sampling']:g} Hz; "
        f"{len(study.identified)} of {len(study.parameters)} parameters are identified"
    )
    rows = []
    for name, found in study.estimators.items():
        pooled = found.pooled
        cells = ["", "", ""]
        if pooled is not None:
            cells = [
                f"{pooled.rmse_over_bound:.3g} [{pooled.rmse_over_bound_low:.3g}, "
                f"{pooled.rmse_over_bound_high:.3g}]",
                f"{100 * pooled.coverage:.1f} [{100 * pooled.coverage_low:.1f}, "
                f"{100 * pooled.coverage_high:.1f}]",
                f"{pooled.largest_bias_t:.1f}",
            ]
        rows.append((name.upper(), str(found.estimates), *cells))
    title = "In brackets 95 % intervals; bias in its standard errors"
    heads = ("estimator", "estimates", "RMSE / bound", "coverage (%)", "largest bias")
    console.print(result_table(title, heads, rows, ("estimator",)))
    printed_place(outcome)


def estimate(outcome: Outcome) -> None:
    """Print the recordings, the estimates with their standard deviations, and the verdict."""
    from estimation.uncertainty.intervals import with_error

    console = results()
    result, diagnosis = outcome.result
    for record in result.records:
        data = record.experiment.record
        harmonics = "pointwise" if record.harmonics is None else f"{record.harmonics} harmonics"
        if record.harmonics_of_forces != record.harmonics:
            harmonics += f" ({record.harmonics_of_forces} with the forces)"
        say(
            f"{short(Path(record.source)) if record.source else 'data'}: {data.rows} rows, "
            f"{data.periods:.6g} periods of {data.period:.6g} s (from the {data.source.value}), "
            f"{harmonics}, noise {record.experiment.noise.source}"
        )
    if result.selection is not None:
        printed_choice(result.selection)
    by_place = {(row.estimator, row.parameter): row for row in result.rows}
    rows = []
    for parameter in result.knowledge.names:
        found = [by_place[name, parameter] for name in result.estimates]
        values = (concise(row.value, row.std) for row in found)
        rows.append((parameter, *values, f"{found[0].a_priori:.5g}", found[0].unit))
    title = "Estimates (in brackets the standard deviation of the last digits)"
    heads = ("parameter", *(name.upper() for name in result.estimates), "a priori", "unit")
    console.print(result_table(title, heads, rows, ("parameter", "unit")))
    for row in outcome.record.constants:
        if row.estimator == result.best.estimator:
            say(
                f"{row.constant} = {with_error(row.value, row.std)} {row.unit} (estimated from "
                f"{row.stated:.6g} on)"
            )
    if outcome.record.payload:
        console.print(_payload(outcome.record))
    best = result.best
    for row in result.knowledge.inseparable(result.robot, best.values, best.covariance):
        say(f"{row.combination}: {concise(row.value, row.std)} {row.unit}")
    for combination in result.combinations[result.best.estimator]:
        say(combination.text)
    if (near := outcome.record.summary.best_estimator.consistent) is not None:
        say(near.text)
    if diagnosis is not None:
        printed_verdict(diagnosis.verdict)
    printed_place(outcome)


def _payload(record: EstimateRecord) -> Table:
    by_place = {(row.estimator, row.quantity): row for row in record.payload}
    names = list(record.summary.estimators)
    rows = [
        (
            quantity,
            *(concise(by_place[n, quantity].value, by_place[n, quantity].std) for n in names),
            row.unit,
        )
        for (first, quantity), row in by_place.items()
        if first == names[0]
    ]
    title = (
        "The payload, in the platform frame (in brackets the standard deviation of the last digits)"
    )
    heads = ("quantity", *(name.upper() for name in names), "unit")
    return result_table(title, heads, rows, ("quantity", "unit"))


def validate(outcome: Outcome) -> None:
    """Print how the prediction of each motion compares with the noise."""
    console, record = results(), outcome.record
    rows = [
        (
            row.motion,
            str(row.actuator),
            f"{row.variance_model_error:.1f}",
            f"{row.variance_measurement_error:.1f}",
            f"{row.statistic:.3f}",
            row.verdict,
        )
        for row in record.rows
    ]
    title = "Variance of single samples [N²]: about the prediction, and of the noise"
    heads = ("motion", "actuator", "prediction", "noise", "F", "verdict")
    console.print(result_table(title, heads, rows, ("motion", "verdict")))
    errors = [
        (
            row.motion,
            str(row.actuator),
            f"{row.error:.3g}",
            f"{row.error_low:.3g} … {row.error_high:.3g}",
            f"{100 * row.error / row.range:.2g} %",
            f"{row.tolerance:.3g}" if np.isfinite(row.tolerance) else "",
            row.kept.value,
        )
        for row in record.errors
    ]
    title = "Error of the prediction [N rms], noise taken off"
    sizes = ("motion", "actuator", "error", "95 %", "of the range", "tolerance", "kept")
    console.print(result_table(title, sizes, errors, ("motion", "kept")))
    for motion in record.summary.motions:
        if motion.tolerance_words:
            say(f"{motion.name}: {motion.tolerance_words}")
        printed_verdict(motion.diagnostics.verdict, f"{motion.name}: ")
    printed_place(outcome)


def feedforward(outcome: Outcome) -> None:
    """Print how well the motion is followed with each feed-forward."""
    summary = outcome.record.summary
    rows = [
        (
            each.case,
            f"{1e6 * each.rms_struts:.1f}",
            f"{1e6 * each.max_struts:.1f}",
            f"{1e6 * each.rms_position:.1f}",
            f"{1e6 * each.max_position:.1f}",
            f"{each.rms_feedback:.3g}",
            f"{each.reduction:.3g}",
        )
        for each in summary.cases
    ]
    moved = {"twin": "the digital twin", "drawn": "a machine drawn from the estimate's covariance"}
    title = f"Tracking error [µm] of {moved[summary.machine]}, {summary.motion}"
    heads = ("feed-forward", "struts", "largest", "TCP", "largest", "feedback [N]", "times better")
    results().print(result_table(title, heads, rows, ("feed-forward",)))
    printed_place(outcome)


def sweep(outcome: Outcome) -> None:
    """Print what the designs promise and what they cost, the most precise marked."""
    record = outcome.record
    best = record.most_precise
    rows = []
    for label, one in zip(record.labels, record.designs, strict=True):
        numbers = [
            f"{number:.4g}" if np.isfinite(number) else ""
            for number in (
                one.log_det_information,
                one.median_rel_std_percent,
                one.worst_rel_std_percent,
                one.measuring_time,
                one.cpu_seconds,
            )
        ]
        proved = ("yes" if one.certified else "no") if one.made else ""
        name = f"{label} *" if one is best else label
        rows.append((str(one.number), name, one.status, *numbers, proved))
    heads = ("", "design", "status", "log det", "median", "worst", "measured", "search", "proved")
    title = "Predicted std / nominal value [%], measuring time and processor time of the search [s]"
    results().print(result_table(title, heads, rows, ("design", "status", "proved")))
    if best is not None:
        say(f"* the most precise: {short(outcome.folder / best.folder)}")
    say(f"{outcome.message}; written to {short(outcome.folder)}")


def export(outcome: Outcome) -> None:
    """Print how exact each table is when it is read back, and where they are."""
    tables(outcome)
    say(f"written to {short(outcome.result[0].path.parent)}")


def tables(outcome: Outcome) -> None:
    """Print how exact each controller table is when it is read back."""
    from expdesign.export.read_back import limits_in_words

    for made in outcome.result:
        check, off = made.check, made.check.deviation
        say(
            f"{made.path.name}: {check.rows} rows in {check.duration:.3f} s, read back: struts "
            f"within {1e6 * off.position:.3g} µm and {1e3 * off.velocity:.3g} mm/s of the design, "
            f"{limits_in_words(check.certificate)}"
        )


def report(outcome: Outcome) -> None:
    """Print where the report is."""
    say(f"report: {short(outcome.result)}")
