"""View of an estimate: parameters, uncertainty, diagnostics and the noise behind them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import PurePath

import numpy as np

from estimation.identification.result import EstimatedRecording, EstimateFile, EstimationResult
from estimation.twin.truth import Truth
from estimation.uncertainty.forces import (
    CERTIFY_COMMAND,
    SIGMAS,
    force_limit_in_words,
    worst_force,
)
from estimation.uncertainty.intervals import Differences
from expdesign.robot.derived import parameters_of
from results.figures.noise import NOISE_FIGURES
from results.figures.parameters import ESTIMATE_FIGURES
from results.figures.residuals import DIAGNOSTIC_FIGURES
from results.notation import concise, count_text, readable
from results.views.blocks import (
    INTERVAL,
    UNDETECTED,
    budget_blocks,
    consistency_blocks,
    constants_blocks,
    differences_table,
    findings_block,
    first_contradictions,
    information_sentence,
    information_test,
    motor_columns,
    payload_blocks,
    selection_blocks,
    share_columns,
    truth_columns,
    undetected_advice,
    undetected_blocks,
    verdict_level,
)
from results.views.folder import RunFolder
from results.views.noise import shows_noise
from results.views.parameter_blocks import combination_blocks, derived_blocks, symbols_blocks
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
    Value,
    drawings,
)

_TITLE = "Estimate"
_MOST_LINES = 40


def estimate_view(folder: RunFolder) -> StageView:
    """Return the view of the estimate in a folder."""
    result = folder.result(EstimationResult)
    simulated = _truth(folder, result)
    truth, names = None, result.parameters
    if simulated is not None and (simulated.machine or set(names) <= set(simulated.parameters)):
        truth = dict(zip(names, simulated.values_of(names).tolist(), strict=True))
    payload = None if simulated is None else simulated.payload
    blocks = _blocks(folder, result, truth, payload)
    facts = _facts(result, truth)
    return StageView(_verdict(result), blocks, facts, result.warnings, most_lines=_MOST_LINES)


def _truth(folder: RunFolder, result: EstimateFile) -> Truth | None:
    """Return the truth when the estimate is of the folder's simulated experiment."""
    sources = [PurePath(recording.source).name for recording in result.recordings]
    own = folder.has("experiment") and sources == ["measurement.csv"]
    return folder.result(Truth) if own and folder.configuration.run.data.recording is None else None


def estimates_table(result: EstimationResult, truth: Mapping[str, float] | None) -> ReportTable:
    """Return the parameters of the best estimator, with the truth where it is known."""
    best = result.best
    on_page = [
        *share_columns(result),
        *([] if result.diagnostics is None else [UNDETECTED]),
        *INTERVAL,
        TableColumn("σ / a priori", "%", digits=3, of="rel_std_percent"),
        TableColumn("identified", kind="outcome", of=lambda row: "yes" if row.identified else "no"),
        *([] if truth is None else truth_columns(truth, "parameter")),
    ]
    columns = [
        TableColumn("parameter", kind="parameter", of="parameter"),
        TableColumn("unit", kind="text", of="unit"),
        TableColumn("a priori", of="a_priori", wide=True),
        TableColumn("estimate", digits=5, of="value"),
    ]
    uncertainty = ""
    if result.best_estimator.converged:
        columns.append(TableColumn("σ", kind="error", digits=3, of="std"))
        columns += [replace(column, screen=False) for column in on_page]
        uncertainty = " with their uncertainty"
    known = " and the simulated truth" if truth is not None else ""
    caption = f"Parameters of the {best.upper()} estimate{uncertainty}{known}"
    rows = result.by_estimator()[best]
    return ReportTable.of("estimates", caption, columns, rows, screen=True, latex=True)


def _estimators_table(result: EstimationResult) -> ReportTable:
    tables = result.by_estimator()
    first = next(iter(tables.values()))
    columns = [
        TableColumn("parameter", kind="parameter", of=[row.parameter for row in first]),
        TableColumn("unit", kind="text", of=[row.unit for row in first]),
        TableColumn("a priori", digits=5, of=[row.a_priori for row in first]),
    ]
    for key, rows in tables.items():
        columns.append(TableColumn(key.upper(), digits=5, of=[row.value for row in rows]))
        if result.estimators[key].converged:
            stds = [row.std for row in rows]
            columns.append(TableColumn("σ", kind="error", digits=3, of=stds))
    caption = "All estimators with their standard deviations"
    return ReportTable.of("estimators", caption, columns, folded=True, latex=True)


def _blocks(
    folder: RunFolder,
    result: EstimationResult,
    truth: Mapping[str, float] | None,
    payload: Mapping[str, float] | None,
) -> tuple[Block, ...]:
    blocks: list[Block] = [Facts(_details(folder, result), screen=True)]
    if not result.intervals_cover:
        blocks.append(TextBlock(result.intervals_note, Level.CAUTION, screen=True))
    if result.best_estimator.converged:
        blocks += _parameter_blocks(result, truth, payload)
        blocks += drawings(ESTIMATE_FIGURES, result)
    else:
        blocks.append(estimates_table(result, truth))
    test = information_test(result) if result.best_estimator.converged else None
    if test is not None:
        disturbed = isinstance(test, Differences) and test.differ
        sentence = f"{information_sentence(test)}."
        blocks.append(TextBlock(sentence, Level.CAUTION if disturbed else Level.NEUTRAL))
    if isinstance(test, Differences) and (test.freedom or test.differ):
        caption = "ML − GM against the covariance that errors of the same data give this difference"
        blocks.append(differences_table("hausman", caption, result.parameters, test, folded=True))
    if result.diagnostics is not None:
        effects, findings = result.diagnostics.undetected, result.diagnostics.verdict.findings
        rows = result.by_estimator()[result.best]
        advice = undetected_advice(effects, rows)
        blocks.append(
            findings_block("findings", findings, "the estimate", again="estimate", advice=advice)
        )
        blocks += undetected_blocks(effects, rows)
    blocks += drawings(DIAGNOSTIC_FIGURES, result.diagnoses, numbered=True)
    if not shows_noise(folder):
        blocks += drawings(NOISE_FIGURES, result.diagnoses, numbered=True)
    blocks.append(_noise_table(result, folder.torque_per_force))
    return tuple(blocks)


def _parameter_blocks(
    result: EstimationResult,
    truth: Mapping[str, float] | None,
    payload: Mapping[str, float] | None,
) -> list[Block]:
    blocks: list[Block] = payload_blocks(result, payload)
    name = result.best.upper()
    derived, names = result.best_estimator.derived, result.parameters
    brief = len(names) > _MOST_LISTED
    blocks += derived_blocks("estimate_derived", derived, f"of the {name} estimate", brief=brief)
    seen = parameters_of({row.quantity for row in derived}) if brief else ()
    rows = frozenset(k for k, own in enumerate(names) if own in seen)
    blocks += [
        replace(estimates_table(result, truth), left_out=rows),
        *symbols_blocks(names, screen=True, left_out=seen),
    ]
    if len(result.estimators) > 1:
        blocks.append(_estimators_table(result))
    blocks += constants_blocks(result)
    blocks += selection_blocks(result)
    blocks += budget_blocks(result)
    if inseparable := result.best_estimator.inseparable:
        sums = "; ".join(
            f"{row.combination} = {concise(row.value, row.std)} {row.unit}" for row in inseparable
        )
        text = f"No motion separates these parameters, their sums are estimated: {sums}."
        blocks.append(TextBlock(text, screen=True))
    together = result.best_estimator.base_parameters
    free = {*result.parameters} - {*result.fixed}
    blocks += combination_blocks("estimate_combinations", together, free, most=0 if brief else 4)
    blocks += consistency_blocks(result)
    return blocks


_MOST_LISTED = 24
"""Largest number of parameters of which a screen lists those that derived quantities show, too."""


def _noise_table(result: EstimateFile, torque_per_force: float | None) -> ReportTable:
    motors = motor_columns(torque_per_force, {"force noise σ": ""})
    rows: list[tuple[Value, ...]] = []
    for number, recording in enumerate(result.recordings, start=1):
        noise = recording.noise
        force = np.sqrt(np.diag(noise.force_covariance)).tolist()
        length = (1e3 * np.sqrt(np.diag(noise.length_covariance))).tolist()
        rows += [
            (number, j + 1, force[j], *[force[j]] * len(motors), length[j], noise.source)
            for j in range(len(force))
        ]
    columns = (
        TableColumn("recording"),
        TableColumn("strut"),
        TableColumn("force noise σ", "N"),
        *motors,
        TableColumn("length noise σ", "mm"),
        TableColumn("source", kind="text"),
    )
    noises = (recording.noise for recording in result.recordings)
    spectra = dict.fromkeys(
        f"spectrum of the forces {n.force_spectrum}, of the lengths {n.length_spectrum}"
        for n in noises
        if n.force_spectrum
    )
    caption = "; ".join(("Noise of one sample that the data were weighted with", *spectra))
    return ReportTable.of("noise", caption, columns, rows, folded=True)


def _verdict(result: EstimateFile) -> StageVerdict:
    name = result.best.upper()
    begin = f"{name} from {count_text(len(result.recordings), 'recording')}"
    estimator = result.best_estimator
    if not estimator.converged:
        sentence = f"{begin}; the estimator did not converge: {estimator.status}."
        return StageVerdict(_TITLE, Level.BAD, "not converged", sentence, "estimate")
    if result.diagnostics is None:
        reason = "the diagnostics were not made"
        if not result.intervals_cover:
            reason = result.intervals_note
        return StageVerdict(_TITLE, Level.CAUTION, "not judged", f"{begin}; {reason}.", "estimate")
    verdict = result.diagnostics.verdict
    found = first_contradictions(verdict) or verdict.summary.partition(": ")[2] or verdict.summary
    sentence = f"{begin}: {found}."
    return StageVerdict(_TITLE, verdict_level(verdict), verdict.status.value, sentence, "estimate")


def _facts(result: EstimationResult, truth: Mapping[str, float] | None) -> tuple[Fact, ...]:
    best = result.best
    if not result.best_estimator.converged:
        return ()
    rows = [row for row in result.by_estimator()[best] if row.parameter not in result.fixed]
    relative = [row.rel_std_percent for row in rows if np.isfinite(row.rel_std_percent)]
    note = "σ < half of the a-priori size"
    if relative:
        note += f"; median {readable(np.median(relative), 3)} %"
    if result.fixed:
        note += f"; {len(result.fixed)} more are known"
    identified = f"{sum(bool(row.identified) for row in rows)} of {len(rows)}"
    facts = [Fact("parameters identified", identified, note)]
    if truth is not None:
        held = sum(row.ci_low <= truth[row.parameter] <= row.ci_high for row in rows)
        facts.append(
            Fact(
                "intervals that hold the truth",
                f"{held} of {len(rows)}",
                "95 % intervals, simulated experiment",
            )
        )
    return tuple(facts)


def _details(folder: RunFolder, result: EstimateFile) -> tuple[Fact, ...]:
    several = len(result.recordings) > 1
    facts = [
        Fact(
            f"recording {number}" if several else "recording",
            f"{recording.rows} rows",
            f"{_duration(recording)}; {folder.named(recording.source)}",
        )
        for number, recording in enumerate(result.recordings, start=1)
    ]
    if (row := worst_force(result.forces)) is not None:
        note = f"{-row.likely_excess:.3g} N left with {SIGMAS:g} σ, strut {row.actuator}"
        if row.likely_excess > 0:
            note = f"{force_limit_in_words(row)}; {CERTIFY_COMMAND} judges it from rest to rest"
        kept = "exceeded" if row.excess > 0 else "kept" if row.likely_excess <= 0 else "just kept"
        facts.append(Fact("force limit, by this estimate", kept, note))
    return tuple(facts)


def _duration(recording: EstimatedRecording) -> str:
    """Return periods and harmonics of a recording, or the duration of a motion without a period."""
    period = readable(2 * np.pi / recording.omega, 6)
    if recording.knot_spacing is not None:
        knots = readable(recording.knot_spacing, 3)
        return f"a motion of {period} s without a period, a spline with knots every {knots} s"
    text = f"{readable(recording.periods, 6)} periods of {period} s by {recording.period_source}"
    if recording.harmonics is None:
        return text
    together = recording.harmonics_of_forces or recording.harmonics
    alone = f", {recording.harmonics} of them in the lengths"
    text += f", {count_text(together, 'harmonic')}"
    return text + alone * (together > recording.harmonics)
