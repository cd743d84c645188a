"""The run file: which robot does which experiment, stage by stage."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from expdesign.configuration.errors import format_number, refusal, require
from expdesign.configuration.fields import Distinct, FilledText, Name, Text, at_least, one_of, whole
from expdesign.configuration.limits import Limits
from expdesign.configuration.noise import NoiseDescription
from expdesign.configuration.parameters import TermDescription, chosen_terms
from expdesign.configuration.robot import ResolvedRobot, RobotSource
from expdesign.configuration.section import LATER, Section, file_kind
from expdesign.configuration.sections.data import DataSection
from expdesign.configuration.sections.design import DesignSection, MotionSection, TrajectorySection
from expdesign.configuration.sections.estimate import EstimateSection, MonteCarloSection
from expdesign.configuration.sections.experiment import ExperimentSection
from expdesign.configuration.sections.export import ExportSections
from expdesign.configuration.sections.motions import FeedforwardSection, ValidationMotion
from expdesign.configuration.sections.sweep import Sweep
from expdesign.configuration.tolerances import Tolerances
from expdesign.mechanism.catalogue import term_definitions
from expdesign.mechanism.term import parameters_of

RUN_FORMAT = 3
"""Number of the format of run files, one more whenever what stands in them changes its meaning.

2: a limit with a default that is not given is at its default, where it was not limited before.
3: so is `attitude`, which nothing lifts.
"""
_DEFAULT_WORKERS = 2
_LARGEST_WORKERS = 256
_ADDRESS = require(
    re.compile(r"(?:tcp|tls|ucx|ws|wss)://[A-Za-z0-9._\[\]:-]{1,250}:\d{1,5}").fullmatch,
    "{shown} is not the address of a scheduler",
    "tcp://host:port of a Dask cluster",
)
FigureFormat = Literal["png", "svg", "pdf"]


class ReportSection(Section):
    """Settings of the report."""

    title: Text | None = None
    """Heading; default: the run's name."""
    figures: Annotated[
        tuple[Annotated[FigureFormat, one_of(FigureFormat)], ...], at_least(1, "formats"), Distinct
    ] = ("png", "svg")


def _format(value: object) -> int | None:
    return None if value is None else format_number(value, RUN_FORMAT)


_STAGE = object()


class RunDescription(Section):
    """A run as its YAML file states it, in SI units.

    Every section is there, with its defaults when the file does not name it; `stages` tells
    which the file does name.
    """

    format: Annotated[int | None, BeforeValidator(_format)] = None
    """`RUN_FORMAT` in every file that is written; a user's file needs none."""
    name: Name
    description: Text = ""
    robot: RobotSource
    trajectory: TrajectorySection = TrajectorySection()
    design: Annotated[DesignSection, _STAGE] = DesignSection()
    motion: MotionSection = MotionSection()
    limits: Limits = Field(default_factory=dict)
    """As written; they override the robot's key by key."""
    noise: NoiseDescription | None = None
    """Overrides the robot's key by key."""
    tolerances: Tolerances | None = None
    """Override the robot's key by key."""
    experiment: Annotated[ExperimentSection, _STAGE] = ExperimentSection()
    data: DataSection = DataSection()
    montecarlo: Annotated[MonteCarloSection, _STAGE] = MonteCarloSection()
    estimate: Annotated[EstimateSection, _STAGE] = EstimateSection()
    validation: Annotated[tuple[ValidationMotion, ...], at_least(0, "motions"), _STAGE] = Field(
        default=(), alias="validate"
    )
    feedforward: Annotated[FeedforwardSection, _STAGE, LATER] = FeedforwardSection()
    sweep: Annotated[Sweep | None, _STAGE] = None
    """Values as they are written."""
    export: Annotated[ExportSections, _STAGE] = ()
    report: Annotated[ReportSection, _STAGE] = ReportSection()
    workers: Annotated[int, whole(1, _LARGEST_WORKERS)] | None = None
    """Local processes; None when a scheduler is given."""
    scheduler: Annotated[FilledText, _ADDRESS] | None = None
    """Address of a Dask cluster."""

    @model_validator(mode="before")
    @classmethod
    def _empty_sections_take_defaults(cls, data: Any) -> Any:
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
    def _workers_or_scheduler(self) -> RunDescription:
        if self.workers is not None and self.scheduler is not None:
            raise refusal(
                "workers and scheduler are both given",
                "workers or scheduler, not both",
                key="scheduler",
            )
        return self

    @property
    def controller_period(self) -> float:
        """Step of the machine's controller, s; one over the sampling where none is given."""
        return self.trajectory.controller_period or self.experiment.step

    @property
    def stages(self) -> tuple[str, ...]:
        """The stages that the file names, in the order in which they are done."""
        return tuple(
            stage
            for stage, name in _STAGE_FIELDS.items()
            if name in self.model_fields_set and getattr(self, name) not in (None, ())
        )


RUN_FILE_KIND = file_kind("run file", RunDescription)
"""What a file is that describes a run."""
_STAGE_FIELDS = {
    info.alias or name: name
    for name, info in RunDescription.model_fields.items()
    if _STAGE in info.metadata
}
STAGES = tuple(_STAGE_FIELDS)
"""Sections that name a stage of the run, in the order in which they are done."""

_MEASURED_ON_THE_TWIN = ("experiment", "montecarlo")


@dataclass(frozen=True, eq=False)
class RunConfiguration:
    """A run with its robot, every default filled in."""

    run: RunDescription
    """Its `robot` is the resolved robot's description with the run's own limits, noise and
    tolerances in it, its own `limits`, `noise` and `tolerances` are therefore empty; paths are
    absolute."""
    robot: ResolvedRobot
    file: Path | None = None
    """The run file; None for a mapping."""
    warnings: tuple[str, ...] = ()
    """Those of the robot and those of the run."""
    of_the_twin: tuple[str, ...] = ()
    """Those of the warnings that are about what the digital twin measures."""
    truth: ResolvedRobot | None = None
    """The machine that the digital twin is, where it is not the robot: `experiment.truth` with
    the noise that the robot and the run state beside its own."""

    grid: tuple[GridPoint, ...] = ()
    """The runs that the sweep is of; none without one."""

    def warnings_before(self, stage: str) -> tuple[str, ...]:
        """Return the warnings that a stage by itself is to be told with.

        Those of the twin are told where it measures; what uses its recordings repeats none of them.
        """
        told = () if stage in _MEASURED_ON_THE_TWIN else self.of_the_twin
        return tuple(text for text in self.warnings if text not in told)

    def with_section(self, section: str, **changes: Any) -> RunConfiguration:
        """Return the run with keys of one of its sections changed."""
        changed = getattr(self.run, section).model_copy(update=changes)
        return replace(self, run=self.run.model_copy(update={section: changed}))


@dataclass(frozen=True, eq=False)
class GridPoint:
    """One run of a sweep."""

    values: Mapping[str, Any]
    """By key path, as they are written."""
    name: str
    """Made of the values, and safe as that of a folder."""
    configuration: RunConfiguration
    """The run with these values and without the sweep."""


def with_added_terms(
    configuration: RunConfiguration, added: Sequence[TermDescription]
) -> RunConfiguration:
    """Return the run with further terms of its robot, their parameters at zero.

    Those without signs of friction come before the first that has some: the load of the actuators
    counts them for the others. Terms that it has already are left alone. What an earlier estimate
    knew is dropped: it did not know of them.
    """
    present = [term.name for term in configuration.robot.terms]
    lacking = [term for term in added if term.name not in present]
    if not lacking:
        return configuration
    robot = _with_terms(configuration.robot, lacking)
    run = configuration.run.model_copy(update={"robot": robot.description})
    return replace(configuration, robot=robot, run=run)


def _with_terms(robot: ResolvedRobot, added: Sequence[TermDescription]) -> ResolvedRobot:
    about = robot.description
    described = _in_order(about.terms, added)
    turning = about.platform_cardan_axes is not None
    terms = chosen_terms(described, about.platform, about.drive, turning=turning)

    def known(values: Mapping[str, float]) -> dict[str, float]:
        return {one.name: values.get(one.name, 0.0) for one in parameters_of(terms)}

    stated = {"terms": described, "parameters": known(about.parameters), "identification": None}
    return replace(
        robot,
        description=about.model_copy(update=stated),
        terms=terms,
        constants=tuple(c.value for term in described for c in term.constants.values()),
        # Those of a payload are in these, and not in what the file states.
        parameters=known(robot.parameters),
    )


def _in_order(
    own: Sequence[TermDescription], added: Sequence[TermDescription]
) -> tuple[TermDescription, ...]:
    """Return terms with further ones where they belong."""
    found = list(own)
    for term in sorted(added, key=lambda one: bool(term_definitions()[one.name].rates)):
        names = [one.name for one in found]
        place = len(names)
        if not term_definitions()[term.name].rates:
            place = next(
                (k for k, name in enumerate(names) if term_definitions()[name].rates), place
            )
        if (partner := term_definitions()[term.name].beside) in names:
            place = max(place, names.index(partner) + 1)
        found.insert(place, term)
    return tuple(found)
