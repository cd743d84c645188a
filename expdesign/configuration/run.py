"""The run file: its sections, the resolved configuration, and both as YAML for `load_run`."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, create_model, model_validator

from constraints.plugins import declared_classes
from expdesign.configuration import schema
from expdesign.configuration.design import (
    DesignSection,
    Effort,
    Goals,
    MotionSection,
    Sweep,
    TrajectorySection,
)
from expdesign.configuration.document import document_from_mapping
from expdesign.configuration.errors import format_number, refusal, require
from expdesign.configuration.estimate import DataSection, EstimateSection, MonteCarloSection
from expdesign.configuration.experiment import (
    ExperimentSection,
    FeedforwardSection,
    ValidationMotion,
)
from expdesign.configuration.export import ExportSections
from expdesign.configuration.limits import Limits
from expdesign.configuration.noise import NoiseDescription
from expdesign.configuration.parameters import TermDescription, chosen_terms, insert_terms
from expdesign.configuration.robot import ResolvedRobot, RobotDescription, RobotSource
from expdesign.configuration.tolerances import RobotTolerances
from expdesign.mechanism.term import parameters_of
from expdesign.mechanism.terms.actuator_forces import BACK_EMF

RUN_FORMAT = 1
"""Format number of run files; larger after a change of their meaning."""
_DEFAULT_WORKERS = 2
_LARGEST_WORKERS = 256
_ADDRESS = require(
    re.compile(r"(?:tcp|tls|ucx|ws|wss)://[A-Za-z0-9._\[\]:-]{1,250}:\d{1,5}").fullmatch,
    "{quoted} is not the address of a scheduler",
    "tcp://host:port of a Dask cluster",
)


class ReportSettings(schema.Section):
    """Settings of the report."""

    title: str | None = None
    """Heading, by default the run's name."""
    figures: Annotated[
        tuple[Literal["png", "svg", "pdf"], ...], schema.at_least(1, "formats"), schema.Distinct
    ] = ("png", "svg")


_STAGE = object()
"""Mark of a section that names a stage of the run."""


class RunDescription(schema.Section):
    """The content of a run file, in SI units.

    Every section is present, by default with its defaults; `stages` are the sections of stages in
    the file. Stages of plug-ins have further keys: `run_schema` returns the complete model.
    """

    format: Annotated[
        int | None, BeforeValidator(lambda v: v if v is None else format_number(v, RUN_FORMAT))
    ] = None
    """`RUN_FORMAT` in every written file; a user's file needs none."""
    name: schema.Name
    description: str = ""
    robot: RobotSource
    trajectory: TrajectorySection = TrajectorySection()
    design: Annotated[DesignSection, _STAGE] = DesignSection()
    goals: Annotated[Goals, _STAGE] = Field(default_factory=dict)
    """Wanted standard deviations by quantity or parameter, in the user's notation."""
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
    validation: Annotated[tuple[ValidationMotion, ...], schema.at_least(0, "motions"), _STAGE] = (
        Field(default=(), alias="validate")
    )
    feedforward: Annotated[FeedforwardSection, _STAGE] = FeedforwardSection()
    sweep: Annotated[Sweep | None, _STAGE] = None
    """Values in the user's notation."""
    export: Annotated[ExportSections, _STAGE] = ()
    report: Annotated[ReportSettings, _STAGE] = ReportSettings()
    workers: Annotated[int, schema.whole(1, _LARGEST_WORKERS)] | None = None
    """Local processes; None with a scheduler."""
    scheduler: Annotated[schema.FilledText, _ADDRESS] | None = None
    """Address of a Dask cluster."""

    @property
    def wanted(self) -> tuple[str, ...]:
        """Names of the goals and of the quantities of interest."""
        interest = self.design.interest
        return (*self.goals, *(interest if isinstance(interest, tuple) else ()))

    @model_validator(mode="before")
    @classmethod
    def _fill_empty_sections(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        given = dict(data)
        for name, info in cls.model_fields.items():
            key = info.alias or name
            if (
                key in data
                and data[key] is None
                and isinstance(info.default, schema.Section | tuple)
            ):
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
        """Return the recipe for pickle: it finds no class with sections of plug-ins by name."""
        return _restore_run, (self.__getstate__(),)


@cache
def run_schema() -> type[RunDescription]:
    """Return the model of a run file with the sections of plug-ins' stages."""
    added: dict[str, Any] = {
        section.key: (Annotated[section, _STAGE], section())
        for section in declared_classes(schema.StageSection)
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
    >>> stage_keys()[:3], stage_keys()[-1]
    (('design', 'goals', 'experiment'), 'report')
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

    def __repr__(self) -> str:
        """Return the names of run and robot, and the number of warnings."""
        names, count = f"{self.run.name!r}, robot {self.robot.name!r}", len(self.warnings)
        return f"RunConfiguration({names}, {count} warning{'s' * (count != 1)})"

    @property
    def records_voltages(self) -> bool:
        """Whether the forces of its recordings come from voltages of the motors."""
        return self.run.data.voltages and self.robot.drive.motor is not None

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

    def with_search(self, effort: str | None = None, seed: int | None = None) -> RunConfiguration:
        """Return the run with an effort, whose starts and hops replace stated ones, and a seed.

        None keeps the run's own; a point of a sweep keeps the values that are swept.

        Raises
        ------
        InputError
            The effort is unknown, or the seed is out of range.
        """
        stated = {"effort": effort, "seed": seed}
        given = {key: value for key, value in stated.items() if value is not None}
        if not given:
            return self
        document = document_from_mapping({"design": given})
        checked = schema.validate(DesignSection, document.data["design"], document, ("design",))
        keys = (*given, *(Effort._fields if "effort" in given else ()))
        changes = {key: getattr(checked, key) for key in keys}
        changed = self.with_section("design", **changes)
        changed.run.model_fields_set.intersection_update(self.run.model_fields_set)
        swept = {path.removeprefix("design.") for path in self.run.sweep or {}}
        swept |= set(Effort._fields) if "effort" in swept else set()
        own = {key: value for key, value in changes.items() if key not in swept}
        points = (
            replace(point, configuration=point.configuration.with_section("design", **own))
            for point in self.grid
        )
        return replace(changed, grid=tuple(points))


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
    tolerances = robot.tolerances and robot.tolerances.without_terms(one.name for one in lacking)
    stated = {
        "terms": described,
        "parameters": complete(description.parameters),
        "tolerances": tolerances,
        "identification": None,
    }
    changed = replace(
        robot,
        description=description.model_copy(update=stated),
        tolerances=tolerances,
        terms=terms,
        constants=tuple(c.value for term in described for c in term.constants.values()),
        parameters=complete(robot.parameters),
    )
    run = configuration.run.model_copy(update={"robot": changed.description})
    return replace(configuration, robot=changed, run=run)


def add_back_emf(configuration: RunConfiguration, damping: Sequence[float]) -> RunConfiguration:
    """Return the run for forces that come from voltages: the damping, (6,), N s/m, is known."""
    values = dict(zip((one.name for one in BACK_EMF.parameters), damping, strict=True))
    changed = add_terms(configuration, [TermDescription(name=BACK_EMF.name)])
    parameters = {**changed.robot.parameters, **values}
    earlier = configuration.robot.description.identification
    update = {"identification": earlier and earlier.for_parameters(parameters)}
    robot = replace(
        changed.robot,
        description=changed.robot.description.model_copy(update=update),
        parameters=parameters,
        forces_of_voltages=True,
    )
    fixed = {**changed.run.estimate.fixed, **dict.fromkeys(values)}
    return replace(changed, robot=robot).with_section("estimate", fixed=fixed)


_HEADER = """\
# Resolved configuration: every value that is used, with the defaults. Values are in SI units
# (m, s, kg, N, rad; frequencies in Hz). Loading this file gives the same configuration.
"""
_ROBOT_HEADER = """\
# Robot file from an estimate: values in SI units (m, s, kg, N, rad), their covariance under
# `identification`. Name it as `robot:` of a run file.
"""
_UNNAMED = "# Sections that this run does not name, with their defaults:\n"
_EXPERIMENT_IS_USED = (
    "# The design uses periods and sampling of the experiment for the predicted precision.\n"
)
_DESIGNS = "# `expdesign run` designs, with the values of design below, since no stage is named.\n"
_WIDTH = 96
_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_./-]*")
_WORDS = re.compile(r"[^\s]+(?: [^\s]+)*")
_RESERVED = ("null", "true", "false", "yes", "no", "on", "off")


def resolved_yaml(configuration: RunConfiguration) -> str:
    """Return the complete configuration as YAML text.

    The robot is a mapping, with the run's limits, noise and tolerances. Sections of stages that the
    run does not name, and unused sections of data, are comments: `load_run` of a file with this
    text returns an equal configuration, to the last bit, with the same stages.
    """
    data = configuration.run.model_dump(by_alias=True)
    stages = configuration.run.stages
    unnamed = [stage for stage in stage_keys() if stage not in stages]
    if "data" not in configuration.run.model_fields_set and "estimate" not in stages:
        unnamed.append("data")
    if configuration.run.sweep is not None:
        # Values that follow from swept keys are derived again at every point.
        for section, key in (("trajectory", "controller_period"), ("design", "smoothing")):
            if key not in getattr(configuration.run, section).model_fields_set:
                data[section][key] = None
    # Empty, since they are part of the robot.
    data = {key: data[key] for key in data if key not in ("limits", "noise", "tolerances")}
    parts = [_HEADER]
    for key, value in data.items():
        if key not in unnamed:
            parts += ["\n" if isinstance(value, dict) else "", *yaml_lines(key, value, 0)]
    if unnamed:
        parts += ["\n", _UNNAMED]
        designs = not stages or "design" in stages
        parts += [_DESIGNS] if not stages else []
        parts += [_EXPERIMENT_IS_USED] if designs and "experiment" in unnamed else []
        for key in unnamed:
            parts += [f"# {line}" for line in yaml_lines(key, data[key], 0)]
    return "".join(parts)


def robot_yaml(robot: RobotDescription) -> str:
    """Return the text of a robot's file, exact to the last bit."""
    data = {
        key: value for key, value in robot.model_dump(by_alias=True).items() if value is not None
    }
    lines = (line for key, value in data.items() for line in yaml_lines(key, value, 0))
    return "".join([_ROBOT_HEADER, *lines])


def yaml_lines(key: str, value: Any, indent: int) -> Iterator[str]:
    """Yield the lines of one key of a mapping with an indentation."""
    margin = " " * indent
    name = _text(key)
    if isinstance(value, dict) and value:
        yield f"{margin}{name}:\n"
        for inner, item in value.items():
            yield from yaml_lines(inner, item, indent + 2)
    elif isinstance(value, list | tuple) and any(isinstance(i, dict | list | tuple) for i in value):
        yield f"{margin}{name}:\n"
        for item in value:
            yield f"{margin}  - {_flow(item)}\n"
    elif isinstance(value, str) and len(value) > _WIDTH and _folds(value):
        yield f"{margin}{name}: >-\n"
        width = _WIDTH - indent - 2
        for line in textwrap.wrap(
            value, width, break_long_words=False, break_on_hyphens=False, expand_tabs=False
        ):
            yield f"{margin}  {line}\n"
    else:
        yield f"{margin}{name}: {_flow(value)}\n"


def _folds(text: str) -> bool:
    return text.isprintable() and _WORDS.fullmatch(text) is not None


def _flow(value: Any) -> str:
    """Return a value on one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_text(k)}: {_flow(v)}" for k, v in value.items()) + "}"
    numbers = isinstance(value, list | tuple) and all(isinstance(i, int | float) for i in value)
    if isinstance(value, list | tuple) and not numbers:
        return "[" + ", ".join(_flow(item) for item in value) + "]"
    return _text(value) if isinstance(value, str) else json.dumps(value)


def _text(text: str) -> str:
    if _PLAIN.fullmatch(text) and text.lower() not in _RESERVED:
        return text
    quoted = text.replace("\\", "\\\\").replace('"', '\\"').replace("\t", "\\t")
    shown = (c if c.isprintable() else f"\\U{ord(c):08x}" for c in quoted)
    return f'"{"".join(shown)}"'
