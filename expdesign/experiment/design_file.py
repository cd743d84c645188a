"""`design.json`: the trajectory, what was optimised, and what the search did."""

from __future__ import annotations

from collections import Counter
from dataclasses import asdict, dataclass, field
from typing import Annotated, Any, Self

import numpy as np
from pydantic import BeforeValidator, PlainSerializer

from expdesign.experiment.combinations import KnownCombination
from expdesign.experiment.result import DesignResult, PredictedPrecision, whole
from expdesign.information.criteria import CRITERIA
from expdesign.runfolder import OpenNumber, copied, described
from expdesign.solver.finish import HumDistance
from expdesign.trajectory import TrajectoryFile, fourier_keys


@dataclass(frozen=True)
class Start:
    """A start or hop of the search; without times, so that it is the same for the same seed."""

    index: Annotated[
        int, described("1", "number of the start, from 1; hops go on counting", name="start")
    ]
    kind: Annotated[str, described("", "random, or hop")]
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
    ended: str = ""
    """Why the search went no further; empty in folders of earlier versions."""
    # Earlier versions did not measure it.
    cpu_seconds: OpenNumber = np.nan

    @classmethod
    def of(cls, result: DesignResult) -> Self:
        """Count what all starts and the finish did."""
        search, finish = result.search, result.search.finished.record
        stages = [stage for start in search.starts for stage in start.stages]
        stages += [] if finish is None else [finish]
        evaluations: Counter[str] = Counter()
        for stage in stages:
            evaluations.update(stage.evaluations)
        criterion = CRITERIA[result.configuration.run.design.criterion]
        sign = 1 if criterion.larger_is_better else -1
        return cls(
            name="dense interior point, then Ipopt through CasADi",
            iterations=sum(stage.iterations for stage in stages),
            evaluations=dict(evaluations),
            seconds=search.seconds,
            cpu_seconds=search.cpu_seconds,
            best_start=search.best.index,
            finish={
                "shrink": search.finished.shrink,
                "record": None if finish is None else asdict(finish),
            },
            starts=tuple(
                copied(
                    TimedStart,
                    start,
                    criterion_value=sign * start.merit if start.usable else np.nan,
                    finished_value=sign * search.finished_merits.get(start.index, np.nan),
                    best=start.index == search.best.index,
                    stages=tuple(asdict(stage) for stage in start.stages),
                )
                for start in search.starts
            ),
            ended=search.ended,
        )


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
    systematic: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class WorstMoment:
    """What `design.json` says of a limit: of its `LimitCheck`, and how that was found."""

    value: OpenNumber
    bound: OpenNumber
    unit: str
    row: str
    strut: int | None
    time: OpenNumber
    violation: OpenNumber
    origin: str
    certified: bool
    method: str
    stated: OpenNumber = np.nan
    reserve: float = 0.0
    # Earlier versions sampled, and proved nothing.
    proved: OpenNumber = np.nan
    cells: int = 0
    open_time: OpenNumber = 0.0


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
        described(
            "",
            "log det F of the judged parameters, with design.prior log det S of their change: "
            "unsmoothed model, full Σ, SI",
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
            "parameter that noise makes; systematic: the one that the robot's tolerances make, "
            "empty without them",
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
            "name, iterations, evaluations, seconds of all starts, cpu_seconds (of the processors, "
            "without building the problem), best_start, ended (why it went no further), finish "
            "(shrink, record), starts: of each the columns of tables/starts.csv, seconds and "
            "stages",
        ),
    ]
    limits: Annotated[
        dict[str, WorstMoment],
        described(
            "",
            "for each limit: worst value, bound, unit, row, strut, time, violation, origin, "
            "certified (kept at every instant, proved), method, stated (the bound before the "
            "reserve), reserve (share of the range), proved excess, cells of time that it took, "
            "time that stayed open [s]",
        ),
    ]
    base_parameters: Annotated[
        tuple[KnownCombination, ...],
        described("", "combinations that the experiment identifies; of each the table's columns"),
    ] = ()
    hum: Annotated[
        tuple[HumDistance, ...],
        described(
            "",
            "hums of the noise: frequency [Hz], the multiple of the motion's frequency next to "
            "it, distance [Hz], and the same in lines of the record (1 or more keeps away)",
        ),
    ] = ()
    warnings: Annotated[tuple[str, ...], described("", "in words")] = ()

    @classmethod
    def of(cls, result: DesignResult) -> Self:
        """Describe a result."""
        trajectory, run = result.trajectory, result.configuration.run
        return copied(
            cls,
            run.design,
            trajectory,
            result,
            **fourier_keys(trajectory),
            units="SI and radians",
            name=run.name,
            robot=result.robot.name,
            parameters=result.parameter_names,
            frequency_hz=trajectory.frequency,
            controller_period=run.trajectory.controller_period,
            samples_per_period=whole(result.samples_per_period) or result.samples_per_period,
            predicted_std=PredictedStd(result.per_period, result.experiment, result.systematic),
            solver=SolverRecord.of(result),
            limits={
                check.key: copied(WorstMoment, check, method=result.check.method)
                for check in result.check.limits
            },
        )

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
