"""What each stage's command prints of its result: a function named as the stage."""

from __future__ import annotations

from collections.abc import Iterable
from math import floor, isnan, log10
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich import box
from rich.table import Table

from expdesign.cli.output import note, results
from expdesign.stages.outcome import Outcome
from expdesign.stages.progress import short

if TYPE_CHECKING:
    from estimation.diagnostics.finding import Finding


def design(outcome: Outcome) -> None:
    """Print how the design ended, with the value of its own criterion first, and its limits."""
    from constraints import limit_definitions
    from expdesign.configuration import quantity_text
    from expdesign.information.criteria import CRITERIA

    result = outcome.result
    section = result.configuration.run.design
    criterion = CRITERIA[section.criterion]
    scaling = {"si": "SI units", "nominal": "nominal scaling"}[section.scaling]
    value = f"{criterion.title} = {result.criterion_value:.7g}"
    if not criterion.invariant:
        value += f" ({scaling}), log det F = {result.log_det_information:.7g}"
    results().print(
        f"{result.configuration.run.name}: {result.status} in {result.seconds:.0f} s. {value} over "
        f"{result.samples} samples of one period of {result.trajectory.period:.4f} s, from start "
        f"{result.search.best.index}.",
        soft_wrap=True,
    )
    limits = Table(
        title="Limits over the whole period (unsmoothed model)",
        title_justify="left",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        show_edge=False,
    )
    for head in ("limit", "where", "worst", "bound", "used"):
        left = head in {"limit", "where"}
        limits.add_column(head, justify="left" if left else "right", no_wrap=True)
    for check in result.check.limits:
        used = limit_definitions()[check.key].share_used(check.value, check.bound, check.violation)
        limits.add_row(
            check.key,
            check.row,
            quantity_text(check.value, check.unit, 5),
            quantity_text(check.bound, check.unit, 5),
            f"{100 * used:.1f} %",
        )
    results().print(limits)
    _place(outcome)


def experiment(outcome: Outcome) -> None:
    """Print what was measured, and with which disturbances."""
    truth, repetitions = outcome.result.truth, outcome.summary["repetitions"]
    section = truth.experiment
    times = "" if repetitions == 1 else f", {repetitions} times"
    console = results()
    console.print(
        f"{truth.name}: {section.periods} periods of {truth.design.period:.4f} s measured at "
        f"{section.sampling:g} Hz{times}: {truth.samples} samples, "
        f"{truth.samples_per_period:.6g} per period."
    )
    if truth.table is not None:
        console.print(
            f"executed: {truth.table.file} ({truth.table.format}), measured from "
            f"{truth.table.window[0]:.4f} s after its start; struts within "
            f"{1e6 * truth.table.position_error:.2g} µm of the design"
        )
    kinds = ("tracking_error", "drift", "cogging", "quantisation", "outliers")
    named = [kind.replace("_", " ") for kind in kinds if getattr(section, kind)]
    console.print(f"noise with full covariances; disturbances: {', '.join(named) or 'none'}")
    _place(outcome)


def noise(outcome: Outcome) -> None:
    """Print size and correlation of the noise, and what was found about it."""
    console, analysis = results(), outcome.result
    record = analysis.record
    console.print(
        f"{record.rows} rows, {record.periods:.6g} periods of {record.period:.6g} s (from the "
        f"{record.source.value})",
        soft_wrap=True,
    )
    for title, covariance, factor, unit in (
        ("forces", analysis.noise.force_covariance, 1.0, "N"),
        ("lengths", analysis.noise.length_covariance, 1e3, "mm"),
    ):
        std = np.sqrt(np.diag(covariance))
        table = Table(
            title=f"Noise of the {title}: standard deviation [{unit}] and correlation",
            title_justify="left",
        )
        table.add_column("strut")
        for head in ("std", *(str(j) for j in range(1, len(std) + 1))):
            table.add_column(head, justify="right")
        for i, row in enumerate(covariance / np.outer(std, std)):
            table.add_row(str(i + 1), f"{factor * std[i]:.4g}", *(f"{cell:.3f}" for cell in row))
        console.print(table)
    for finding in analysis.findings:
        advice = f"; {finding.advice}" if finding.advice else ""
        console.print(
            f"- {finding.assumption}: {finding.outcome.value}. {finding.sentence}{advice}",
            soft_wrap=True,
        )
    _place(outcome)
    if not record.averaged:
        note("periods are no whole number of samples: the scatter is that about a Fourier series")


def montecarlo(outcome: Outcome) -> None:
    """Print bias, spread and coverage of each estimator over all parameters."""
    console, study = results(), outcome.result
    console.print(
        f"{study.configuration.name}: {len(study.repetitions)} repetitions of "
        f"{study.truth.experiment.periods} periods at {study.truth.experiment.sampling:g} Hz; "
        f"{len(study.identified)} of {len(study.free)} parameters are identified"
    )
    table = Table(
        title="In brackets 95 % intervals; bias in its standard errors", title_justify="left"
    )
    table.add_column("estimator")
    for head in ("estimates", "RMSE / bound", "coverage (%)", "largest bias"):
        table.add_column(head, justify="right")
    for name in study.estimators:
        pooled = study.pooled(name)
        cells = ["", "", ""]
        if pooled is not None:
            cells = [
                f"{pooled.rmse_over_bound:.3g} [{pooled.rmse_over_bound_low:.3g}, "
                f"{pooled.rmse_over_bound_high:.3g}]",
                f"{100 * pooled.coverage:.1f} [{100 * pooled.coverage_low:.1f}, "
                f"{100 * pooled.coverage_high:.1f}]",
                f"{pooled.largest_bias_t:.1f}",
            ]
        table.add_row(name.upper(), str(len(study.estimated(name))), *cells)
    console.print(table)
    _place(outcome)


def estimate(outcome: Outcome) -> None:
    """Print the recordings, the estimates with their standard deviations, and the verdict."""
    console = results()
    result, diagnosis = outcome.result
    for record in result.records:
        data = record.experiment.record
        harmonics = "pointwise" if record.harmonics is None else f"{record.harmonics} harmonics"
        console.print(
            f"{short(Path(record.source)) if record.source else 'data'}: {data.rows} rows, "
            f"{data.periods:.6g} periods of {data.period:.6g} s (from the {data.source.value}), "
            f"{harmonics}, noise {record.experiment.noise.source}",
            soft_wrap=True,
        )
    table = Table(
        title="Estimates, in brackets the standard deviation of the last digits",
        title_justify="left",
    )
    table.add_column("parameter")
    for name in result.estimates:
        table.add_column(name.upper(), justify="right")
    table.add_column("a priori", justify="right")
    table.add_column("unit")
    by_place = {(row.estimator, row.parameter): row for row in result.rows}
    for parameter in result.knowledge.names:
        rows = [by_place[name, parameter] for name in result.estimates]
        values = (_concise(row.value, row.std) for row in rows)
        table.add_row(parameter, *values, f"{rows[0].a_priori:.5g}", rows[0].unit)
    console.print(table)
    for combination in result.combinations[result.best.estimator]:
        console.print(combination.text, soft_wrap=True)
    if diagnosis is not None:
        console.print(diagnosis.verdict.summary, soft_wrap=True)
        _findings(diagnosis.verdict.failed)
    _place(outcome)


def validate(outcome: Outcome) -> None:
    """Print how the prediction of each motion compares with the noise."""
    from estimation.validation.record import ValidationRecord

    console, result = results(), outcome.result
    table = Table(
        title="Variance of single samples [N²]: about the prediction, and of the noise",
        title_justify="left",
    )
    for head in ("motion", "actuator", "prediction", "noise", "F", "verdict"):
        table.add_column(head, justify="left" if head in {"motion", "verdict"} else "right")
    for row in ValidationRecord.of(result).rows:
        table.add_row(
            row.motion,
            str(row.actuator),
            f"{row.variance_model_error:.1f}",
            f"{row.variance_measurement_error:.1f}",
            f"{row.statistic:.3f}",
            row.verdict,
        )
    console.print(table)
    for motion in result.motions:
        console.print(f"{motion.name}: {motion.diagnosis.verdict.summary}", soft_wrap=True)
        _findings(motion.diagnosis.verdict.failed)
    _place(outcome)


def study(outcome: Outcome) -> None:
    """Print the claims of a study."""
    table = Table(title="On the digital twin (simulated)", title_justify="left")
    for head in ("what", "found", "paper", "holds"):
        table.add_column(head)
    for claim in outcome.result:
        holds = {True: "yes", False: "no", None: ""}[claim.holds]
        table.add_row(claim.statement, claim.value, claim.paper, holds)
    results().print(table)
    results().print(f"{outcome.message}; written to {short(outcome.folder)}")


def export(outcome: Outcome) -> None:
    """Print how exact each table is when it is read back, and where they are."""
    tables(outcome)
    results().print(f"written to {short(outcome.result[0].path.parent)}")


def tables(outcome: Outcome) -> None:
    """Print how exact each controller table is when it is read back."""
    from expdesign.export.read_back import limits_in_words

    for made in outcome.result:
        check, off = made.check, made.check.deviation
        results().print(
            f"{made.path.name}: {check.rows} rows in {check.duration:.3f} s, read back: struts "
            f"within {1e6 * off.position:.3g} µm and {1e3 * off.velocity:.3g} mm/s of the design, "
            f"{limits_in_words(check.limits)}"
        )


def report(outcome: Outcome) -> None:
    """Print where the report is."""
    results().print(f"report: {short(outcome.result)}", soft_wrap=True)


def _place(outcome: Outcome) -> None:
    results().print(f"written to {short(outcome.folder)}", soft_wrap=True)


def _findings(findings: Iterable[Finding]) -> None:
    for finding in findings:
        advice = f"; {finding.advice}" if finding.advice else ""
        results().print(f"- {finding.sentence}{advice}", soft_wrap=True)


def _concise(value: float, std: float) -> str:
    """Return 1.2345(67) for 1.2345 ± 0.0067."""
    if isnan(std):
        return f"{value:.5g} fixed"
    if not std > 0:
        return f"{value:.6g}"
    digits = 1 - floor(log10(std))
    if digits <= 0:
        return f"{value:.0f}({std:.0f})"
    return f"{value:.{digits}f}({std * 10**digits:.0f})"
