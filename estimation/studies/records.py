"""`study.json` and the tables of a study, each a type. Values are SI and radians."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, make_dataclass
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

from expdesign.mechanism.hexapod import numbered
from expdesign.runfolder import Contents, FolderRecord, OpenNumber, RowTable, RunFile, described

_WRITTEN_BY = "`expdesign run` of a run with `study:`"

Row = TypeVar("Row")

Set = Annotated[int, described("1", "set of initial parameters")]
Criterion = Annotated[str, described("", "criterion of the design")]
Kinematics = Annotated[
    str, described("", "exact (no noise of the lengths), fourier or central differentiation")
]
Estimator = Annotated[str, described("", "ls, gm or ml")]
Parameter = Annotated[str, described("", "name")]
Unit = Annotated[str, described("", "SI unit of the columns that refer to it")]
Truth = Annotated[float, described("see unit", "true value")]
Case = Annotated[str, described("", "undisturbed, pointwise or tracking")]
Situation = Annotated[
    str, described("", "cogging nowhere, unknown to the model, or in both experiments")
]
Motion = Annotated[str, described("", "predicted motion")]
Runs = Annotated[int, described("1", "identifications")]


@dataclass(frozen=True)
class Claim:
    """What a study was to show, the value that it found on the digital twin, and the paper's.

    That is empty where the paper states none; None holds where nothing is claimed.
    """

    statement: str
    value: str
    paper: str = ""
    holds: bool | None = None


@dataclass(frozen=True)
class DesignRow:
    """One design of a study of designs."""

    set: Set
    criterion: Criterion
    folder: Annotated[str, described("", "run folder of the design")]
    status: Annotated[str, described("", "how the search ended")]
    keeps_limits: Annotated[bool, described("", "on the fine grid, unsmoothed model")]
    log_det_information: Annotated[
        float, described("1", "log det F over the samples of one period, SI")
    ]
    condition_si: Annotated[float, described("1", "condition number of F, SI")]
    condition_nominal: Annotated[
        float, described("1", "condition number of F scaled by the nominal parameters")
    ]
    period: Annotated[float, described("s", "of the motion")]
    strut_speed: Annotated[float, described("m/s", "rms over struts and time")]
    strut_acceleration: Annotated[float, described("m/s^2", "rms over struts and time")]
    failed: Annotated[int, described("1", "repetitions without an estimate")]


@dataclass(frozen=True)
class PrecisionRow:
    """One parameter, estimated from one design in one way."""

    set: Set
    criterion: Criterion
    kinematics: Kinematics
    estimator: Estimator
    parameter: Parameter
    unit: Unit
    truth: Truth
    mean: Annotated[float, described("see unit", "mean of the estimates")]
    std: Annotated[float, described("see unit", "standard deviation of the estimates")]
    predicted_std: Annotated[float, described("see unit", "predicted with exact kinematics")]


@dataclass(frozen=True)
class DeterminantRow:
    """The two designs of a set, compared by the covariance that they achieve."""

    set: Set
    kinematics: Kinematics
    estimator: Estimator
    log_det_first: Annotated[
        float, described("1", "log det of the achieved covariance, first criterion")
    ]
    log_det_second: Annotated[float, described("1", "the same of the second criterion")]
    difference: Annotated[float, described("1", "second less first")]
    std_error: Annotated[float, described("1", "of the difference, from the number of repetitions")]
    rigid_body_smaller: Annotated[
        int, described("1", "rigid-body parameters the first knows better")
    ]
    friction_smaller: Annotated[int, described("1", "friction parameters the first knows better")]


@dataclass(frozen=True)
class AgreementRow:
    """The achieved variances of one design against the predicted ones."""

    set: Set
    criterion: Criterion
    estimator: Estimator
    variance_ratio: Annotated[
        float, described("1", "achieved over predicted variance, mean over parameters")
    ]
    std_error: Annotated[float, described("1", "from the scatter between repetitions")]
    z: Annotated[float, described("1", "ratio less one, in standard errors")]


@dataclass(frozen=True)
class MeanRow:
    """The mean estimates of one parameter from the two designs of a set."""

    set: Set
    kinematics: Kinematics
    parameter: Parameter
    unit: Unit
    difference: Annotated[
        float, described("see unit", "mean LS estimate, second less first criterion")
    ]
    std_error: Annotated[float, described("see unit", "of the difference")]
    t: Annotated[float, described("1", "their ratio (Welch)")]
    p_value: Annotated[
        float, described("1", "two-sided, corrected for the number of parameters (Holm)")
    ]
    p_joint: Annotated[float, described("1", "of all parameters together (Hotelling)")]


@dataclass(frozen=True)
class EstimateRow:
    """One parameter as one estimator finds it in one case."""

    case: Case
    estimator: Estimator
    parameter: Parameter
    unit: Unit
    truth: Truth
    identified: Annotated[bool, described("", "ML knows it to less than half its scale")]
    value: Annotated[float, described("see unit", "estimate of the first experiment")]
    std: Annotated[float, described("see unit", "as stated with it")]
    mean: Annotated[float, described("see unit", "over all experiments")]
    bias: Annotated[float, described("see unit", "mean less truth")]
    bias_std_error: Annotated[float, described("see unit", "its standard error")]
    bias_t: Annotated[float, described("1", "bias in standard errors")]
    bias_over_std: Annotated[
        float, described("1", "bias in standard deviations as stated for one experiment")
    ]
    hausman_z: Annotated[
        OpenNumber, described("1", "ML − GM of the first experiment over its standard deviation")
    ]
    hausman_p: Annotated[
        OpenNumber, described("1", "two-sided, corrected for the number of parameters (Holm)")
    ]


@dataclass(frozen=True)
class HausmanRow:
    """Whether GM and ML of one experiment differ."""

    case: Case
    experiment: Annotated[int, described("1", "number")]
    p_joint: Annotated[
        OpenNumber,
        described("1", "of the difference of GM and ML, all parameters; empty with none judged"),
    ]
    largest_z: Annotated[
        OpenNumber, described("1", "largest difference of a parameter over its standard deviation")
    ]
    parameter: Annotated[str, described("", "that it is of")]
    disturbed: Annotated[str, described("", "whether the information matrix is, by this test")]
    harmonics: Annotated[int, described("1", "that ML found in lengths and forces")]


@dataclass(frozen=True)
class VarianceRow:
    """One actuator on one predicted motion."""

    situation: Situation
    motion: Motion
    actuator: Annotated[int, described("1", "number")]
    variance_model_error: Annotated[float, described("N^2", "about the prediction, mean over runs")]
    variance_measurement_error: Annotated[float, described("N^2", "of the noise, mean over runs")]
    fails: Annotated[int, described("1", "runs in which the actuator fails the lack-of-fit test")]
    runs: Runs


VerdictRow = make_dataclass(
    "VerdictRow",
    [
        ("run", Annotated[int, described("1", "identification")]),
        ("situation", Situation),
        ("motion", Motion),
        *(
            (name, Annotated[bool, described("", f"actuator {number} fails the lack-of-fit test")])
            for number, name in enumerate(numbered("fails_"), start=1)
        ),
        (
            "against",
            Annotated[str, described("", "assumptions that fail, separated by semicolons")],
        ),
    ],
    frozen=True,
)
"""One motion as one run predicts it, with a column for every actuator."""


@dataclass(frozen=True)
class PowerRow:
    """How often a parameter that is wrong on purpose is seen."""

    parameter: Parameter
    factor: Annotated[float, described("1", "by which it is wrong")]
    seen: Annotated[int, described("1", "runs in which a test fails")]
    runs: Runs
    power: Annotated[float, described("1", "share of the runs")]
    low: Annotated[float, described("1", "lower end of its 95 % interval")]
    high: Annotated[float, described("1", "upper end of its 95 % interval")]
    tests: Annotated[str, described("", "tests that fail, with their number of runs")]


def _table(name: str, row: type[Row]) -> RowTable[Row]:
    return RowTable(f"tables/study_{name}.csv", _WRITTEN_BY, row)


DESIGNS = _table("designs", DesignRow)
PRECISION = _table("precision", PrecisionRow)
DETERMINANTS = _table("determinants", DeterminantRow)
AGREEMENT = _table("agreement", AgreementRow)
MEANS = _table("means", MeanRow)
ESTIMATES = _table("estimates", EstimateRow)
HAUSMAN = _table("hausman", HausmanRow)
VARIANCES = _table("variances", VarianceRow)
POWER = _table("power", PowerRow)
VERDICTS: RowTable[Any] = _table("verdicts", VerdictRow)

TABLES: dict[str, tuple[RowTable[Any], ...]] = {
    "design": (DESIGNS, PRECISION, DETERMINANTS, AGREEMENT, MEANS),
    "identification": (ESTIMATES, HAUSMAN),
    "validation": (VARIANCES, POWER, VERDICTS),
}
"""The tables of every kind of study."""


@dataclass(frozen=True, eq=False, kw_only=True)
class StudySummary(RunFile):
    """`study.json`: what was asked for, and the claims."""

    FILE: ClassVar[str] = "study.json"
    WRITTEN_BY: ClassVar[str] = _WRITTEN_BY
    simulated: Annotated[bool, described("", "true: everything comes from the digital twin")]
    kind: Annotated[
        Literal["design", "identification", "validation"], described("", "what is compared")
    ]
    settings: Annotated[dict[str, Any], described("", "`study` of the run, with its defaults")]
    seeds: Annotated[dict[str, int], described("1", "of design, experiment and repetitions")]
    claims: Annotated[
        tuple[Claim, ...], described("", "statement, value found, the paper's, whether it holds")
    ]


@dataclass(frozen=True, eq=False)
class StudyRecord(FolderRecord):
    """What a run folder holds of a study: all that reports and most figures are made of."""

    summary: StudySummary
    tables: Mapping[RowTable[Any], tuple[Any, ...]]

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read it from a run folder."""
        found = cls.fields_in(folder)
        return cls(**found, tables={t: t.read(folder) for t in TABLES[found["summary"].kind]})

    def contents(self) -> Contents:
        """Yield the tables of its kind."""
        yield from self.tables.items()

    def rows(self, table: RowTable[Row]) -> tuple[Row, ...]:
        """Return the rows of one of the study's tables."""
        return self.tables[table]
