"""What a report says of a simulated experiment."""

from __future__ import annotations

import numpy as np

from estimation.twin.record import Truth
from results.notation import readable
from results.report.content import Fact, Facts, Level, StageReport, Verdict
from results.report.folder import RunFolder
from results.report.table import Column, ReportTable


def experiment_report(folder: RunFolder) -> StageReport:
    """Describe the experiment in a folder."""
    truth = folder.record(Truth)
    experiment = truth.experiment
    disturbances = ", ".join(truth.disturbances.active) or "none"
    table = "" if truth.table is None else truth.table.file
    twin = f"the digital twin executing {table}" if table else "the digital twin"
    rate, periods = f"{readable(experiment.sampling)} Hz", f"{experiment.periods:g}"
    sentence = (
        f"Simulated on {twin}: {periods} periods measured at {rate}, {experiment.samples} "
        f"samples. Disturbances besides the noise: {disturbances}."
    )
    entry = folder.entry("experiment")
    level, word = Level.NEUTRAL, "simulated"
    if entry is not None and entry.status != "done":
        level, word = Level.BAD, entry.status
    verdict = Verdict("Experiment", level, word, sentence, "experiment")
    facts = (Fact("samples", f"{experiment.samples}", f"simulated, {periods} periods"),)
    details = Facts(
        (
            Fact("periods", periods),
            Fact("sampling", rate),
            Fact("period", f"{readable(truth.executed.period)} s"),
            *((Fact("controller table", table),) if table else ()),
            Fact("disturbances", disturbances),
            Fact("seed", str(truth.seeds.experiment)),
        )
    )
    force, length = (np.sqrt(np.diag(c)) for c in (truth.force_covariance, truth.length_covariance))
    columns = (
        Column("strut", of=range(1, len(force) + 1)),
        Column("force noise σ", "N", of=force),
        Column("length noise σ", "mm", of=length, factor=1e3),
    )
    noise = ReportTable.of("true_noise", "True noise of one sample", columns)
    return StageReport(verdict, (details, noise), facts)
