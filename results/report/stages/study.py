"""What a report says of a comparison on the digital twin."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from results.figures.estimation import prediction
from results.reading.document import Document
from results.reading.table import Table
from results.report.content import (
    Block,
    Fact,
    Level,
    Section,
    StageReport,
    TableBlock,
    TextBlock,
    Verdict,
)
from results.report.folder import RunFolder
from results.report.stages.estimate import NAMES
from results.report.table import Column, ReportTable, Value

_TITLES = {
    "design": "Two criteria of design",
    "identification": "LS, GM and ML with a disturbed information matrix",
    "validation": "What the validation sees",
}
_FIGURES = {
    "design": ("study_distributions", "study_precision", "study_means"),
    "identification": ("study_bias",),
    "validation": ("study_variances",),
}
SIMULATED = (
    "All numbers come from the digital twin: they are simulated. The paper's values are of a real "
    "machine whose geometry and noise are not public; what can be compared is the pattern."
)


def study_report(folder: RunFolder) -> StageReport:
    """Return what is to be said of the study in a folder."""
    document = folder.document("study")
    kind = document.text("kind")
    claims = document.sections("claims")
    judged = [claim for claim in claims if claim.optional("holds") is not None]
    broken = [claim for claim in judged if not claim.flag("holds")]
    sentence = f"{len(judged) - len(broken)} of {len(judged)} claims hold."
    if broken:
        sentence += " Not: " + "; ".join(claim.text("statement") for claim in broken) + "."
    verdict = Verdict(
        f"Study: {_TITLES[kind].lower()}",
        Level.CAUTION if broken else Level.GOOD,
        "not all hold" if broken else "all hold",
        sentence,
        "study",
    )
    blocks: list[Block] = [TextBlock((SIMULATED,)), TableBlock(_claims_table(claims))]
    blocks += folder.figures(*_FIGURES[kind])
    if kind == "validation":
        blocks += folder.figures(*_predictions(folder, document))
    blocks += [TableBlock(make(folder)) for make in _TABLES[kind]]
    facts = (
        Fact("claims that hold", f"{len(judged) - len(broken)} of {len(judged)}", "simulated"),
    )
    return StageReport(verdict, facts, (Section("study", _TITLES[kind], tuple(blocks)),))


def _predictions(folder: RunFolder, document: Document) -> tuple[str, ...]:
    """Return the figures of the first run: three situations of every motion."""
    motions = len(document.section("settings").sections("motions"))
    stems = [f"{prediction.FIGURE.key}_study_{k}" for k in range(1, 3 * motions + 1)]
    return tuple(stem for stem in stems if (folder.path / "figures" / f"{stem}.svg").is_file())


def _claims_table(claims: Sequence[Document]) -> ReportTable:
    rows = [claim_row(claim) for claim in claims]
    return ReportTable.of("study_claims", "What the study shows", claim_columns(), rows)


def claim_columns() -> tuple[Column, ...]:
    """Return the columns of a table of claims."""
    return (
        Column("what", kind="text"),
        Column("found (simulated)", kind="text"),
        Column("the paper", kind="text"),
        Column("verdict", kind="outcome"),
    )


def claim_row(claim: Document) -> tuple[Value, ...]:
    """Return a claim's cells."""
    holds = claim.optional("holds")
    return (
        claim.text("statement"),
        claim.text("value"),
        claim.text("paper"),
        "" if holds is None else "holds" if holds else "fails",
    )


def _designs(folder: RunFolder) -> ReportTable:
    return _plain(
        folder,
        "study_designs",
        "The designs",
        {
            "set": Column("set"),
            "criterion": Column("criterion", kind="text"),
            "status": Column("search", kind="text"),
            "log_det_information": Column("log det F"),
            "condition_si": Column("cond F, SI", digits=3),
            "condition_nominal": Column("cond F, nominal", digits=3),
            "period": Column("period", "s"),
            "strut_speed": Column("rms strut speed", "m/s", digits=3),
            "strut_acceleration": Column("rms strut acceleration", "m/s^2", digits=3),
        },
    )


def _determinants(folder: RunFolder) -> ReportTable:
    return _plain(
        folder,
        "study_determinants",
        "Determinants of the achieved covariances, and how many parameters the first design knows "
        "better",
        {
            "set": Column("set"),
            "kinematics": Column("kinematics", kind="text"),
            "estimator": Column("estimator", kind="text"),
            "log_det_first": Column("log det, first"),
            "log_det_second": Column("log det, second"),
            "difference": Column("difference", digits=3),
            "std_error": Column("its error", digits=2),
            "rigid_body_smaller": Column("rigid-body"),
            "friction_smaller": Column("friction"),
        },
        folded=True,
    )


def _precision(folder: RunFolder) -> ReportTable:
    return _plain(
        folder,
        "study_precision",
        "Means and standard deviations of all estimates",
        {
            "set": Column("set"),
            "criterion": Column("criterion", kind="text"),
            "kinematics": Column("kinematics", kind="text"),
            "estimator": Column("estimator", kind="text"),
            "parameter": Column("parameter", kind="parameter"),
            "unit": Column("unit", kind="text"),
            "truth": Column("truth"),
            "mean": Column("mean"),
            "std": Column("std", digits=3),
            "predicted_std": Column("predicted", digits=3),
        },
        folded=True,
    )


def _estimates(folder: RunFolder) -> ReportTable:
    return _plain(
        folder,
        "study_estimates",
        "Estimates of the first experiment, and the bias over all",
        {
            "case": Column("case", kind="text"),
            "estimator": Column("estimator", kind="text"),
            "parameter": Column("parameter", kind="parameter"),
            "unit": Column("unit", kind="text"),
            "truth": Column("truth"),
            "value": Column("estimate"),
            "std": Column("std", digits=3),
            "bias": Column("bias", digits=3),
            "bias_t": Column("bias / its error", digits=3),
            "bias_over_std": Column("bias / std", digits=3),
            "hausman_z": Column("ML − GM, z", digits=3),
        },
        folded=True,
    )


def _power(folder: RunFolder) -> ReportTable:
    return _plain(
        folder,
        "study_power",
        "Parameters that are wrong on purpose: in how many runs a test says so",
        {
            "parameter": Column("parameter", kind="parameter"),
            "factor": Column("factor"),
            "seen": Column("seen"),
            "runs": Column("runs"),
            "power": Column("power", digits=3),
            "low": Column("95 % from", digits=3),
            "high": Column("95 % to", digits=3),
            "tests": Column("tests that fail (runs)", kind="text"),
        },
    )


def _variances(folder: RunFolder) -> ReportTable:
    return _plain(
        folder,
        "study_variances",
        "Variance about the prediction and of the noise, mean of all runs",
        {
            "situation": Column("cogging", kind="text"),
            "motion": Column("motion", kind="text"),
            "actuator": Column("actuator"),
            "variance_model_error": Column("about the prediction", "N^2"),
            "variance_measurement_error": Column("of the noise", "N^2"),
            "fails": Column("fails in"),
            "runs": Column("runs"),
        },
        folded=True,
    )


_TABLES: dict[str, tuple[Callable[[RunFolder], ReportTable], ...]] = {
    "design": (_designs, _determinants, _precision),
    "identification": (_estimates,),
    "validation": (_power, _variances),
}


def _plain(
    folder: RunFolder,
    name: str,
    caption: str,
    columns: dict[str, Column],
    *,
    folded: bool = False,
) -> ReportTable:
    """Return columns of a CSV table as they are; estimators by their names."""
    table = Table.read(folder.table_file(name), list(columns))
    texts = {"text", "parameter", "outcome"}
    cells: dict[str, list[Value]] = {}
    for key, column in columns.items():
        if column.kind in texts:
            cells[key] = [NAMES.get(text, text) for text in table.columns[key]]
        else:
            cells[key] = list(table.numbers(key, blank=True).tolist())
    rows = [tuple(cells[key][k] for key in columns) for k in range(len(table))]
    return ReportTable.of(name, caption, tuple(columns.values()), rows, folded=folded)
