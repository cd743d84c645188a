"""`sweep.json` and its table: the designs of a grid, what each promises and what it cost."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, make_dataclass
from functools import cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from expdesign.configuration import InputError, RunConfiguration
from expdesign.configuration.grid import resolved_cell, short_path, value_text
from expdesign.configuration.run import GridPoint
from expdesign.configuration.sections.sweep import path_units
from expdesign.experiment.design_file import DesignFile
from expdesign.experiment.record import ParameterPrecision
from expdesign.experiment.several import FOLDER
from expdesign.runfolder import Contents, FolderRecord, OpenNumber, RowTable, RunFile, described

_WRITER = "`expdesign run` of a run with `sweep:`"
_VALUE = "value_"

FAILED, NOT_BEGUN, INTERRUPTED, BROKEN = "failed", "not begun", "interrupted", "limits broken"
"""Of the statuses of a row, those of no success."""


@dataclass(frozen=True)
class SweptDesign:
    """A design of a sweep; in its row the values of the grid stand before it."""

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
        described("%", "predicted std of the experiment over nominal value, median of parameters"),
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
    reason: Annotated[str, described("", "why there is no design, or none that is complete")] = ""

    @property
    def made(self) -> bool:
        """Whether there is a design, complete or not."""
        return bool(self.folder)

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
        cls,
        number: int,
        point: GridPoint,
        summary: DesignFile,
        parameters: Sequence[ParameterPrecision],
        reason: str,
    ) -> SweptDesign:
        """Describe the design of a point by what its folder holds."""
        percents = {p.name: p.rel_std_percent_experiment for p in parameters}
        known = {name: value for name, value in percents.items() if np.isfinite(value)}
        worst = max(known, key=lambda name: known[name], default="")
        return _row_type(tuple(point.values))(
            **_values(point),
            number=number,
            folder=f"{FOLDER}/{point.name}",
            status=summary.status,
            certified=all(limit.certified for limit in summary.limits.values()),
            criterion=summary.criterion,
            criterion_value=summary.criterion_value,
            log_det_information=summary.log_det_information,
            median_rel_std_percent=float(np.median(list(known.values()))) if known else math.nan,
            worst_rel_std_percent=known.get(worst, math.nan),
            worst_parameter=worst,
            period=summary.period,
            measuring_time=summary.period * summary.predicted_std.experiment.periods,
            cpu_seconds=summary.solver.cpu_seconds,
            iterations=summary.solver.iterations,
            evaluations=sum(summary.solver.evaluations.values()),
            reason=reason,
        )

    @classmethod
    def missing(cls, number: int, point: GridPoint, status: str, reason: str) -> SweptDesign:
        """Describe a point that has no design."""
        criterion = point.configuration.run.design.criterion
        return _row_type(tuple(point.values))(
            **_values(point),
            number=number,
            folder="",
            status=status,
            certified=False,
            criterion=criterion,
            reason=reason,
        )


def _values(point: GridPoint) -> dict[str, str]:
    return {f"{_VALUE}{k}": resolved_cell(path, point) for k, path in enumerate(point.values)}


@cache
def _row_type(paths: tuple[str, ...]) -> type[Any]:
    """Return the row of a grid: a text at each key path, then those of `SweptDesign`."""
    units = path_units()
    values = [
        (f"{_VALUE}{k}", Annotated[str, described(units[path], f"value of {path}", name=path)])
        for k, path in enumerate(paths)
    ]
    first = make_dataclass("GridValues", values, frozen=True)
    # Fields of the last base come first.
    return make_dataclass("SweepRow", [], bases=(SweptDesign, first), frozen=True)


def sweep_table(paths: Iterable[str]) -> RowTable[SweptDesign]:
    """Return the table of a grid with these key paths, a column each."""
    return RowTable("tables/sweep.csv", _WRITER, _row_type(tuple(paths)), some=True)


@dataclass(frozen=True, eq=False, kw_only=True)
class SweepFile(RunFile):
    """`sweep.json`: the grid, and how much of it is there."""

    FILE: ClassVar[str] = "sweep.json"
    WRITTEN_BY: ClassVar[str] = _WRITER
    grid: Annotated[
        dict[str, tuple[Any, ...]],
        described("", "by key path its values, as the run file states them"),
    ]
    points: Annotated[int, described("1", "of the grid: the rows of tables/sweep.csv")]
    made: Annotated[int, described("1", "those that have a design, complete or not")]
    interrupted: Annotated[bool, described("", "whether designs are missing or not complete")]


@dataclass(frozen=True, eq=False)
class SweepRecord(FolderRecord):
    """What a run folder holds of a sweep: its designs in the order of the grid."""

    summary: SweepFile
    designs: tuple[SweptDesign, ...]

    @classmethod
    def of(cls, configuration: RunConfiguration, designs: Sequence[SweptDesign]) -> SweepRecord:
        """Return the record of a sweep that came to these designs."""
        ends = {one.status for one in designs}
        summary = SweepFile(
            name=configuration.run.name,
            robot=configuration.robot.name,
            grid=dict(configuration.run.sweep or {}),
            points=len(designs),
            made=sum(one.made for one in designs),
            interrupted=bool(ends & {INTERRUPTED, NOT_BEGUN}),
        )
        return cls(summary, tuple(designs))

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read it from a run folder."""
        found = cls.fields_in(folder)
        summary: SweepFile = found["summary"]
        if unknown := set(summary.grid) - set(path_units()):
            message = f"{', '.join(sorted(unknown))} is no key path of a sweep"
            raise InputError(message, folder / SweepFile.FILE, key="grid")
        table = sweep_table(summary.grid)
        designs = table.read(folder)
        if len(designs) != summary.points or len(list(cls(summary, designs).labels)) != len(
            designs
        ):
            message = f"the table has {len(designs)} rows"
            allowed = f"one for every point of the grid in {SweepFile.FILE}"
            raise InputError(message, folder / table.file, allowed=allowed)
        return cls(summary, designs)

    def contents(self) -> Contents:
        """Yield the table of the designs."""
        yield sweep_table(self.summary.grid), self.designs

    @property
    def points(self) -> tuple[dict[str, Any], ...]:
        """The values of every design by key path, as the run file states them."""
        grid = self.summary.grid
        return tuple(dict(zip(grid, each, strict=True)) for each in product(*grid.values()))

    @property
    def varied(self) -> tuple[str, ...]:
        """The key paths by which designs differ; all where there is but one design."""
        grid = self.summary.grid
        return tuple(path for path, values in grid.items() if len(values) > 1) or tuple(grid)

    @property
    def most_precise(self) -> SweptDesign | None:
        """The design with the smallest median; None where there is none that is complete."""
        complete = [one for one in self.designs if one.complete]
        known = [one for one in complete if np.isfinite(one.median_rel_std_percent)]
        return min(known, key=lambda one: one.median_rel_std_percent, default=None)

    @property
    def labels(self) -> tuple[str, ...]:
        """Name every design by what differs: ``harmonics 3, criterion d``."""
        return tuple(point_label(point, self.varied) for point in self.points)


def point_label(point: Mapping[str, Any], paths: Iterable[str]) -> str:
    """Return the values of a point at these key paths, in words."""
    return ", ".join(f"{short_path(path)} {value_text(point[path])}" for path in paths)
