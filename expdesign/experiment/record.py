"""A design as its run folder holds it: one record, made of a result or read from the files."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator, PlainSerializer

from constraints import Limit
from constraints.arrays import Array
from expdesign.configuration import (
    InputError,
    RunConfiguration,
    load_run,
    resolved_yaml,
)
from expdesign.experiment.result import DesignResult, PredictedPrecision, whole
from expdesign.information.criteria import CRITERIA
from expdesign.information.fisher import ScaledInformation
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.motion.sampled import SampledMotion
from expdesign.recheck.judge import LimitCheck
from expdesign.robot import Robot, robot_from
from expdesign.runfolder import (
    ArrayTable,
    Column,
    FolderRecord,
    MatrixTable,
    MissingFileError,
    OpenNumber,
    RowTable,
    described,
)
from expdesign.runfolder.atomic import write_text
from expdesign.runfolder.table import Matrices
from expdesign.solver.search import SearchResult
from expdesign.trajectory import TrajectoryFile, fourier_keys

RUN_FILE = "run.yaml"
_WRITER = "`expdesign design`"


@dataclass(frozen=True)
class ParameterPrecision:
    """Nominal value and predicted standard deviations of a parameter that is judged."""

    name: Annotated[str, described("", "name", name="parameter")]
    unit: Annotated[str, described("", "SI unit of nominal value and standard deviations")]
    nominal: Annotated[OpenNumber, described("see unit", "nominal value")]
    std_per_period: Annotated[
        OpenNumber, described("see unit", "predicted standard deviation, one period")
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


@dataclass(frozen=True)
class Start:
    """A start or hop of the search; without times, so that it is the same for the same seed."""

    index: Annotated[
        int, described("1", "number of the start, from 1; hops go on counting", name="start")
    ]
    kind: Annotated[
        str, described("", "random, or hop; every second of those after the starts is random")
    ]
    criterion_value: Annotated[
        OpenNumber, described("", "criterion of the motion reached, within its limits")
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


@dataclass(frozen=True)
class Iteration:
    """An iteration of the optimiser."""

    start: Annotated[int, described("1", "number of the start")]
    kind: Annotated[str, described("", "random or hop")]
    stage: Annotated[str, described("", "stage of the continuation")]
    iteration: Annotated[int, described("1", "iteration, counted over the stages")]
    objective: Annotated[OpenNumber, described("", "smoothed criterion, as it is reported")]
    violation: Annotated[
        OpenNumber, described("1", "largest violation in the NLP, share of the limit's range")
    ]


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


@dataclass(frozen=True)
class TimedStart(Start):
    """A start in `design.json`: with its time, and what each of its stages did."""

    seconds: float
    stages: tuple[dict[str, Any], ...]


@dataclass(frozen=True)
class SolverRecord:
    """What the search did."""

    name: str
    iterations: int
    evaluations: dict[str, int]
    seconds: float
    best_start: int
    finish: dict[str, Any]
    starts: tuple[TimedStart, ...]


def _written(precision: PredictedPrecision) -> dict[str, float]:
    return {"samples": precision.samples, "periods": precision.periods, **precision.std}


def _read(keys: object) -> object:
    if not isinstance(keys, dict) or "samples" not in keys or "periods" not in keys:
        return keys
    std = {name: value for name, value in keys.items() if name not in {"samples", "periods"}}
    return {"samples": keys["samples"], "periods": keys["periods"], "std": std}


# In the file the parameters stand beside the samples and the periods.
_Precision = Annotated[PredictedPrecision, BeforeValidator(_read), PlainSerializer(_written)]


@dataclass(frozen=True)
class PredictedStd:
    """The standard deviations that a design promises."""

    per_period: _Precision
    experiment: _Precision


@dataclass(frozen=True, eq=False, kw_only=True)
class DesignFile(TrajectoryFile):
    """`design.json`: the trajectory, what was optimised and what was found."""

    units: Annotated[str, described("", "of all values: SI and radians")]
    name: Annotated[str, described("", "name of the run")]
    criterion: Annotated[str, described("", "what was optimised: d, a, e or condition")]
    scaling: Annotated[str, described("", "of the parameters in the criterion: si or nominal")]
    parameters: Annotated[tuple[str, ...], described("", "the parameters that are judged")]
    frequency_hz: Annotated[float, described("Hz", "base frequency")]
    period: Annotated[float, described("s", "of the motion")]
    controller_period: Annotated[float | None, described("s", "step of the controller")]
    samples_per_period: Annotated[
        int | float,
        described("1", "controller steps of one period, whole unless the frequency was fixed"),
    ]
    samples: Annotated[int, described("1", "samples of one period in the information")]
    log_det_information: Annotated[
        OpenNumber,
        described("", "log det F of the judged parameters: unsmoothed model, full Σ, SI"),
    ]
    criterion_value: Annotated[
        OpenNumber,
        described("", "log det, trace of F⁻¹, smallest eigenvalue or condition number"),
    ]
    predicted_std: Annotated[
        PredictedStd,
        described(
            "SI",
            "per_period and experiment: samples, periods and the standard deviation of each "
            "parameter",
        ),
    ]
    status: Annotated[str, described("", "converged, not converged, interrupted or limits broken")]
    status_text: Annotated[
        str, described("", "how the last stage of the best start ended, in words")
    ]
    solver: Annotated[
        SolverRecord,
        described(
            "",
            "name, iterations, evaluations, seconds of all starts, best_start, finish (shrink, "
            "record), starts: of each the columns of tables/starts.csv, seconds and stages",
        ),
    ]
    limits: Annotated[
        dict[str, dict[str, Any]],
        described(
            "",
            "for each limit: worst value, bound, unit, row, strut, time, violation, origin, "
            "certified, method",
        ),
    ]
    warnings: Annotated[tuple[str, ...], described("", "in words")] = ()

    @classmethod
    def upgraded(cls, data: dict[str, Any], written: int) -> dict[str, Any]:
        """Return what a file of format 0 holds: there the best start was not marked."""
        del written
        match data.get("solver"):
            case {"best_start": best, "starts": [*starts]}:
                marked = [
                    {**start, "best": start.get("index") == best}
                    for start in starts
                    if isinstance(start, dict)
                ]
                return {**data, "solver": {**data["solver"], "starts": marked}}
        return data


@dataclass(frozen=True, eq=False)
class DesignRecord(FolderRecord):
    """A design with all that its run folder says of it: what figures and reports are made from.

    Attributes
    ----------
    robot : Robot
        With the limits and the noise of the run.
    motion : SampledMotion
        One period at the controller's rate, its end left out.
    parameters : tuple of ParameterPrecision
        Those that are judged.
    iterations : tuple of Iteration
        Of all starts.
    information : (k, k)
        F of one period, SI.
    """

    TABLES: ClassVar = {
        "motion": ArrayTable("trajectory.csv", _WRITER, SampledMotion),
        "checks": RowTable("tables/limits.csv", _WRITER, LimitCheck),
        "parameters": RowTable("tables/parameters.csv", _WRITER, ParameterPrecision),
        "starts": RowTable("tables/starts.csv", _WRITER, Start),
        "iterations": RowTable("tables/convergence.csv", _WRITER, Iteration),
        "eigenvalues": RowTable("tables/eigenvalues.csv", _WRITER, Eigenvalue),
        "matrices": MatrixTable(
            "tables/information.csv",
            _WRITER,
            (Column("parameter", "", "row of F; the other columns are its columns, SI units"),),
            Column("<parameter>", "SI", "F of one period: column of this parameter"),
        ),
    }
    configuration: RunConfiguration
    robot: Robot
    summary: DesignFile
    motion: SampledMotion
    checks: tuple[LimitCheck, ...]
    parameters: tuple[ParameterPrecision, ...]
    iterations: tuple[Iteration, ...]
    eigenvalues: tuple[Eigenvalue, ...]
    information: Array

    @classmethod
    def of(cls, result: DesignResult) -> DesignRecord:
        """Return the record of a design."""
        times = result.trajectory.sample_times(round(result.samples_per_period))
        return cls(
            configuration=result.configuration,
            robot=result.robot,
            summary=_summary(result),
            motion=SampledMotion.of(result.robot, result.trajectory, times),
            checks=result.check.limits,
            parameters=tuple(_parameters(result)),
            iterations=tuple(_iterations(result.search)),
            eigenvalues=tuple(_eigenvalues(result)),
            information=result.information,
        )

    @classmethod
    def fields_in(cls, folder: Path, number: int | None = None) -> dict[str, Any]:
        """Read the fields."""
        if not (folder / RUN_FILE).is_file():
            raise MissingFileError(folder / RUN_FILE, _WRITER)
        configuration = load_run(folder / RUN_FILE)
        found = super().fields_in(folder, number)
        if not found["motion"].increases:
            message, allowed = "the times do not increase", "at least two increasing times"
            path = folder / cls.TABLES["motion"].file
            raise InputError(message, path, key="column t", allowed=allowed)
        table = cls.TABLES["matrices"]
        rows, names, information = table.read(folder)
        if not tuple(row for (row,) in rows) == names == found["summary"].parameters:
            message = f"rows and columns are not the parameters of {DesignFile.FILE}"
            raise InputError(message, folder / table.file)
        return {
            **found,
            "configuration": configuration,
            "robot": robot_from(configuration.robot),
            "information": information,
        }

    def write(self, folder: Path) -> list[Path]:
        """Write the files of the run folder; return them."""
        written = [*super().write(folder), folder / RUN_FILE]
        write_text(folder / RUN_FILE, resolved_yaml(self.configuration))
        return written

    @property
    def starts(self) -> tuple[Start, ...]:
        """The starts and hops of the search, in their order."""
        return self.summary.solver.starts

    @property
    def matrices(self) -> Matrices:
        """The information with the names of its rows and columns."""
        names = self.summary.parameters
        return [([(name,) for name in names], names, self.information)]

    def limit(self, key: str) -> Limit | None:
        """Return a limit of the run by its key, None when it does not limit."""
        return next((limit for limit in self.robot.limits if limit.key == key), None)


def _summary(result: DesignResult) -> DesignFile:
    trajectory, run = result.trajectory, result.configuration.run
    return DesignFile(
        **fourier_keys(trajectory),
        units="SI and radians",
        name=run.name,
        robot=result.robot.name,
        criterion=run.design.criterion,
        scaling=run.design.scaling,
        parameters=result.parameter_names,
        frequency_hz=trajectory.frequency,
        period=trajectory.period,
        controller_period=run.trajectory.controller_period,
        samples_per_period=whole(result.samples_per_period) or result.samples_per_period,
        samples=result.samples,
        log_det_information=result.log_det_information,
        criterion_value=result.criterion_value,
        predicted_std=PredictedStd(result.per_period, result.experiment),
        status=result.status,
        status_text=result.status_text,
        solver=_solver(result),
        limits={
            check.key: {
                **{name: getattr(check, name) for name in _WORST},
                "certified": False,
                "method": result.check.method,
            }
            for check in result.check.limits
        },
        warnings=result.warnings,
    )


_WORST = ("value", "bound", "unit", "row", "strut", "time", "violation", "origin")
"""What `design.json` says of the worst moment of a limit; see `LimitCheck`."""


def _solver(result: DesignResult) -> SolverRecord:
    search, finish = result.search, result.search.finished.record
    stages = [stage for start in search.starts for stage in start.stages]
    stages += [] if finish is None else [finish]
    evaluations: Counter[str] = Counter()
    for stage in stages:
        evaluations.update(stage.evaluations)
    criterion = CRITERIA[result.configuration.run.design.criterion]
    sign = 1 if criterion.larger_is_better else -1
    return SolverRecord(
        name="Ipopt through CasADi",
        iterations=sum(stage.iterations for stage in stages),
        evaluations=dict(evaluations),
        seconds=search.seconds,
        best_start=search.best.index,
        finish={
            "shrink": search.finished.shrink,
            "record": None if finish is None else asdict(finish),
        },
        starts=tuple(
            TimedStart(
                index=start.index,
                kind=start.kind,
                criterion_value=sign * start.merit,
                finished_value=sign * search.finished_merits.get(start.index, np.nan),
                iterations=start.iterations,
                converged=start.converged,
                status=start.status,
                best=start.index == search.best.index,
                seconds=start.seconds,
                stages=tuple(asdict(stage) for stage in start.stages),
            )
            for start in search.starts
        ),
    )


def _parameters(result: DesignResult) -> Iterator[ParameterPrecision]:
    nominal = result.robot.description.parameters
    for name in result.parameter_names:
        spreads = (result.per_period.std[name], result.experiment.std[name])
        size = abs(nominal[name]) or np.nan
        percents = (100 * std / size for std in spreads)
        yield ParameterPrecision(name, parameter_unit(name), nominal[name], *spreads, *percents)


def _iterations(search: SearchResult) -> Iterator[Iteration]:
    """Yield the iterations of every start; the finish goes on after those of its start."""
    for start in search.starts:
        finish = search.finished.trace if start is search.best else ()
        further = (replace(p, iteration=start.iterations + p.iteration) for p in finish)
        for point in (*start.trace, *further):
            yield Iteration(start.index, start.kind, **asdict(point))


def _eigenvalues(result: DesignResult) -> Iterator[Eigenvalue]:
    every = result.robot.parameter_names
    judged = [every.index(name) for name in result.parameter_names]
    sizes = result.robot.scales[judged]
    by_nominal = np.linalg.eigvalsh(result.information * np.multiply.outer(sizes, sizes))
    values = ScaledInformation.of(result.information).eigenvalues()
    for number, pair in enumerate(zip(values, by_nominal, strict=True), start=1):
        yield Eigenvalue(number, *map(float, pair))
