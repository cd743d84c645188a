"""What a report says of a simulated experiment."""

from __future__ import annotations

import numpy as np

from results.reading.document import Document
from results.report.content import Fact, Facts, Level, Section, StageReport, TableBlock, Verdict
from results.report.folder import RunFolder
from results.report.numerals import readable
from results.report.table import Column, ReportTable

_DISTURBANCES = {
    "tracking_error": "tracking error",
    "drift": "drift",
    "cogging": "cogging",
    "quantisation": "quantisation",
    "outliers": "outliers",
}


def experiment_report(folder: RunFolder) -> StageReport:
    """Return what is to be said of the experiment in a folder."""
    truth = folder.document("experiment")
    section = truth.section("experiment")
    periods, samples = section.integer("periods"), section.integer("samples")
    rate = section.number("sampling")
    named = disturbances(truth)
    told = ", ".join(named) or "none"
    table = truth.section("table").text("file") if "table" in truth else ""
    twin = f"the digital twin executing {table}" if table else "the digital twin"
    sentence = (
        f"Simulated on {twin}: {periods} periods measured at {readable(rate)} Hz, {samples} "
        f"samples. Disturbances besides the noise: {told}."
    )
    entry = folder.entry("experiment")
    done = entry is None or entry.status == "done"
    verdict = Verdict(
        "Experiment",
        Level.NEUTRAL if done else Level.BAD,
        "simulated" if done else entry.status if entry else "",
        sentence,
        "experiment",
    )
    facts = (Fact("samples", f"{samples}", f"simulated, {periods} periods"),)
    executed = truth.section("executed")
    details = Facts(
        (
            Fact("periods", str(periods)),
            Fact("sampling", f"{readable(rate)} Hz"),
            Fact("period", f"{readable(executed.number('period'))} s"),
            *((Fact("controller table", table),) if table else ()),
            Fact("disturbances", told),
            Fact("seed", str(truth.section("seeds").optional("experiment"))),
        )
    )
    blocks = (details, TableBlock(_noise_table(truth)))
    return StageReport(verdict, facts, (Section("experiment", "Experiment", blocks),))


def disturbances(truth: Document) -> tuple[str, ...]:
    """Return the names of the disturbances that an experiment had."""
    section = truth.section("disturbances")
    return tuple(
        title
        for key, title in _DISTURBANCES.items()
        if section.optional(key) not in (None, 0, 0.0, {}, [])
    )


def _noise_table(truth: Document) -> ReportTable:
    force = np.sqrt(np.diag(truth.array("force_covariance", (6, 6))))
    length = np.sqrt(np.diag(truth.array("length_covariance", (6, 6))))
    rows = [(j + 1, float(force[j]), 1e3 * float(length[j])) for j in range(6)]
    columns = (
        Column("strut"),
        Column("force noise σ", "N"),
        Column("length noise σ", "mm"),
    )
    return ReportTable.of("true_noise", "True noise of one sample", columns, rows)
