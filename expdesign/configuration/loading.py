"""Loading a run: from a file, a mapping or a validated model to a complete configuration."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from expdesign.configuration.consistency import folded_hum, inconsistencies, unselected
from expdesign.configuration.document import (
    Document,
    Placed,
    absolute,
    document_from_mapping,
    find_file,
    read_yaml,
)
from expdesign.configuration.errors import InputError, Key, Problem
from expdesign.configuration.grid import grid_points
from expdesign.configuration.noise import NoiseDescription
from expdesign.configuration.prior import identification_of, payload_problems, prior_machine
from expdesign.configuration.robot import (
    ResolvedRobot,
    RobotDescription,
    as_general,
    carrying,
    read_robot,
    resolve_robot,
)
from expdesign.configuration.run import RUN_FILE_KIND, RUN_FORMAT, RunConfiguration, RunDescription
from expdesign.configuration.section import Section, validate
from expdesign.configuration.sections.data import DataSection
from expdesign.configuration.sections.design import DesignSection
from expdesign.configuration.sections.estimate import EstimateSection
from expdesign.configuration.sections.experiment import ExperimentSection
from expdesign.configuration.sections.motions import ValidationMotion
from expdesign.library import robot_files, run_files

S = TypeVar("S", bound=Section)
F = TypeVar("F", DataSection, ValidationMotion)
P = TypeVar("P", DesignSection, EstimateSection)

_SMOOTHING = (0.4, 0.1, 0.05)
_SMOOTHING_WITHOUT_LIMIT = (0.8, 0.2, 0.1)
_OF_A_ROBOT = "base_joints"
"""A key that robot files have, and run files have not."""
_NOISE_USED_BY = ("design", "experiment", "montecarlo")


ConfigurationLike = str | PathLike[str] | Mapping[str, Any] | RunDescription | RunConfiguration
"""What `load_run` takes."""


def load_run(source: ConfigurationLike) -> RunConfiguration:
    """Load a run with its robot.

    Parameters
    ----------
    source : str, path-like, mapping, RunDescription or RunConfiguration
        The name of a run that ships, the path of a run file, or what such a file would hold.
        Relative paths in a mapping start from the current folder. A configuration is returned
        as it is.

    Returns
    -------
    RunConfiguration
        Every default filled in, SI units, the robot with the run's limits, noise and
        tolerances.

    Raises
    ------
    InputError
        With everything that is wrong, in the run and in its robot.
    """
    if isinstance(source, RunConfiguration):
        return source
    return _loaded(_document(source))


def _loaded(document: Document) -> RunConfiguration:
    run, problems = validate(RunDescription, document.data, document)
    # Even when the run is wrong, so that the problems of both are reported.
    named = document.data.get("robot") if run is None else run.robot
    robot_source = _robot_source(named, ("robot",), document, problems)
    robot: ResolvedRobot | None = None
    truth: ResolvedRobot | None = None
    priors: dict[str, RobotDescription] = {}
    limits = {} if run is None else run.limits
    tolerances = None if run is None else run.tolerances
    own_noise = (
        [] if run is None or run.noise is None else [Placed(run.noise, document, ("noise",))]
    )
    if robot_source is not None:
        try:
            robot = resolve_robot(
                robot_source,
                [Placed(limits, document, ("limits",))],
                own_noise,
                [] if tolerances is None else [Placed(tolerances, document, ("tolerances",))],
                None if run is None else run.experiment.sampling,
                file_format=_format(document),
            )
            if run is not None and run.experiment.truth is not None:
                truth = _true_machine(run.experiment, robot_source, own_noise, document, problems)
        except InputError as error:
            problems += error.problems
    if run is not None and robot is not None:
        problems += inconsistencies(run, robot, document)
        priors = _priors(run, robot, document, problems)
    if problems or run is None or robot is None:
        raise InputError(problems)
    forces_known = robot.noise is not None and robot.noise.force_covariance is not None
    users = () if forces_known else [stage for stage in run.stages if stage in _NOISE_USED_BY]
    missing_noise = [
        f"no noise of the forces is given (`noise` in robot or run), and {' and '.join(users)} "
        f"{'needs' if len(users) == 1 else 'need'} it"
    ]
    of_the_twin = (*folded_hum(run), *_other_warnings(truth, robot))
    payload = run.experiment.payload
    return RunConfiguration(
        run=_completed(run, robot, truth, document.folder, priors),
        robot=carrying(robot, payload),
        file=document.file,
        warnings=(
            *robot.warnings,
            *_of_priors(priors),
            *(missing_noise if users else ()),
            *unselected(run),
            *of_the_twin,
        ),
        of_the_twin=of_the_twin,
        truth=None if truth is None else carrying(truth, payload),
        grid=() if run.sweep is None else grid_points(run.sweep, robot, document, _loaded),
    )


def _document(source: str | PathLike[str] | Mapping[str, Any] | RunDescription) -> Document:
    if isinstance(source, RunDescription):
        # As a file would state it, so that it names the same stages.
        source = source.model_dump(by_alias=True, include=source.model_fields_set)
    if isinstance(source, Mapping):
        return document_from_mapping(source)
    if isinstance(source, str) and source in robot_files().keys() - run_files().keys():
        raise _no_run(f"'{source}' is a robot", source)
    document = read_yaml(find_file(source, "run", run_files()), RUN_FILE_KIND)
    if _OF_A_ROBOT in document.data:
        raise _no_run("this is a robot file", document.label, document.file)
    return document


def _no_run(what: str, robot: str, file: Path | None = None) -> InputError:
    allowed = f"a file of two lines, `name: first` and `robot: {robot}`"
    return InputError(
        f"{what}, and a run is asked for, which names its robot", file, allowed=allowed
    )


def _format(document: Document) -> int | None:
    """Return the format of a run that was resolved, which keeps the limits that it had then."""
    number = document.data.get("format")
    if number is None:
        # Before files had a format; nobody writes both of these, one of which is empty.
        return 0 if {"workers", "scheduler"} <= set(document.data) else None
    return number if isinstance(number, int) else None


def _robot_source(
    named: object, key: Key, document: Document, problems: list[Problem]
) -> Placed[RobotDescription] | None:
    """Find a robot that is named, or stands, at a key of the run; add what is wrong with it."""
    if isinstance(named, RobotDescription):
        return Placed(named, document, key)
    if not isinstance(named, str) or not named.strip():
        return None
    path = None
    try:
        path = find_file(named, "robot", robot_files(), document.folder)
        return read_robot(path)
    except InputError as error:
        if path is None:
            problems += (
                document.problem(key, p.message, p.allowed, p.nearest) for p in error.problems
            )
        elif path.is_file():
            problems += error.problems
        else:  # the place to look at is where it is named
            problems += (document.problem(key, f"{path}: {p.message}") for p in error.problems)
        return None


def _true_machine(
    experiment: ExperimentSection,
    robot: Placed[RobotDescription],
    run_noise: list[Placed[NoiseDescription]],
    document: Document,
    problems: list[Problem],
) -> ResolvedRobot | None:
    """Return the machine that the twin is; its noise is its own, the robot's where it has none.

    The run's noise overrides both, key by key.
    """
    source = _robot_source(experiment.truth, ("experiment", "truth"), document, problems)
    if source is None:
        return None
    noise = [
        Placed(one.value.noise, one.document, (*one.key, "noise"))
        for one in (robot, source)
        if one.value.noise is not None
    ]
    bare = source.value.model_copy(update={"noise": None})
    if experiment.payload:
        bare = as_general(bare)
    return resolve_robot(
        Placed(bare, source.document, source.key),
        noise=[*noise, *run_noise],
        sampling=experiment.sampling,
        file_format=_format(document),
    )


def _priors(
    run: RunDescription, robot: ResolvedRobot, document: Document, problems: list[Problem]
) -> dict[str, RobotDescription]:
    """Return the identified machines that sections of the run have as a prior, by the section."""
    found: dict[str, RobotDescription] = {}
    for section in ("design", "estimate"):
        source, key = getattr(run, section).prior, (section, "prior")
        if source is None or isinstance(source, dict):
            continue  # none, or those of single parameters
        try:
            found[section] = prior_machine(source, key, robot, document)
        except InputError as error:
            problems += error.problems
    if "estimate" in found:
        key = ("estimate", "prior")
        problems += payload_problems(found["estimate"], robot, key, document)
    return found


def _of_priors(priors: Mapping[str, RobotDescription]) -> list[str]:
    """Return what speaks against the machines that are priors."""
    return [
        f"{section}.prior: {text}"
        for section, machine in priors.items()
        for text in identification_of(machine).warnings
    ]


def _other_warnings(truth: ResolvedRobot | None, robot: ResolvedRobot) -> list[str]:
    """Return what is odd about the true machine beyond what is odd about the robot."""
    found = () if truth is None else truth.warnings
    return [f"experiment.truth: {text}" for text in found if text not in robot.warnings]


def _completed(
    run: RunDescription,
    robot: ResolvedRobot,
    truth: ResolvedRobot | None,
    folder: Path,
    priors: Mapping[str, RobotDescription],
) -> RunDescription:
    """Fill in what follows from other sections, and put the robots themselves into the run."""
    machine = None if truth is None else truth.description
    completed = run.model_copy(
        update={
            "format": RUN_FORMAT,
            "robot": robot.description,
            "limits": {},
            "noise": None,
            "tolerances": None,
            "trajectory": _filled(run.trajectory, controller_period=run.experiment.step),
            "design": _filled(
                _with_prior(run.design, priors.get("design")), smoothing=smoothing_widths(robot)
            ),
            "estimate": _with_prior(run.estimate, priors.get("estimate")),
            "experiment": run.experiment.model_copy(update={"truth": machine}),
            "data": _with_absolute_file(run.data, folder),
            "validation": tuple(_with_absolute_file(motion, folder) for motion in run.validation),
        }
    )
    # A copy counts what is updated as named; a stage is named by the user alone.
    completed.model_fields_set.intersection_update(run.model_fields_set)
    return completed


def _with_prior(section: P, machine: RobotDescription | None) -> P:
    return section if machine is None else section.model_copy(update={"prior": machine})


def _filled(section: S, **values: object) -> S:
    """Return a section with values for those of its keys that are None: they are not set by it."""
    missing = {key: value for key, value in values.items() if getattr(section, key) is None}
    filled = section.model_copy(update=missing)
    filled.model_fields_set.difference_update(missing)
    return filled


def _with_absolute_file(section: F, folder: Path) -> F:
    if section.file is None:
        return section
    return section.model_copy(update={"file": str(absolute(section.file, folder))})


def smoothing_widths(robot: ResolvedRobot) -> tuple[float, ...]:
    """Return falling widths of the smoothed friction sign, m/s: shares of the speed limit.

    What counts as slow depends on the machine: a width that suits struts of 2 m/s would hide the
    friction of one that moves at 0.5 mm/s altogether.
    """
    limit = robot.limits.get("strut_speed")
    if limit is None:
        return _SMOOTHING_WITHOUT_LIMIT
    fastest = float(np.max(np.abs(limit.stated_bounds)))
    # Six digits: the numbers are printed, and copied by people.
    return tuple(float(f"{share * fastest:.6g}") for share in _SMOOTHING)
