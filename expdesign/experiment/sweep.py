"""The result of a sweep: the designs of a grid with their precision and their computing time."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, make_dataclass, replace
from functools import cache
from itertools import product
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import AfterValidator

from expdesign.configuration import RunConfiguration, quote
from expdesign.configuration.design import path_units
from expdesign.configuration.run import GridPoint
from expdesign.configuration.several_runs import resolved_cell, short_path, value_text
from expdesign.experiment.design import design
from expdesign.experiment.plan import Prediction, minutes_to_goals
from expdesign.experiment.result import DesignResult
from expdesign.runfolder import OpenNumber, RowTable, RunFile, StageResult, Table, described
from expdesign.workers import JobJournal, Monitor

FOLDER = "designs"
"""Folder of the designs' run folders, in that of the run."""

_VALUE, _GOAL = "value_", "goal_"

_INCOMPARABLE = ("design.parameters", "design.known", "design.prior", "design.others")
"""Paths that change the judged parameters, or the recordings that the precision is for."""
FAILED, NOT_BEGUN, INTERRUPTED, BROKEN = "failed", "not begun", "interrupted", "limits broken"
"""Statuses of a row without a complete design."""


@dataclass(frozen=True)
class SweptDesign:
    """A design of a sweep; the values of the grid precede it in its row."""

    number: Annotated[int, described("1", "of the design, from 1, in the order of the grid")]
    folder: Annotated[str, described("", "run folder of the design; empty where there is none")]
    status: Annotated[
        str,
        described("", "converged, not converged, limits broken, interrupted, failed or not begun"),
    ]
    certified: Annotated[bool, described("", "every limit is proved to be kept at every instant")]
    criterion: Annotated[str, described("", "what was optimised")]
    criterion_value: Annotated[OpenNumber, described("SI", "of the samples of one period")] = np.nan
    log_det_information: Annotated[
        OpenNumber,
        described("1", "log det F (S with a prior) of the samples of one period, SI"),
    ] = np.nan
    median_rel_std_percent: Annotated[
        OpenNumber,
        described(
            "%",
            "predicted std of the experiment (with tolerances the total) over nominal value, "
            "median of parameters",
        ),
    ] = np.nan
    equal_time_rel_std_percent: Annotated[
        OpenNumber,
        described(
            "%",
            "the same median for one measuring time of all designs: that of the fewest periods at "
            "the highest frequency of the grid; empty for the change since a prior",
        ),
    ] = np.nan
    worst_rel_std_percent: Annotated[OpenNumber, described("%", "the largest of them")] = np.nan
    worst_parameter: Annotated[str, described("", "that it is of")] = ""
    period: Annotated[OpenNumber, described("s", "of the motion")] = np.nan
    measuring_time: Annotated[
        OpenNumber, described("s", "of the experiment that is predicted: all its periods")
    ] = np.nan
    cpu_seconds: Annotated[
        OpenNumber, described("s", "processor time of starts, hops, finishes and proofs")
    ] = np.nan
    iterations: Annotated[int, described("1", "of the search")] = 0
    evaluations: Annotated[int, described("1", "of functions and derivatives, in the search")] = 0
    reason: Annotated[str, described("", "reason for a missing or incomplete design")] = ""

    @property
    def made(self) -> bool:
        """Whether there is a design, complete or not."""
        return bool(self.folder)

    @property
    def precision(self) -> float:
        """The median at equal measuring time, or without one that of the own experiment, %."""
        equal = self.equal_time_rel_std_percent
        return equal if np.isfinite(equal) else self.median_rel_std_percent

    def minutes(self, place: int) -> float:
        """Return the measuring time that reaches a goal, by its place; NaN where none does."""
        return float(getattr(self, f"{_GOAL}{place}", math.nan))

    @property
    def complete(self) -> bool:
        """Whether the design keeps its limits and its search came to its end."""
        return self.status not in (FAILED, BROKEN, INTERRUPTED, NOT_BEGUN)

    @property
    def wrong(self) -> bool:
        """Whether it failed: an interruption is no failure."""
        return self.status in (FAILED, BROKEN)

    @classmethod
    def of(
        cls, number: int, point: GridPoint, result: DesignResult, reason: str, seconds: float
    ) -> SweptDesign:
        """Return the row of the design of a point, with `seconds` of equal measuring time."""
        configuration, motion = point.configuration, result.trajectory
        equal, minutes = math.nan, dict[str, float]()
        if not configuration.run.design.is_change:
            prediction = Prediction.of(configuration, motion)
            equal = prediction.median_std_percent(seconds)
            minutes = minutes_to_goals(configuration, prediction)
        percents = {p.name: p.rel_std_percent for p in result.parameters}
        known = {name: value for name, value in percents.items() if np.isfinite(value)}
        worst = max(known, key=lambda name: known[name], default="")
        return _row(
            point,
            number=number,
            folder=f"{FOLDER}/{point.name}",
            status=result.status,
            certified=result.check.certified,
            criterion_value=result.criterion_value,
            log_det_information=result.log_det_information,
            median_rel_std_percent=float(np.median(list(known.values()))) if known else math.nan,
            equal_time_rel_std_percent=equal,
            worst_rel_std_percent=known.get(worst, math.nan),
            worst_parameter=worst,
            period=result.period,
            measuring_time=result.period * result.experiment.periods,
            cpu_seconds=result.solver.cpu_seconds,
            iterations=result.solver.iterations,
            evaluations=sum(result.solver.evaluations.values()),
            reason=reason,
            **{f"{_GOAL}{k}": value for k, value in enumerate(minutes.values())},
        )

    @classmethod
    def missing(cls, number: int, point: GridPoint, status: str, reason: str) -> SweptDesign:
        """Return the row of a point without a design."""
        return _row(point, number=number, folder="", status=status, certified=False, reason=reason)


def _row(point: GridPoint, **columns: Any) -> Any:
    values = {f"{_VALUE}{k}": resolved_cell(path, point) for k, path in enumerate(point.values)}
    run = point.configuration.run
    row = _row_type(tuple(point.values), tuple(run.goals))
    return row(criterion=run.design.criterion, **values, **columns)


@cache
def _row_type(paths: tuple[str, ...], goals: tuple[str, ...]) -> type[Any]:
    """Return the row of a grid: a text at each key path, then `SweptDesign`, then the goals."""
    units = path_units()
    values = [
        (f"{_VALUE}{k}", Annotated[str, described(units[path], f"value of {path}", name=path)])
        for k, path in enumerate(paths)
    ]
    first = make_dataclass("GridValues", values, frozen=True)
    last: list[Any] = [
        (
            f"{_GOAL}{k}",
            Annotated[
                OpenNumber,
                described("min", "measuring time that reaches it; empty: none", f"minutes_{name}"),
            ],
            math.nan,
        )
        for k, name in enumerate(goals)
    ]
    # Fields of the last base come first.
    return make_dataclass("SweepRow", last, bases=(SweptDesign, first), frozen=True)


def _sweep_table(result: SweepResult) -> RowTable[SweptDesign]:
    row = _row_type(tuple(result.grid), result.goals)
    return RowTable("tables/sweep.csv", result.WRITTEN_BY, row, some=True, rows_of=("number",))


def _key_path(path: str) -> str:
    if path not in path_units():
        raise ValueError(f"{quote(path)} is not a key path of a sweep")
    return path


@dataclass(frozen=True, eq=False, kw_only=True)
class SweepResult(RunFile, StageResult):
    """The designs of a sweep in the order of its grid."""

    FILE: ClassVar[str] = "sweep.json"
    WRITTEN_BY: ClassVar[str] = "`expdesign run` of a run with `sweep:`"

    grid: Annotated[
        dict[Annotated[str, AfterValidator(_key_path)], tuple[Any, ...]],
        described("", "by key path its values, as the run file states them"),
    ]
    goals: Annotated[
        tuple[str, ...], described("", "goals of the run, with a column minutes_… each")
    ] = ()
    designs: Annotated[
        tuple[SweptDesign, ...],
        Table(
            "tables/sweep.csv",
            rows_of=("number",),
            as_in=("numbers",),
            some=True,
            form=_sweep_table,
        ),
    ]

    @property
    def point_count(
        self,
    ) -> Annotated[
        int,
        described(
            "1",
            "of the grid: the rows of tables/sweep.csv; the last path's values change first",
            name="points",
        ),
    ]:
        """Number of points of the grid."""
        return len(self.designs)

    @property
    def made(self) -> Annotated[int, described("1", "those that have a design, complete or not")]:
        """Number of points that have a design, complete or not."""
        return sum(one.made for one in self.designs)

    @property
    def interrupted(
        self,
    ) -> Annotated[bool, described("", "whether designs are missing or not complete")]:
        """Whether designs are missing or not complete."""
        return any(one.status in (INTERRUPTED, NOT_BEGUN) for one in self.designs)

    @property
    def numbers(self) -> range:
        """Numbers of the points of the grid, from 1."""
        return range(1, len(self.points) + 1)

    @property
    def points(self) -> tuple[dict[str, Any], ...]:
        """The values of every design by key path, as the run file states them."""
        every = product(*self.grid.values())
        return tuple(dict(zip(self.grid, values, strict=True)) for values in every)

    @property
    def varied(self) -> tuple[str, ...]:
        """The key paths by which designs differ; all where there is but one design."""
        several = tuple(path for path, values in self.grid.items() if len(values) > 1)
        return several or tuple(self.grid)

    @property
    def comparable(self) -> bool:
        """Whether the precision of all designs is that of the same parameters and recordings."""
        return not any(len(self.grid.get(path, ())) > 1 for path in _INCOMPARABLE)

    @property
    def most_precise(self) -> SweptDesign | None:
        """The complete design with the smallest `precision`; None if there is none to compare."""
        complete = [one for one in self.designs if one.complete and self.comparable]
        known = [one for one in complete if np.isfinite(one.precision)]
        return min(known, key=lambda one: one.precision, default=None)

    @property
    def labels(self) -> tuple[str, ...]:
        """Name every design by what differs: ``harmonics 3, criterion d``."""
        return tuple(point_label(point, self.varied) for point in self.points)


def sweep_result(configuration: RunConfiguration, designs: Iterable[SweptDesign]) -> SweepResult:
    """Return the result of a sweep with these designs."""
    return SweepResult(
        name=configuration.run.name,
        robot=configuration.robot.name,
        grid=dict(configuration.run.sweep or {}),
        goals=tuple(configuration.run.goals),
        designs=tuple(designs),
    )


def point_label(point: Mapping[str, Any], paths: Iterable[str]) -> str:
    """Return the values of a point at these key paths, in words."""
    return ", ".join(f"{short_path(path)} {value_text(point[path])}" for path in paths)


def design_point(
    configuration: RunConfiguration, monitor: Monitor, journal: JobJournal | None = None
) -> DesignResult:
    """Design a point of the grid with the errors of `design`, in this process or on a cluster.

    Where the run states a scheduler the search of every design uses the whole cluster.
    """
    if configuration.run.scheduler is None:
        alone = configuration.run.model_copy(update={"workers": 1})
        configuration = replace(configuration, run=alone)
    return design(configuration, monitor, journal)
