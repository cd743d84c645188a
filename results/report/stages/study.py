"""What a report says of a comparison on the digital twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from estimation.studies import Claim, StudyRecord
from estimation.studies.records import (
    DESIGNS,
    DETERMINANTS,
    ESTIMATES,
    POWER,
    PRECISION,
    VARIANCES,
)
from expdesign.runfolder import RowTable
from results.figures.estimation.residuals import PREDICTION_FIGURE
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


@dataclass(frozen=True)
class _Shown:
    """A table of the study as the report shows it; of columns that others share, the name."""

    table: RowTable[Any]
    caption: str
    columns: dict[str, Column | None]
    folded: bool = False


_SHARED = {
    "set": Column("set"),
    "criterion": Column("criterion", kind="text"),
    "kinematics": Column("kinematics", kind="text"),
    "estimator": Column("estimator", kind="text"),
    "parameter": Column("parameter", kind="parameter"),
    "unit": Column("unit", kind="text"),
    "truth": Column("truth"),
    "std": Column("std", digits=3),
    "runs": Column("runs"),
}
_WHO = dict.fromkeys(("estimator", "parameter", "unit", "truth"))
_TABLES: dict[str, tuple[_Shown, ...]] = {
    "design": (
        _Shown(
            DESIGNS,
            "The designs",
            {
                "set": None,
                "criterion": None,
                "status": Column("search", kind="text"),
                "log_det_information": Column("log det F"),
                "condition_si": Column("cond F, SI", digits=3),
                "condition_nominal": Column("cond F, nominal", digits=3),
                "period": Column("period", "s"),
                "strut_speed": Column("rms strut speed", "m/s", digits=3),
                "strut_acceleration": Column("rms strut acceleration", "m/s^2", digits=3),
            },
        ),
        _Shown(
            DETERMINANTS,
            "Determinants of the achieved covariances, and how many parameters the first design "
            "knows better",
            {
                **dict.fromkeys(("set", "kinematics", "estimator")),
                "log_det_first": Column("log det, first"),
                "log_det_second": Column("log det, second"),
                "difference": Column("difference", digits=3),
                "std_error": Column("its error", digits=2),
                "rigid_body_smaller": Column("rigid-body"),
                "friction_smaller": Column("friction"),
            },
            folded=True,
        ),
        _Shown(
            PRECISION,
            "Means and standard deviations of all estimates",
            {
                **dict.fromkeys(("set", "criterion", "kinematics")),
                **_WHO,
                "mean": Column("mean"),
                "std": None,
                "predicted_std": Column("predicted", digits=3),
            },
            folded=True,
        ),
    ),
    "identification": (
        _Shown(
            ESTIMATES,
            "Estimates of the first experiment, and the bias over all",
            {
                "case": Column("case", kind="text"),
                **_WHO,
                "value": Column("estimate"),
                "std": None,
                "bias": Column("bias", digits=3),
                "bias_t": Column("bias / its error", digits=3),
                "bias_over_std": Column("bias / std", digits=3),
                "hausman_z": Column("ML − GM, z", digits=3),
            },
            folded=True,
        ),
    ),
    "validation": (
        _Shown(
            POWER,
            "Parameters that are wrong on purpose: in how many runs a test says so",
            {
                "parameter": None,
                "factor": Column("factor"),
                "seen": Column("seen"),
                "runs": None,
                "power": Column("power", digits=3),
                "low": Column("95 % from", digits=3),
                "high": Column("95 % to", digits=3),
                "tests": Column("tests that fail (runs)", kind="text"),
            },
        ),
        _Shown(
            VARIANCES,
            "Variance about the prediction and of the noise, mean of all runs",
            {
                "situation": Column("cogging", kind="text"),
                "motion": Column("motion", kind="text"),
                "actuator": Column("actuator"),
                "variance_model_error": Column("about the prediction", "N^2"),
                "variance_measurement_error": Column("of the noise", "N^2"),
                "fails": Column("fails in"),
                "runs": None,
            },
            folded=True,
        ),
    ),
}


def study_report(folder: RunFolder) -> StageReport:
    """Return what is to be said of the study in a folder."""
    record = StudyRecord.read(folder.path)
    kind, claims = record.summary.kind, record.summary.claims
    level, word, sentence, fact = judgement(claims)
    verdict = Verdict(f"Study: {_TITLES[kind].lower()}", level, word, sentence, "study")
    table = ReportTable.of(
        "study_claims", "What the study shows", CLAIM_COLUMNS, [claim_row(one) for one in claims]
    )
    blocks: list[Block] = [TextBlock((SIMULATED,)), TableBlock(table)]
    blocks += folder.figures(*_FIGURES[kind])
    if kind == "validation":
        blocks += folder.figures(*_predictions(folder, record))
    blocks += [TableBlock(_report_table(shown, record)) for shown in _TABLES[kind]]
    return StageReport(verdict, (fact,), (Section("study", _TITLES[kind], tuple(blocks)),))


def judgement(claims: Sequence[Claim]) -> tuple[Level, str, str, Fact]:
    """Return level, word, sentence and fact: how many claims hold, and which do not."""
    judged = [claim for claim in claims if claim.holds is not None]
    broken = [claim for claim in judged if not claim.holds]
    count = f"{len(judged) - len(broken)} of {len(judged)}"
    sentence = f"{count} claims hold."
    if broken:
        sentence += " Not: " + "; ".join(claim.statement for claim in broken) + "."
    level, word = (Level.CAUTION, "not all hold") if broken else (Level.GOOD, "all hold")
    return level, word, sentence, Fact("claims that hold", count, "simulated")


CLAIM_COLUMNS = (
    Column("what", kind="text"),
    Column("found (simulated)", kind="text"),
    Column("the paper", kind="text"),
    Column("verdict", kind="outcome"),
)


def claim_row(claim: Claim) -> tuple[Value, ...]:
    """Return a claim's cells."""
    verdict = {None: "", True: "holds", False: "fails"}[claim.holds]
    return (claim.statement, claim.value, claim.paper, verdict)


def _predictions(folder: RunFolder, record: StudyRecord) -> tuple[str, ...]:
    """Return the figures of the first run: three situations of every motion."""
    motions = len(record.summary.settings["motions"])
    stems = [f"{PREDICTION_FIGURE.key}_study_{k}" for k in range(1, 3 * motions + 1)]
    return tuple(stem for stem in stems if (folder.path / "figures" / f"{stem}.svg").is_file())


def _report_table(shown: _Shown, record: StudyRecord) -> ReportTable:
    """Return columns of a table as they are; estimators by their names."""
    columns = {name: column or _SHARED[name] for name, column in shown.columns.items()}
    rows = [
        [NAMES.get(cell, cell) for cell in (getattr(row, name) for name in columns)]
        for row in record.rows(shown.table)
    ]
    key = shown.table.file.removeprefix("tables/").removesuffix(".csv")
    return ReportTable.of(key, shown.caption, tuple(columns.values()), rows, folded=shown.folded)
