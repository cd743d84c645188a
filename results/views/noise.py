"""What a report says of a simulated recording, and of the noise of any."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.finding import FindingOutcome
from estimation.diagnostics.noise_result import NoiseFile, covariance_rows
from estimation.diagnostics.noise_tests import Normality, Whiteness
from estimation.identification.record import EstimateRecord
from estimation.twin.truth import Truth
from results.figures.noise import NOISE_FIGURES, SPECTRUM_FIGURES
from results.notation import readable
from results.views.findings import failures, findings_table
from results.views.folder import RunFolder
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

_MM = 1e3


def experiment_report(folder: RunFolder) -> StageView:
    """Describe the experiment in a folder."""
    truth = folder.record(Truth)
    experiment = truth.experiment
    disturbances = ", ".join(truth.disturbances.active) or "none"
    table = "" if truth.table is None else truth.table.file
    twin = f"the digital twin executing {table}" if table else "the digital twin"
    if truth.machine is not None:
        twin += f", a machine ({truth.machine.name}) that is not the robot of the run"
    rate, periods = f"{readable(experiment.sampling)} Hz", f"{experiment.periods:g}"
    sentence = (
        f"Simulated on {twin}: {periods} periods measured at {rate}, {experiment.samples} "
        f"samples. Disturbances besides the noise: {disturbances}."
    )
    entry = folder.entry("experiment")
    level, word = Level.NEUTRAL, "simulated"
    if entry is not None and entry.status != "done":
        level, word = Level.BAD, entry.status
    verdict = StageVerdict("Experiment", level, word, sentence, "experiment")
    facts = (Fact("samples", f"{experiment.samples}", f"simulated, {periods} periods"),)
    details = Facts(
        (
            Fact("periods", periods),
            Fact("sampling", rate),
            Fact("period", f"{readable(truth.executed.period)} s"),
            *((Fact("controller table", table),) if table else ()),
            *((Fact("true machine", truth.machine.name),) if truth.machine else ()),
            Fact("disturbances", disturbances),
            Fact("noise", truth.memory),
            Fact("seed", str(truth.seeds.experiment)),
        )
    )
    force, length = (np.sqrt(np.diag(c)) for c in (truth.force_covariance, truth.length_covariance))
    columns = (
        TableColumn("strut", of=range(1, len(force) + 1)),
        TableColumn("force noise σ", "N", of=force),
        TableColumn("length noise σ", "mm", of=length, factor=1e3),
    )
    noise = ReportTable.of("true_noise", "True noise of one sample", columns)
    return StageView(verdict, (details, noise), facts)


def shows_noise(folder: RunFolder) -> bool:
    """Tell whether the noise figures of a folder are those of its noise analysis.

    Both the analysis and an estimate draw them; with an estimate of another recording they are the
    estimate's.
    """
    if not folder.has("noise"):
        return False
    if not folder.has("estimate"):
        return True
    recordings = folder.record(EstimateRecord).summary.recordings
    own = folder.record(NoiseFile).recording
    # The figures of several recordings have numbers, and leave those of the analysis alone.
    return len(recordings) > 1 or any(recording.source == own for recording in recordings)


def noise_report(folder: RunFolder) -> StageView:
    """Describe the noise analysis in a folder."""
    noise = folder.record(NoiseFile)
    failed = [finding for finding in noise.findings if finding.outcome is FindingOutcome.FAILS]
    serious = any(finding.serious for finding in failed)
    level = Level.BAD if serious else Level.CAUTION if failed else Level.GOOD
    sentence = (
        f"{noise.rows} samples {_taken(noise)}: standard deviation of the "
        f"forces {_range(noise.force_std)} N, of the lengths {_range(_MM * noise.length_std)} mm."
    )
    if failed:
        sentence += f" Against what is assumed of it: {'; '.join(failures(failed))}."
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
    blocks: list[Block] = [
        Facts(_details(folder, noise)),
        _channels_table("force", "N", noise.force_std, shape.forces, memory.force_noise),
        _channels_table("length", "mm", _MM * noise.length_std, shape.lengths, memory.length_noise),
    ]
    if not noise.averaged:
        why = noise.whiteness.refused or "The periods are no whole number of samples"
        text = f"{why[0].upper()}{why[1:]}: the scatter is that about a Fourier series."
        blocks.append(TextBlock(text, Level.CAUTION))
    blocks.append(findings_table("noise_findings", noise.findings, "the noise"))
    if shows_noise(folder):
        blocks += folder.figures(*NOISE_FIGURES)
    blocks += folder.figures(*SPECTRUM_FIGURES)
    blocks.append(_covariance_table(noise))
    return StageView(StageVerdict("Noise", level, word, sentence, "noise"), tuple(blocks))


def _taken(noise: NoiseFile) -> str:
    if noise.at_rest:
        return "of the machine at rest"
    return f"in {readable(noise.periods)} periods"


def _range(std: Array) -> str:
    return f"{readable(np.min(std), 3)} to {readable(np.max(std), 3)}"


def _details(folder: RunFolder, noise: NoiseFile) -> tuple[Fact, ...]:
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
    what: str, unit: str, std: Array, shape: Normality | None, memory: Whiteness | None
) -> ReportTable:
    unknown = [None] * len(std)
    found = None if memory is None else memory.autocorrelation
    largest = None if found is None else found[range(len(std)), np.argmax(np.abs(found), axis=1)]
    columns = (
        TableColumn("strut", of=range(1, len(std) + 1)),
        TableColumn("σ", unit, of=std),
        TableColumn("skewness", digits=2, of=unknown if shape is None else shape.skewness),
        TableColumn("excess kurtosis", digits=2, of=unknown if shape is None else shape.kurtosis),
        TableColumn("outliers", of=unknown if shape is None else shape.outliers),
        TableColumn(
            "largest autocorrelation", digits=2, of=unknown if largest is None else largest
        ),
    )
    caption = f"Noise of one sample of the {what}s: size, shape and memory"
    return ReportTable.of(f"noise_{what}s", caption, columns)


def _covariance_table(noise: NoiseFile) -> ReportTable:
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
