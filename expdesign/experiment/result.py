"""The result of a design: the trajectory with its limits, its precision and its search."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator, PlainSerializer

from constraints.arrays import Array
from expdesign.configuration import Problem
from expdesign.information.identifiable import KnownCombination
from expdesign.motion.executable import SampledMotion
from expdesign.recheck.limit_check import LimitCheck, Recheck
from expdesign.robot import Robot, robot_from
from expdesign.robot.derived import KnownQuantity
from expdesign.runfolder import (
    JSON_ONLY,
    Matrix,
    OpenNumber,
    StageResult,
    StoredConfiguration,
    Table,
    described,
)
from expdesign.solver.phases import Iteration
from expdesign.trajectory import FourierKeys, HumDistance


@dataclass(frozen=True)
class PredictedPrecision:
    """Standard deviations of the Gauss–Markov estimates, √diag F⁻¹, by parameter, SI.

    Information is counted over so many samples.
    """

    samples: int
    periods: float
    std: dict[str, float]


def _precision_keys(precision: PredictedPrecision) -> dict[str, float]:
    return {"samples": precision.samples, "periods": precision.periods, **precision.std}


def _precision_data(keys: object) -> object:
    if not isinstance(keys, dict) or "samples" not in keys or "periods" not in keys:
        return keys
    std = {name: value for name, value in keys.items() if name not in {"samples", "periods"}}
    return {"samples": keys["samples"], "periods": keys["periods"], "std": std}


# In the file the parameters are keys like samples and periods.
_Precision = Annotated[
    PredictedPrecision, BeforeValidator(_precision_data), PlainSerializer(_precision_keys)
]


@dataclass(frozen=True)
class PredictedStd:
    """The predicted standard deviations of a design."""

    per_period: _Precision
    experiment: _Precision
    systematic: dict[str, float] = field(default_factory=dict)
    """Share of the robot's tolerances in the experiment's total, by parameter, SI; empty without
    tolerances."""
    total: dict[str, float] = field(default_factory=dict)
    """Standard deviation of the experiment with noise and tolerances, by parameter, SI, for the
    estimator of the run; empty without tolerances."""


@dataclass(frozen=True)
class ParameterPrecision:
    """Nominal value and predicted standard deviations of a judged parameter."""

    name: Annotated[str, described("", "name", name="parameter")]
    unit: Annotated[str, described("", "SI unit of nominal value and standard deviations")]
    nominal: Annotated[OpenNumber, described("see unit", "nominal value")]
    std_per_period: Annotated[
        OpenNumber,
        described("see unit", "predicted standard deviation, one period, with a whole prior"),
    ]
    std_experiment: Annotated[
        OpenNumber, described("see unit", "predicted standard deviation, whole experiment")
    ]
    rel_std_percent_per_period: Annotated[
        OpenNumber, described("%", "of the nominal value; empty where that is 0")
    ]
    rel_std_percent_experiment: Annotated[
        OpenNumber, described("%", "of the nominal value; empty where that is 0")
    ]
    std_systematic: Annotated[
        OpenNumber,
        described("see unit", "share of the robot's tolerances; empty without them"),
    ] = np.nan
    std_total: Annotated[
        OpenNumber,
        described(
            "see unit",
            "whole experiment, of noise and tolerances, by the run's estimator; empty without them",
        ),
    ] = np.nan
    source: Annotated[
        str, described("", "largest contribution to it: noise, or the tolerance's key")
    ] = ""

    @property
    def std(self) -> float:
        """Predicted standard deviation of the whole experiment: the total where there is one."""
        return self.std_total if np.isfinite(self.std_total) else self.std_experiment

    @property
    def rel_std_percent(self) -> float:
        """The same in percent of the nominal value; NaN where that is zero."""
        return 100 * self.std / abs(self.nominal) if self.nominal else np.nan


@dataclass(frozen=True)
class Eigenvalue:
    """An eigenvalue of the information of one period."""

    index: Annotated[int, described("1", "from the smallest")]
    unit_diagonal: Annotated[
        OpenNumber, described("1", "of F scaled to unit diagonal", name="eigenvalue")
    ]
    nominal: Annotated[
        OpenNumber,
        described(
            "1", "of F with each parameter in units of its nominal value", name="eigenvalue_nominal"
        ),
    ]


@dataclass(frozen=True, eq=False, kw_only=True)
class DesignResult(FourierKeys, StageResult):
    """A designed trajectory with its limits, its precision and the statistics of its search.

    The trajectory is judged by the `parameter_names`, k of them, over the `samples` of one period.
    """

    FILE: ClassVar[str] = "design.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign design`"

    configuration: StoredConfiguration
    units: Annotated[str, described("", "of all values: SI and radians")] = "SI and radians"
    name: Annotated[str, described("", "name of the run")]
    robot_name: Annotated[str, described("", "name of the robot", name="robot")]
    criterion: Annotated[str, described("", "the optimised criterion: d, a, e or condition")]
    scaling: Annotated[str, described("", "of the parameters in the criterion: si or nominal")]
    parameter_names: Annotated[
        tuple[str, ...], described("", "the parameters that are judged", name="parameters")
    ]
    controller_period: Annotated[float | None, described("s", "step of the controller")]
    samples_per_period: Annotated[
        int | float,
        described("1", "controller steps of one period, whole unless the frequency was fixed"),
    ]
    samples: Annotated[int, described("1", "samples of one period in the information")]
    log_det_information: Annotated[
        OpenNumber,
        described(
            "",
            "log det F of the judged parameters, with design.prior log det S: unsmoothed model, "
            "full Σ, SI",
        ),
    ]
    criterion_value: Annotated[
        OpenNumber,
        described(
            "", "log det, trace of the inverse, smallest eigenvalue or condition number of F or S"
        ),
    ]
    predicted_std: Annotated[
        PredictedStd,
        described(
            "SI",
            "per_period and experiment: samples, periods and the standard deviation of each "
            "parameter that noise makes; total: of noise and the robot's tolerances in the "
            "experiment, by the run's estimator; systematic: the tolerances' share in it; both "
            "empty without tolerances",
        ),
    ]
    status: Annotated[str, described("", "converged, not converged, interrupted or limits broken")]
    status_text: Annotated[
        str, described("", "how the last stage of the best start ended, in words")
    ]
    solver: Annotated[
        SearchStatistics,
        described(
            "",
            "name, iterations, evaluations, seconds of all starts, cpu_seconds (of the processors, "
            "without building the problem), best_start, ended (why it went no further), finish "
            "(shrink, record), starts: of each the columns of tables/starts.csv, seconds and "
            "stages",
        ),
    ]
    base_parameters: Annotated[
        tuple[KnownCombination, ...],
        described("", "combinations that the experiment identifies; of each the table's columns"),
        Table("tables/design_combinations.csv"),
    ]
    derived: Annotated[
        tuple[KnownQuantity, ...],
        described(
            "",
            "mass, centre, inertia and further quantities that the experiment determines; of each "
            "the table's columns",
        ),
        Table("tables/design_derived.csv", optional=True),
    ] = ()
    hum: Annotated[
        tuple[HumDistance, ...],
        described(
            "",
            "hums of the noise: frequency [Hz], the multiple of the motion's frequency next to "
            "it, distance [Hz], and the same in lines of the record (1 or more keeps away)",
        ),
    ] = ()
    warnings: Annotated[tuple[str, ...], described("", "in words")]

    motion: Annotated[SampledMotion, Table("trajectory.csv")]
    """One period at the controller's rate, its end left out."""
    checks: Annotated[
        tuple[LimitCheck, ...], Table("tables/limits.csv", rows_of=("key",), as_in=("limits",))
    ]
    parameters: Annotated[
        tuple[ParameterPrecision, ...],
        Table("tables/parameters.csv", rows_of=("name",), as_in=("parameter_names",)),
    ]
    iterations: Annotated[tuple[Iteration, ...], Table("tables/convergence.csv")]
    eigenvalues: Annotated[
        tuple[Eigenvalue, ...],
        Table("tables/eigenvalues.csv", rows_of=("index",), as_in=("eigenvalue_numbers",)),
    ]
    information: Annotated[
        Array,
        Matrix(
            "tables/information.csv",
            "SI",
            "F of one period: column of this parameter",
            names="parameter_names",
            row="row of F; the other columns are its columns, SI units",
        ),
    ]
    """F of one period by the unsmoothed model with the full Σ, (k, k), SI."""

    @property
    def frequency_hz(self) -> Annotated[float, described("Hz", "base frequency")]:
        """Base frequency, Hz."""
        return self.trajectory.frequency

    @property
    def period(self) -> Annotated[float, described("s", "of the motion")]:
        """Period of the motion, s."""
        return self.trajectory.period

    @property
    def limits(
        self,
    ) -> Annotated[
        dict[str, dict[str, Any]],
        described(
            "",
            "for each limit: worst value, bound, unit, row, strut, time, violation, origin, "
            "certified (kept at every instant, proved), method, stated (the bound before the "
            "reserve), reserve (share of the range), proved excess, cells of time that it took, "
            "time that stayed open [s]",
        ),
    ]:
        """The columns of `checks` and how they were found, by limit."""
        method, found = self.check.method, {}
        for check in self.checks:
            columns = asdict(check)
            del columns["key"], columns["title"]
            found[check.key] = {
                **columns,
                "strut": check.strut,
                "certified": check.certified,
                "method": method,
            }
        return found

    @property
    def starts(self) -> Annotated[tuple[StartSummary, ...], Table("tables/starts.csv")]:
        """The starts and hops of the search, in their order."""
        return self.solver.starts

    @cached_property
    def robot(self) -> Robot:
        """The robot that the trajectory was designed for."""
        return robot_from(self.configuration.robot)

    @property
    def check(self) -> Recheck:
        """All limits over one period."""
        return Recheck(self.checks)

    @property
    def experiment(self) -> PredictedPrecision:
        """Predicted precision of the whole experiment."""
        return self.predicted_std.experiment

    @property
    def systematic(self) -> dict[str, float]:
        """Share of the robot's tolerances in the total standard deviations, by parameter, SI."""
        return self.predicted_std.systematic

    @property
    def passed(self) -> bool:
        """Whether every limit is kept and the search was completed."""
        return self.status in {"converged", "not converged"}

    @property
    def eigenvalue_numbers(self) -> range:
        """Numbers of the eigenvalues, from 1."""
        return range(1, len(self.parameter_names) + 1)

    def contradictions(self) -> Iterator[Problem]:
        """Yield times that do not increase."""
        if not self.motion.increases:
            message, allowed = "the times do not increase", "at least two increasing times"
            yield Problem(message, Path("trajectory.csv"), key="column t", allowed=allowed)


@dataclass(frozen=True)
class StartSummary:
    """A start or hop of the search; the table has no times, and is the same for the same seed."""

    index: Annotated[
        int, described("1", "number of the start, from 1; hops go on counting", name="start")
    ]
    kind: Annotated[str, described("", "random, hop, or origin: the motion that is improved")]
    criterion_value: Annotated[
        OpenNumber,
        described(
            "", "criterion of the motion reached, shrunk into its limits at a few hundred points"
        ),
    ]
    finished_value: Annotated[
        OpenNumber, described("", "the same after its finish; empty for those not finished")
    ]
    iterations: Annotated[int, described("1", "iterations of all stages")]
    converged: Annotated[bool, described("", "whether the last stage converged")]
    status: Annotated[str, described("", "how the last stage ended")]
    best: Annotated[
        bool, described("", "whether the design came from it: the best of the finished")
    ]
    seconds: Annotated[float, JSON_ONLY, described("s", "time that it took")]
    stages: Annotated[
        tuple[dict[str, Any], ...], JSON_ONLY, described("", "settings and work of each stage")
    ]


@dataclass(frozen=True)
class SearchStatistics:
    """Work and end of a search."""

    name: Annotated[str, described("", "the methods of the solver")]
    iterations: Annotated[int, described("1", "iterations of all starts and of the finish")]
    evaluations: Annotated[dict[str, int], described("1", "evaluations by function")]
    seconds: Annotated[float, described("s", "time of the search")]
    best_start: Annotated[int, described("1", "number of the best start")]
    finish: Annotated[
        dict[str, Any], described("", "factor `shrink` and `record` of the finish of the best")
    ]
    starts: Annotated[tuple[StartSummary, ...], described("", "the starts and hops")]
    ended: Annotated[str, described("", "reason for the end of the search")]
    cpu_seconds: Annotated[
        OpenNumber,
        described("s", "processor time of all results used, without building the problem"),
    ]
