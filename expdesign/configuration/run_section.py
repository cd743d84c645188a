"""The run file: which robot does which experiment, stage by stage."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from expdesign.configuration.base import Section
from expdesign.configuration.data import DataSection
from expdesign.configuration.design import DesignSection
from expdesign.configuration.estimate import EstimateSection
from expdesign.configuration.experiment import ExperimentSection
from expdesign.configuration.export import ExportSections
from expdesign.configuration.failure import refusal, shown
from expdesign.configuration.montecarlo import MonteCarloSection
from expdesign.configuration.motion import MotionSection
from expdesign.configuration.noise_section import NoiseDescription
from expdesign.configuration.report import ReportSection
from expdesign.configuration.robot_section import RawMapping, RobotDescription
from expdesign.configuration.scalars import FilledText, Name, Text, at_least, whole
from expdesign.configuration.study import StudySection
from expdesign.configuration.trajectory import TrajectorySection
from expdesign.configuration.validation_section import ValidationMotion

_DEFAULT_WORKERS = 2
_LARGEST_WORKERS = 1024
_ADDRESS = re.compile(r"(?:tcp|tls|ucx|ws|wss)://[A-Za-z0-9._\[\]:-]{1,250}:\d{1,5}")

_STAGE = "names a stage of the run"
"""Marks the sections that do; their order is that in which the stages are done."""


def _address(value: str) -> str:
    if not _ADDRESS.fullmatch(value):
        raise refusal(
            f"{shown(value)} is not the address of a scheduler", "tcp://host:port of a Dask cluster"
        )
    return value


def _name_or_inline(value: object) -> str:
    return "(inline)" if isinstance(value, dict | RobotDescription) else "(name)"


class RunDescription(Section):
    """A run as its YAML file states it, in SI units.

    Every section is there, with its defaults when the file does not name it; `stages` tells
    which the file does name.

    Attributes
    ----------
    name : str
    robot : str or RobotDescription
        A robot that ships, a path relative to the run file, or the robot itself.
    trajectory, design, motion, experiment, data, estimate, montecarlo, report : section
    validation : tuple of ValidationMotion
        The key in the file is ``validate``.
    study : StudySection or None
    export : tuple of ExportSection
    limits : dict
        As written; they override the robot's key by key.
    noise : NoiseDescription or None
        Overrides the robot's key by key.
    workers : int or None
        Local processes; None when a scheduler is given.
    scheduler : str or None
        Address of a Dask cluster.
    """

    name: Name
    description: Text = ""
    robot: Annotated[
        Annotated[FilledText, Tag("(name)")] | Annotated[RobotDescription, Tag("(inline)")],
        Discriminator(_name_or_inline),
    ]
    trajectory: TrajectorySection = TrajectorySection()
    design: Annotated[DesignSection, _STAGE] = DesignSection()
    motion: MotionSection = MotionSection()
    limits: RawMapping = Field(default_factory=dict)
    noise: NoiseDescription | None = None
    experiment: Annotated[ExperimentSection, _STAGE] = ExperimentSection()
    data: DataSection = DataSection()
    montecarlo: Annotated[MonteCarloSection, _STAGE] = MonteCarloSection()
    estimate: Annotated[EstimateSection, _STAGE] = EstimateSection()
    validation: Annotated[tuple[ValidationMotion, ...], at_least(0, "motions"), _STAGE] = Field(
        default=(), alias="validate"
    )
    study: Annotated[StudySection | None, _STAGE] = None
    export: Annotated[ExportSections, _STAGE] = ()
    report: Annotated[ReportSection, _STAGE] = ReportSection()
    workers: Annotated[int, whole(1, _LARGEST_WORKERS)] | None = None
    scheduler: Annotated[FilledText, AfterValidator(_address)] | None = None

    @model_validator(mode="before")
    @classmethod
    def _empty_sections_take_defaults(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        given = dict(data)
        for name, field in cls.model_fields.items():
            key = field.alias or name
            if key in data and data[key] is None and isinstance(field.default, Section | tuple):
                given[key] = [] if isinstance(field.default, tuple) else {}
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
    def stages(self) -> tuple[str, ...]:
        """The stages that the file names, in the order in which they are done."""
        named = self.model_fields_set
        return tuple(
            field.alias or name
            for name, field in RunDescription.model_fields.items()
            if _STAGE in field.metadata and name in named and getattr(self, name) not in (None, ())
        )


STAGES = tuple(
    field.alias or name
    for name, field in RunDescription.model_fields.items()
    if _STAGE in field.metadata
)
"""Sections that name a stage of the run, in the order in which they are done."""
