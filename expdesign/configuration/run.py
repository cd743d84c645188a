"""The run file: a robot, the sections of the stages, and their resolved configuration."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, create_model, model_validator

from constraints.plugins import declared_classes
from expdesign.configuration.errors import format_number, refusal, require
from expdesign.configuration.fields import Distinct, FilledText, Name, Text, at_least, one_of, whole
from expdesign.configuration.limits import Limits
from expdesign.configuration.noise import NoiseDescription
from expdesign.configuration.parameters import TermDescription, chosen_terms, insert_terms
from expdesign.configuration.robot import ResolvedRobot, RobotSource
from expdesign.configuration.section import Section, StageSection
from expdesign.configuration.sections.data import DataSection
from expdesign.configuration.sections.design import DesignSection, MotionSection, TrajectorySection
from expdesign.configuration.sections.estimate import EstimateSection, MonteCarloSection
from expdesign.configuration.sections.experiment import ExperimentSection
from expdesign.configuration.sections.export import ExportSections
from expdesign.configuration.sections.motions import FeedforwardSection, ValidationMotion
from expdesign.configuration.sections.sweep import Sweep
from expdesign.configuration.tolerances import RobotTolerances
from expdesign.mechanism.term import parameters_of

RUN_FORMAT = 1
"""Format number of run files; larger after a change of their meaning."""

_DEFAULT_WORKERS = 2
_LARGEST_WORKERS = 256
_ADDRESS = require(
    re.compile(r"(?:tcp|tls|ucx|ws|wss)://[A-Za-z0-9._\[\]:-]{1,250}:\d{1,5}").fullmatch,
    "{quoted} is not the address of a scheduler",
    "tcp://host:port of a Dask cluster",
)

FigureFormat = Literal["png", "svg", "pdf"]


class ReportSettings(Section):
    """Settings of the report."""

    title: Text | None = None
    """Heading, by default the run's name."""
    figures: Annotated[
        tuple[Annotated[FigureFormat, one_of(FigureFormat)], ...], at_least(1, "formats"), Distinct
    ] = ("png", "svg")


_STAGE = object()
"""Mark of a section that names a stage of the run."""


class RunDescription(Section):
    """The content of a run file, in SI units.

    Every section is present, by default with its defaults; `stages` are the sections of stages in
    the file. Stages of plug-ins have further keys: `run_schema` returns the complete model.
    """

    format: Annotated[
        int | None, BeforeValidator(lambda v: v if v is None else format_number(v, RUN_FORMAT))
    ] = None
    """`RUN_FORMAT` in every written file; a user's file needs none."""
    name: Name
    description: Text = ""
    robot: RobotSource
    trajectory: TrajectorySection = TrajectorySection()
    design: Annotated[DesignSection, _STAGE] = DesignSection()
    motion: MotionSection = MotionSection()
    limits: Limits = Field(default_factory=dict)
    """In the user's notation; they override the robot's by key."""
    noise: NoiseDescription | None = None
    """Overrides the robot's by key."""
    tolerances: RobotTolerances | None = None
    """Override the robot's by key."""
    experiment: Annotated[ExperimentSection, _STAGE] = ExperimentSection()
    data: DataSection = DataSection()
    montecarlo: Annotated[MonteCarloSection, _STAGE] = MonteCarloSection()
    estimate: Annotated[EstimateSection, _STAGE] = EstimateSection()
    validation: Annotated[tuple[ValidationMotion, ...], at_least(0, "motions"), _STAGE] = Field(
        default=(), alias="validate"
    )
    feedforward: Annotated[FeedforwardSection, _STAGE] = FeedforwardSection()
    sweep: Annotated[Sweep | None, _STAGE] = None
    """Values in the user's notation."""
    export: Annotated[ExportSections, _STAGE] = ()
    report: Annotated[ReportSettings, _STAGE] = ReportSettings()
    workers: Annotated[int, whole(1, _LARGEST_WORKERS)] | None = None
    """Local processes; None with a scheduler."""
    scheduler: Annotated[FilledText, _ADDRESS] | None = None
    """Address of a Dask cluster."""

    @model_validator(mode="before")
    @classmethod
    def _fill_empty_sections(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        given = dict(data)
        for name, info in cls.model_fields.items():
            key = info.alias or name
            if key in data and data[key] is None and isinstance(info.default, Section | tuple):
                given[key] = [] if info.default == () else {}
        if given.get("workers") is None and given.get("scheduler") is None:
            given["workers"] = _DEFAULT_WORKERS
        return given

    @model_validator(mode="after")
    def _check_workers(self) -> RunDescription:
        if self.workers is not None and self.scheduler is not None:
            raise refusal(
                "workers and scheduler are both given",
                "workers or scheduler, not both",
                key="scheduler",
            )
        return self

    @property
    def controller_period(self) -> float:
        """Step of the machine's controller, s, by default one over the sampling."""
        return self.trajectory.controller_period or self.experiment.step

    @property
    def stages(self) -> tuple[str, ...]:
        """Stages that the file names, in the order of execution."""
        return tuple(
            stage
            for stage, name in _stage_fields().items()
            if name in self.model_fields_set and getattr(self, name) not in (None, ())
        )

    def section(self, stage: str) -> Any:
        """Return the section of a stage by its key."""
        return getattr(self, _stage_fields()[stage])

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the recipe for pickle, which finds no class with sections of plug-ins by name."""
        return _restore_run, (self.__getstate__(),)


@cache
def run_schema() -> type[RunDescription]:
    """Return the model of a run file with the sections of plug-ins' stages."""
    added: dict[str, Any] = {
        section.key: (Annotated[section, _STAGE], section())
        for section in declared_classes(StageSection)
    }
    if not added:
        return RunDescription
    return create_model(RunDescription.__name__, __base__=RunDescription, **added)


def _restore_run(state: dict[Any, Any]) -> RunDescription:
    kind = run_schema()
    run = kind.__new__(kind)
    run.__setstate__(state)
    return run


@cache
def _stage_fields() -> dict[str, str]:
    found = {
        info.alias or name: name
        for name, info in run_schema().model_fields.items()
        if _STAGE in info.metadata
    }
    return {key: found[key] for key in sorted(found, key=lambda key: key == "report")}


def stage_keys() -> tuple[str, ...]:
    """Return the keys of the sections of stages, in the order of execution.

    Examples
    --------
    >>> stage_keys()[:2], stage_keys()[-1]
    (('design', 'experiment'), 'report')
    """
    return tuple(_stage_fields())


_MEASURED_ON_THE_TWIN = ("experiment", "montecarlo")


@dataclass(frozen=True, eq=False)
class RunConfiguration:
    """A run with its robot, every default filled in."""

    run: RunDescription
    """Its `robot` is the resolved robot's description with the run's limits, noise and tolerances,
    so that its own `limits`, `noise` and `tolerances` are empty; paths are absolute."""
    robot: ResolvedRobot
    file: Path | None = None
    """The run file; None for a mapping."""
    warnings: tuple[str, ...] = ()
    """Warnings of robot and run."""
    twin_warnings: tuple[str, ...] = ()
    """The part of the warnings about measurements of the digital twin."""
    truth: ResolvedRobot | None = None
    """True machine of the digital twin, if it is not the robot: `experiment.truth` with the noise
    of robot and run in addition to its own."""
    grid: tuple[GridPoint, ...] = ()
    """Runs of the sweep; empty without one."""

    def warnings_before(self, stage: str) -> tuple[str, ...]:
        """Return the warnings for a stage that is executed alone.

        Those about the twin precede only its measurements.
        """
        omitted = () if stage in _MEASURED_ON_THE_TWIN else self.twin_warnings
        return tuple(text for text in self.warnings if text not in omitted)

    def with_section(self, section: str, **changes: Any) -> RunConfiguration:
        """Return the run with some keys of one section changed."""
        changed = getattr(self.run, section).model_copy(update=changes)
        return replace(self, run=self.run.model_copy(update={section: changed}))


@dataclass(frozen=True, eq=False)
class GridPoint:
    """One run of a sweep."""

    values: Mapping[str, Any]
    """By key path, in the user's notation."""
    name: str
    """Name from the values, also a valid folder name."""
    configuration: RunConfiguration
    """The run with these values and without the sweep."""


def add_terms(
    configuration: RunConfiguration, added: Sequence[TermDescription]
) -> RunConfiguration:
    """Return the run with further terms of its robot, their parameters at zero.

    Terms that the robot has already are ignored. The robot's identification is dropped, since it
    does not include the new terms.
    """
    robot = configuration.robot
    present = [term.name for term in robot.terms]
    lacking = [term for term in added if term.name not in present]
    if not lacking:
        return configuration
    description = robot.description
    described = insert_terms(description.terms, lacking)
    turning = description.platform_cardan_axes is not None
    terms = chosen_terms(described, description.platform, description.drive, turning=turning)

    def complete(values: Mapping[str, float]) -> dict[str, float]:
        return {one.name: values.get(one.name, 0.0) for one in parameters_of(terms)}

    # The robot's parameters include those of a payload, its description's do not.
    stated = {"terms": described, "parameters": complete(description.parameters)}
    changed = replace(
        robot,
        description=description.model_copy(update=stated | {"identification": None}),
        terms=terms,
        constants=tuple(c.value for term in described for c in term.constants.values()),
        parameters=complete(robot.parameters),
    )
    run = configuration.run.model_copy(update={"robot": changed.description})
    return replace(configuration, robot=changed, run=run)
