"""Loading a run: from a file, a mapping or a validated model to a complete configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any, TypeVar

import numpy as np

from expdesign.configuration.consistency import (
    aliased_hum_warnings,
    identification_of,
    inconsistencies,
    payload_problems,
    prior_machine,
    selection_warnings,
)
from expdesign.configuration.design import TaskSection
from expdesign.configuration.document import (
    Document,
    Located,
    absolute,
    document_from_mapping,
    find_file,
    read_yaml,
)
from expdesign.configuration.errors import InputError, Problem, collect
from expdesign.configuration.experiment import ValidationMotion
from expdesign.configuration.robot import (
    ResolvedRobot,
    RobotDescription,
    add_payload,
    as_general,
    read_robot,
    resolve_robot,
)
from expdesign.configuration.run import RUN_FORMAT, RunConfiguration, RunDescription, run_schema
from expdesign.configuration.schema import Section, offered_keys, validate
from expdesign.configuration.several_runs import grid_points
from expdesign.library import robot_files, run_files

S = TypeVar("S", bound=Section)

ConfigurationLike = str | PathLike[str] | Mapping[str, Any] | RunDescription | RunConfiguration
"""Sources for `load_run`."""

_ROBOT_KEY = "base_joints"
"""A key of robot files that run files do not have."""


def load_run(source: ConfigurationLike) -> RunConfiguration:
    """Load a run with its robot, in SI units with every default.

    Parameters
    ----------
    source : str, path-like, mapping, RunDescription or RunConfiguration
        The name of an included run, the path of a run file, or the content of such a file.
        Relative paths in a mapping start from the current folder. A configuration is returned
        unchanged.

    Raises
    ------
    InputError
        With all problems of the run and of its robot.

    Examples
    --------
    >>> load_run({"name": "first", "robot": "palida"}).run.trajectory.harmonics
    5
    """
    if isinstance(source, RunConfiguration):
        return source
    return _load(_document(source))


def _document(source: str | PathLike[str] | Mapping[str, Any] | RunDescription) -> Document:
    if isinstance(source, RunDescription):
        # In the notation of a file, so that it names the same stages.
        source = source.model_dump(by_alias=True, include=source.model_fields_set)
    if isinstance(source, Mapping):
        return document_from_mapping(source)
    if isinstance(source, str) and source in robot_files().keys() - run_files().keys():
        raise InputError(f"'{source}' is a robot, not a run", allowed=_run_of(source))
    path = find_file(source, "run", run_files())
    document = read_yaml(path, "run file", offered_keys(run_schema()))
    if _ROBOT_KEY in document.data:
        message = "this is a robot file, not a run file"
        raise InputError(message, document.file, allowed=_run_of(document.label))
    return document


def _run_of(robot: str) -> str:
    return f"a file of two lines, `name: first` and `robot: {robot}`"


def _load(document: Document) -> RunConfiguration:
    run: RunDescription | None = None
    problems: list[Problem] = []
    try:
        run = validate(run_schema(), document.data, document)
    except InputError as error:
        problems += error.problems
    reading = _Reading(document, problems)
    # An invalid run does not hide the problems of its robot.
    named = document.data.get("robot") if run is None else run.robot
    source = reading.find_robot(named, "robot")
    robot = None if source is None else reading.resolve(source, run)
    if run is None or source is None or robot is None:
        raise InputError(problems)
    truth = reading.true_machine(run, source)
    problems += inconsistencies(run, robot, document)
    priors = reading.priors(run, robot)
    if problems:
        raise InputError(problems)
    differing = () if truth is None else truth.warnings
    twin_warnings = (
        *aliased_hum_warnings(run),
        *(f"experiment.truth: {text}" for text in differing if text not in robot.warnings),
    )
    prior_warnings = (
        f"{section}.prior: {text}"
        for section, machines in priors.items()
        for machine in (machines if isinstance(machines, tuple) else (machines,))
        for text in identification_of(machine).warnings
    )
    own = (
        *robot.warnings,
        *document.warnings,
        *prior_warnings,
        *_noise_warnings(run, robot),
        *selection_warnings(run),
    )
    payload = run.experiment.payload
    return RunConfiguration(
        run=_complete(run, robot, truth, document, priors),
        robot=add_payload(robot, payload),
        file=document.file,
        warnings=(*own, *twin_warnings),
        twin_warnings=twin_warnings,
        truth=None if truth is None else add_payload(truth, payload),
        grid=() if run.sweep is None else grid_points(run.sweep, robot, document, _load),
    )


@dataclass(frozen=True)
class _Reading:
    """Robots of a run file, and the problems found so far; each method adds its own."""

    document: Document
    problems: list[Problem]

    def find_robot(self, named: object, *key: str) -> Located[RobotDescription] | None:
        """Return the robot at a key of the run, inline or by its name."""
        if isinstance(named, RobotDescription):
            return Located(named, self.document, key)
        if not isinstance(named, str) or not named.strip():
            return None
        path = None
        try:
            path = find_file(named, "robot", robot_files(), self.document.folder)
            return read_robot(path)
        except InputError as error:
            if path is not None and path.is_file():
                self.problems.extend(error.problems)
                return None
            file = "" if path is None else f"{path}: "
            for one in error.problems:  # the fault is at the key with its name
                message = f"{file}{one.message}"
                self.problems.append(self.document.problem(key, message, one.allowed, one.nearest))
            return None

    def resolve(
        self, source: Located[RobotDescription], run: RunDescription | None
    ) -> ResolvedRobot | None:
        """Return the robot with the run's limits, noise and tolerances."""
        with collect(self.problems):
            if run is None:
                return resolve_robot(source)
            return resolve_robot(
                source,
                [Located(run.limits, self.document, ("limits",))],
                self._located(run.noise, "noise"),
                self._located(run.tolerances, "tolerances"),
                run.experiment.sampling,
            )
        return None

    def _located(self, value: S | None, key: str) -> list[Located[S]]:
        return [] if value is None else [Located(value, self.document, (key,))]

    def true_machine(
        self, run: RunDescription, robot: Located[RobotDescription]
    ) -> ResolvedRobot | None:
        """Return the true machine of the twin.

        Its noise is its own with the robot's as default, and the run's overrides both by key.
        """
        source = self.find_robot(run.experiment.truth, "experiment", "truth")
        if source is None:
            return None
        noise = [
            Located(one.value.noise, one.document, (*one.key, "noise"))
            for one in (robot, source)
            if one.value.noise is not None
        ]
        own = source.value.model_copy(update={"noise": None})
        bare = replace(source, value=as_general(own) if run.experiment.payload else own)
        noise += self._located(run.noise, "noise")
        with collect(self.problems):
            return resolve_robot(bare, noise=noise, sampling=run.experiment.sampling)
        return None

    def priors(self, run: RunDescription, robot: ResolvedRobot) -> dict[str, Any]:
        """Return the identified machines of the run's priors by section: one, or a tuple."""
        found: dict[str, Any] = {}
        key, design = ("design", "prior"), run.design
        corrected = not design.is_change
        machines = list[RobotDescription]()
        for source in design.priors:
            with collect(self.problems):
                machine = prior_machine(source, key, robot, self.document, corrected=corrected)
                if message := _repetition(machine, machines):
                    raise InputError(self.document.problem(key, message, "estimates of other data"))
                machines.append(machine)
        if machines:
            found["design"] = tuple(machines) if isinstance(design.prior, tuple) else machines[0]
        key = ("estimate", "prior")
        if not isinstance(run.estimate.prior, dict):  # no priors of single parameters
            with collect(self.problems):
                machine = prior_machine(run.estimate.prior, key, robot, self.document)
                found["estimate"] = machine
                self.problems.extend(payload_problems(machine, robot, key, self.document))
        return found


def _repetition(machine: RobotDescription, others: list[RobotDescription]) -> str:
    """Return the reason why a prior counts twice with other ones, in words; empty if it does not.

    An estimate contains the recordings of its prior.
    """
    if machine in others:
        return "the same estimate is given twice: it would count twice"
    own = identification_of(machine)
    for other in map(identification_of, others):
        if not set(own.recordings).isdisjoint(other.recordings):
            return (
                f"the estimates of the runs {other.run} and {own.run} contain the same recording, "
                "themselves or in their priors: it would count twice"
            )
    return ""


_NOISE_USERS = ("design", "experiment", "montecarlo")


def _noise_warnings(run: RunDescription, robot: ResolvedRobot) -> list[str]:
    users = [stage for stage in run.stages if stage in _NOISE_USERS]
    if not users or (robot.noise is not None and robot.noise.force_covariance is not None):
        return []
    need = "needs" if len(users) == 1 else "need"
    return [
        f"no noise of the forces is given (`noise` in robot or run), and {' and '.join(users)} "
        f"{need} it"
    ]


# --- defaults that follow from other sections -----------------------------------------------------

_SMOOTHING = (0.4, 0.1, 0.05)
_SMOOTHING_WITHOUT_LIMIT = (0.8, 0.2, 0.1)


def _complete(
    run: RunDescription,
    robot: ResolvedRobot,
    truth: ResolvedRobot | None,
    document: Document,
    priors: Mapping[str, Any],
) -> RunDescription:
    """Fill in values that follow from other sections, and the robots themselves."""

    def with_prior(name: str, section: S) -> S:
        return section.model_copy(update={"prior": priors[name]}) if name in priors else section

    def place(file: str) -> str:
        return str(absolute(file, document.folder))

    def with_place(motion: ValidationMotion) -> ValidationMotion:
        return motion.model_copy(update={"file": motion.file and place(motion.file)})

    machine = None if truth is None else truth.description
    design = with_prior("design", run.design)
    if isinstance(design.interest, TaskSection):
        task = design.interest.model_copy(update={"task": with_place(design.interest.task)})
        design = design.model_copy(update={"interest": task})
    design = design.model_copy(update={"others": tuple(map(place, run.design.others))})
    complete = run.model_copy(
        update={
            "format": RUN_FORMAT,
            "robot": robot.description,
            "limits": {},
            "noise": None,
            "tolerances": None,
            "trajectory": _fill(run.trajectory, controller_period=run.experiment.step),
            "design": _fill(design, smoothing=smoothing_widths(robot)),
            "estimate": with_prior("estimate", run.estimate),
            "experiment": run.experiment.model_copy(update={"truth": machine}),
            "data": run.data.with_files(place),
            "validation": tuple(map(with_place, run.validation)),
        }
    )
    # model_copy marks updated fields as set, but only the user names stages.
    complete.model_fields_set.intersection_update(run.model_fields_set)
    return complete


def _fill(section: S, **values: object) -> S:
    """Return a section with values for keys that are None; they do not count as set."""
    missing = {key: value for key, value in values.items() if getattr(section, key) is None}
    filled = section.model_copy(update=missing)
    filled.model_fields_set.difference_update(missing)
    return filled


def smoothing_widths(robot: ResolvedRobot) -> tuple[float, ...]:
    """Return falling widths of the smoothed friction sign, m/s: shares of the speed limit.

    The widths scale with the machine: those for struts of 2 m/s would hide all friction of a
    machine with 0.5 mm/s.
    """
    limit = robot.limits.get("strut_speed")
    if limit is None:
        return _SMOOTHING_WITHOUT_LIMIT
    fastest = float(np.max(np.abs(limit.stated_bounds)))
    # Six digits: the numbers are printed, and copied by people.
    return tuple(float(f"{share * fastest:.6g}") for share in _SMOOTHING)
