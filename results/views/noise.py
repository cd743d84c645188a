"""View of a noise analysis: size, correlation, shape and memory of the noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.finding import FindingOutcome
from estimation.diagnostics.noise_result import NoiseResult, correlation_of, covariance_rows
from estimation.diagnostics.noise_tests import Normality, Whiteness
from estimation.identification.result import EstimationResult
from results.figures.noise import NOISE_FIGURES, SPECTRUM_FIGURES
from results.notation import readable
from results.views.blocks import findings_block, motor_columns
from results.views.folder import RunFolder
from results.views.view import (
    Block,
    Fact,
    Facts,
    Level,
    ListingBlock,
    ReportTable,
    StageVerdict,
    StageView,
    TableColumn,
    TextBlock,
    drawings,
)

_MM = 1e3


def shows_noise(folder: RunFolder) -> bool:
    """Return whether the noise figures of a folder are those of its noise analysis.

    Both the analysis and an estimate draw them; with an estimate of another recording they are the
    estimate's.
    """
    if not folder.has("noise"):
        return False
    if not folder.has("estimate"):
        return True
    recordings = folder.result(EstimationResult).recordings
    own = folder.result(NoiseResult).recording
    # The figures of several recordings have numbers, and leave those of the analysis alone.
    return len(recordings) > 1 or any(recording.source == own for recording in recordings)


def noise_view(folder: RunFolder) -> StageView:
    """Return the view of the noise analysis in a folder."""
    noise = folder.result(NoiseResult)
    failed = [finding for finding in noise.findings if finding.outcome is FindingOutcome.FAILS]
    serious = any(finding.serious for finding in failed)
    level = Level.BAD if serious else Level.CAUTION if failed else Level.GOOD
    taken = "of the machine at rest" if noise.at_rest else f"in {readable(noise.periods)} periods"
    sentence = (
        f"{noise.rows} samples {taken}: standard deviation of the "
        f"forces {_range(noise.force_std)} N, of the lengths {_range(_MM * noise.length_std)} mm."
    )
    if failed:
        sentence += f" Failed assumptions: {'; '.join(each.sentence for each in failed)}."
    untested = [
        each.assumption for each in noise.findings if each.outcome is FindingOutcome.NOT_TESTED
    ]
    word = "doubtful" if serious else "conspicuous" if failed else "as assumed"
    if untested:
        sentence += f" Not tested: {', '.join(untested)}."
    if untested and not failed:
        every = len(noise.findings)
        level, word = Level.NEUTRAL, f"{every - len(untested)} of {every} tested"
    shape, memory = noise.normality, noise.whiteness
    torque_per_force = folder.torque_per_force
    motors = motor_columns(torque_per_force, {"σ": noise.force_std})
    blocks: list[Block] = [
        Facts(_details(folder, noise), screen=True),
        _correlation_table("force", "N", 1.0, noise.force_covariance),
        _correlation_table("length", "mm", _MM, noise.length_covariance),
        _channels_table("force", "N", noise.force_std, shape.forces, memory.force_noise, motors),
        _channels_table("length", "mm", _MM * noise.length_std, shape.lengths, memory.length_noise),
    ]
    if not noise.averaged:
        why = noise.whiteness.refused or "The periods are no whole number of samples"
        text = (
            f"{why[0].upper()}{why[1:]}: the noise is the difference from a Fourier series of the "
            "motion, not the difference between periods."
        )
        blocks.append(TextBlock(text, Level.CAUTION, screen=True))
    blocks.append(findings_block("noise_findings", noise.findings, "the noise"))
    if noise.block is not None:
        blocks.append(ListingBlock("Lines for the robot file", noise.block, screen=True))
    if shows_noise(folder):
        blocks += drawings(NOISE_FIGURES, noise)
    blocks += drawings(SPECTRUM_FIGURES, noise)
    blocks.append(_covariance_table(noise))
    return StageView(StageVerdict("Noise", level, word, sentence, "noise"), tuple(blocks))


def _range(std: Array) -> str:
    return f"{readable(np.min(std), 3)} to {readable(np.max(std), 3)}"


def _details(folder: RunFolder, noise: NoiseResult) -> tuple[Fact, ...]:
    freedom = noise.force_freedom
    # With F degrees of freedom a standard deviation is known to 1/√(2F).
    relative = 100 / np.sqrt(2 * freedom) if freedom > 0 else float("nan")
    return (
        Fact("recording", f"{noise.rows} samples", folder.named(noise.recording)),
        Fact("periods", readable(noise.periods)),
        Fact("period", f"{readable(noise.period)} s"),
        Fact(
            "degrees of freedom",
            readable(freedom),
            f"a standard deviation is known to {readable(relative, 2)} %",
        ),
    )


def _channels_table(
    what: str,
    unit: str,
    std: Array,
    shape: Normality | None,
    memory: Whiteness | None,
    motors: Sequence[TableColumn] = (),
) -> ReportTable:
    unknown = [None] * len(std)
    found = None if memory is None else memory.autocorrelation
    largest = None if found is None else found[range(len(std)), np.argmax(np.abs(found), axis=1)]
    columns = (
        TableColumn("strut", of=range(1, len(std) + 1)),
        TableColumn("σ", unit, of=std),
        *motors,
        TableColumn("skewness", digits=2, of=unknown if shape is None else shape.skewness),
        TableColumn("excess kurtosis", digits=2, of=unknown if shape is None else shape.kurtosis),
        TableColumn("outliers", of=unknown if shape is None else shape.outliers),
        TableColumn(
            "largest autocorrelation", digits=2, of=unknown if largest is None else largest
        ),
    )
    caption = f"Noise of one sample of the {what}s: size, shape and memory"
    return ReportTable.of(f"noise_{what}s", caption, columns)


def _correlation_table(what: str, unit: str, factor: float, covariance: Array) -> ReportTable:
    std = np.sqrt(np.diag(covariance))
    correlations = correlation_of(covariance)
    struts = range(1, len(std) + 1)
    columns = (
        TableColumn("strut", of=struts),
        TableColumn("σ", unit, of=factor * std),
        *(TableColumn(str(k), digits=3, of=correlations[:, k - 1]) for k in struts),
    )
    caption = f"Noise of the {what}s: standard deviation and correlation with struts 1 to 6"
    return ReportTable.of(f"noise_correlation_{what}s", caption, columns, screen=True)


def _covariance_table(noise: NoiseResult) -> ReportTable:
    rows = map(astuple, covariance_rows(noise))
    columns = (
        TableColumn("quantity", kind="text"),
        TableColumn("row"),
        TableColumn("column"),
        TableColumn("covariance"),
        TableColumn("its standard error", digits=2),
        TableColumn("correlation", digits=3),
    )
    caption = "Covariances of forces, in N², and of lengths, in m², element by element"
    return ReportTable.of("noise_covariance", caption, columns, rows, folded=True)
