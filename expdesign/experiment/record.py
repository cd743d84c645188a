"""A design as its run folder holds it: one record, made of a result or read from the files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError, RunConfiguration, load_run, resolved_yaml
from expdesign.experiment.combinations import KnownCombination
from expdesign.experiment.design_file import DesignFile, Start
from expdesign.experiment.result import DesignResult
from expdesign.information.fisher import ScaledInformation
from expdesign.mechanism.catalogue import parameter_unit
from expdesign.motion.sampled import SampledMotion
from expdesign.recheck.limit_check import LimitCheck
from expdesign.robot import Robot, robot_from
from expdesign.runfolder import (
    ArrayTable,
    Column,
    FolderRecord,
    MatrixTable,
    MissingFileError,
    OpenNumber,
    RowKeys,
    RowTable,
    copied,
    described,
)
from expdesign.runfolder.files import RUN_FILE, write_text
from expdesign.runfolder.tables import Matrices
from expdesign.solver.search import SearchResult

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
    std_systematic: Annotated[
        OpenNumber,
        described("see unit", "share of the robot's tolerances, in both; empty without them"),
    ] = np.nan


@dataclass(frozen=True)
class Iteration:
    """An iteration of the optimiser."""

    start: Annotated[int, described("1", "number of the start")]
    kind: Annotated[str, described("", "random or hop")]
    stage: Annotated[str, described("", "blunt: rough search, sharp: refinement, hop, finish")]
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


@dataclass(frozen=True, eq=False)
class DesignRecord(FolderRecord):
    """A design with all that its run folder says of it: what figures and reports are made from.

    The motion is one period at the controller's rate, its end left out; the information, (k, k),
    is F of one period, SI.
    """

    TABLES: ClassVar = {
        "motion": ArrayTable("trajectory.csv", _WRITER, SampledMotion),
        "checks": RowTable("tables/limits.csv", _WRITER, LimitCheck, rows_of=("key",)),
        "parameters": RowTable(
            "tables/parameters.csv", _WRITER, ParameterPrecision, rows_of=("name",)
        ),
        "base_parameters": RowTable("tables/design_combinations.csv", _WRITER, KnownCombination),
        "starts": RowTable("tables/starts.csv", _WRITER, Start),
        "iterations": RowTable("tables/convergence.csv", _WRITER, Iteration),
        "eigenvalues": RowTable("tables/eigenvalues.csv", _WRITER, Eigenvalue, rows_of=("index",)),
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
        return copied(
            cls,
            result,
            summary=DesignFile.of(result),
            motion=SampledMotion.of(result.robot, result.trajectory, times),
            checks=result.check.limits,
            parameters=tuple(_parameters(result)),
            iterations=tuple(_iterations(result.search)),
            eigenvalues=tuple(_eigenvalues(result)),
        )

    @classmethod
    def read(cls, folder: Path) -> Self:
        """Read it from a run folder."""
        if not (folder / RUN_FILE).is_file():
            raise MissingFileError(folder / RUN_FILE, _WRITER)
        configuration = load_run(folder / RUN_FILE)
        found = cls.fields_in(folder)
        if not found["motion"].increases:
            message, allowed = "the times do not increase", "at least two increasing times"
            path = folder / cls.TABLES["motion"].file
            raise InputError(message, path, key="column t", allowed=allowed)
        table = cls.TABLES["matrices"]
        rows, names, information = table.read(folder)
        if not tuple(row for (row,) in rows) == names == found["summary"].parameters:
            message = f"rows and columns are not the parameters of {DesignFile.FILE}"
            raise InputError(message, folder / table.file)
        return cls(
            **found,
            configuration=configuration,
            robot=robot_from(configuration.robot),
            information=information,
        )

    @classmethod
    def row_keys(cls, found: Mapping[str, Any]) -> RowKeys:
        """Return the limits, the parameters, and the numbers of the eigenvalues."""
        summary: DesignFile = found["summary"]
        names = summary.parameters
        return {
            "checks": [(key,) for key in summary.limits],
            "parameters": [(name,) for name in names],
            "eigenvalues": [(number,) for number in range(1, len(names) + 1)],
        }

    def write(self, folder: Path) -> list[Path]:
        """Write the files of the run folder; return them."""
        written = [*super().write(folder), folder / RUN_FILE]
        write_text(folder / RUN_FILE, resolved_yaml(self.configuration))
        return written

    @property
    def base_parameters(self) -> tuple[KnownCombination, ...]:
        """The combinations that the experiment identifies; none of an earlier version."""
        return self.summary.base_parameters

    @property
    def starts(self) -> tuple[Start, ...]:
        """The starts and hops of the search, in their order."""
        return self.summary.solver.starts

    @property
    def matrices(self) -> Matrices:
        """The information with the names of its rows and columns."""
        names = self.summary.parameters
        return [([(name,) for name in names], names, self.information)]


def _parameters(result: DesignResult) -> Iterator[ParameterPrecision]:
    nominal = result.robot.description.parameters
    for name in result.parameter_names:
        one_period, experiment = result.per_period.std[name], result.experiment.std[name]
        size = abs(nominal[name]) or np.nan
        yield ParameterPrecision(
            name,
            parameter_unit(name),
            nominal[name],
            one_period,
            experiment,
            100 * one_period / size,
            100 * experiment / size,
            result.systematic.get(name, np.nan),
        )


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
