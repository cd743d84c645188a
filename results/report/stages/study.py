"""What a report says of a comparison on the digital twin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_type_hints

from estimation.studies.records import (
    DESIGNS,
    DETERMINANTS,
    ESTIMATES,
    POWER,
    PRECISION,
    VARIANCES,
    Claim,
    StudyRecord,
)
from expdesign.runfolder import RowTable
from results.figures.residuals import prediction_figure
from results.figures.studies import RECORD_FIGURES, distributions_figure
from results.report.content import (
    Block,
    Fact,
    Level,
    StageReport,
    TextBlock,
    Verdict,
)
from results.report.folder import RunFolder
from results.report.stages.estimate import NAMES
from results.report.table import Column, ReportTable, Value, text_columns

_TITLES = {
    "design": "Two criteria of design",
    "identification": "LS, GM and ML with a disturbed information matrix",
    "validation": "What the validation sees",
}
_NO_UNITS = ("", "1", "see unit")
SIMULATED = (
    "All numbers come from the digital twin: they are simulated. The paper's values are of a real "
    "machine whose geometry and noise are not public; what can be compared is the pattern."
)


_HEADINGS = {
    "status": "search",
    "log_det_information": "log det F",
    "condition_si": "cond F, SI",
    "condition_nominal": "cond F, nominal",
    "strut_speed": "rms strut speed",
    "strut_acceleration": "rms strut acceleration",
    "log_det_first": "log det, first",
    "log_det_second": "log det, second",
    "std_error": "its error",
    "rigid_body_smaller": "rigid-body",
    "friction_smaller": "friction",
    "predicted_std": "predicted",
    "value": "estimate",
    "bias_t": "bias / its error",
    "bias_over_std": "bias / std",
    "hausman_z": "ML − GM, z",
    "low": "95 % from",
    "high": "95 % to",
    "tests": "tests that fail (runs)",
    "situation": "cogging",
    "variance_model_error": "about the prediction",
    "variance_measurement_error": "of the noise",
    "fails": "fails in",
}
"""Of columns that do not go by their name in the file."""

_THREE_DIGITS = (
    "condition_si condition_nominal strut_speed strut_acceleration difference std predicted_std "
    "bias bias_t bias_over_std hausman_z power low high"
)
_DIGITS = {"std_error": 2, **dict.fromkeys(_THREE_DIGITS.split(), 3)}


@dataclass(frozen=True)
class _Shown:
    """A table as the report shows it, with some of its columns."""

    table: RowTable[Any]
    caption: str
    columns: str
    folded: bool = True


_TABLES: dict[str, tuple[_Shown, ...]] = {
    "design": (
        _Shown(
            DESIGNS,
            "The designs",
            "set criterion status log_det_information condition_si condition_nominal period "
            "strut_speed strut_acceleration",
            folded=False,
        ),
        _Shown(
            DETERMINANTS,
            "Determinants of the achieved covariances, and how many parameters the first design "
            "knows better",
            "set kinematics estimator log_det_first log_det_second difference std_error "
            "rigid_body_smaller friction_smaller",
        ),
        _Shown(
            PRECISION,
            "Means and standard deviations of all estimates",
            "set criterion kinematics estimator parameter unit truth mean std predicted_std",
        ),
    ),
    "identification": (
        _Shown(
            ESTIMATES,
            "Estimates of the first experiment, and the bias over all",
            "case estimator parameter unit truth value std bias bias_t bias_over_std hausman_z",
        ),
    ),
    "validation": (
        _Shown(
            POWER,
            "Parameters that are wrong on purpose: in how many runs a test says so",
            "parameter factor seen runs power low high tests",
            folded=False,
        ),
        _Shown(
            VARIANCES,
            "Variance about the prediction and of the noise, mean of all runs",
            "situation motion actuator variance_model_error variance_measurement_error fails runs",
        ),
    ),
}


def study_report(folder: RunFolder) -> StageReport:
    """Return what is to be said of the study in a folder."""
    record = folder.record(StudyRecord)
    kind, claims = record.summary.kind, record.summary.claims
    level, word, sentence, fact = judgement(claims)
    verdict = Verdict(f"Study: {_TITLES[kind].lower()}", level, word, sentence, "study")
    table = ReportTable.of(
        "study_claims", "What the study shows", CLAIM_COLUMNS, [claim_row(one) for one in claims]
    )
    blocks: list[Block] = [TextBlock(SIMULATED), table]
    blocks += folder.figures(distributions_figure, *RECORD_FIGURES[kind])
    if kind == "validation":
        blocks += folder.figures(*_predictions(folder, record))
    blocks += [_report_table(shown, record) for shown in _TABLES[kind]]
    return StageReport(verdict, tuple(blocks), (fact,), heading=_TITLES[kind])


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
    *text_columns("what", "found (simulated)", "the paper"),
    Column("verdict", kind="outcome"),
)


def claim_row(claim: Claim) -> tuple[Value, ...]:
    """Return a claim's cells."""
    verdict = {None: "", True: "holds", False: "fails"}[claim.holds]
    return (claim.statement, claim.value, claim.paper, verdict)


def _predictions(folder: RunFolder, record: StudyRecord) -> tuple[str, ...]:
    """Return the figures of the first run: three situations of every motion."""
    motions = len(record.summary.settings["motions"])
    stems = [f"{prediction_figure.key}_study_{k}" for k in range(1, 3 * motions + 1)]
    return tuple(stem for stem in stems if (folder.path / "figures" / f"{stem}.svg").is_file())


def _report_table(shown: _Shown, record: StudyRecord) -> ReportTable:
    """Return columns of a table as they are; estimators by their names."""
    described = {column.name: column for column in shown.table.columns}
    texts = {name for name, kind in get_type_hints(shown.table.row).items() if kind is str}
    names = shown.columns.split()
    columns = [
        Column(
            _HEADINGS.get(name, name),
            described[name].unit if described[name].unit not in _NO_UNITS else "",
            "parameter" if name == "parameter" else "text" if name in texts else "number",
            _DIGITS.get(name, 4),
        )
        for name in names
    ]
    cells = ([getattr(row, name) for name in names] for row in record.rows(shown.table))
    rows = [[NAMES.get(cell, cell) for cell in row] for row in cells]
    key = shown.table.file.removeprefix("tables/").removesuffix(".csv")
    return ReportTable.of(key, shown.caption, columns, rows, folded=shown.folded)
