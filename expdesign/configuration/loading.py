"""Loading a run: from a file, a mapping or a validated model to a complete configuration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from expdesign.configuration.document import Document, Placed, document_from_mapping, read_yaml
from expdesign.configuration.finding import absolute, find_robot, find_run
from expdesign.configuration.limits import LimitSource, resolve_limits
from expdesign.configuration.noise import NoiseDescription
from expdesign.configuration.parameters import whose
from expdesign.configuration.problem import InputError, Problem, nearest
from expdesign.configuration.robot import (
    ResolvedRobot,
    RobotDescription,
    read_robot,
    resolve_robot,
)
from expdesign.configuration.run import RUN_FORMAT, RunConfiguration, RunDescription
from expdesign.configuration.section import validate

_ROUNDING = 1e-12
_LEAST_HARMONICS_AT_REST = 2
_SMOOTHING = (0.2, 0.1, 0.05)
_SMOOTHING_WITHOUT_LIMIT = (0.4, 0.2, 0.1)
_NOISE_USED_BY = ("design", "experiment", "montecarlo")


def load_run(
    source: str | PathLike[str] | Mapping[str, Any] | RunDescription | RunConfiguration,
) -> RunConfiguration:
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
        Every default filled in, SI units, the robot with the run's limits and noise.

    Raises
    ------
    InputError
        With everything that is wrong, in the run and in its robot.
    """
    if isinstance(source, RunConfiguration):
        return source
    document = _document(source)
    run, problems = validate(RunDescription, document.data, document)
    robot_source = _robot_source(run, document, problems)
    robot: ResolvedRobot | None = None
    overrides = _overrides(document, problems, report=robot_source is None or run is None)
    if robot_source is not None:
        try:
            robot = resolve_robot(robot_source, *overrides)
        except InputError as error:
            problems += error.problems
    if run is not None and robot is not None:
        problems += _unknown_parameters(run, robot, document)
        problems += _undesignable(run, document)
    if problems or run is None or robot is None:
        raise InputError(dict.fromkeys(problems))
    return RunConfiguration(
        run=_completed(run, robot, document.folder),
        robot=robot,
        file=document.file,
        warnings=(*robot.warnings, *_warnings(run, robot)),
    )


def _document(source: str | PathLike[str] | Mapping[str, Any] | RunDescription) -> Document:
    if isinstance(source, RunDescription):
        return document_from_mapping(_as_written(source))
    if isinstance(source, Mapping):
        return document_from_mapping(source)
    return read_yaml(find_run(source))


def _as_written(run: RunDescription) -> dict[str, Any]:
    """Return a model as a file would state it, so that it names the same stages."""
    return run.model_dump(by_alias=True, include=run.model_fields_set)


def _robot_source(
    run: RunDescription | None, document: Document, problems: list[Problem]
) -> Placed[RobotDescription] | None:
    """Find the robot even when the run is wrong, so that the problems of both are reported."""
    named = document.data.get("robot") if run is None else run.robot
    if isinstance(named, RobotDescription):
        return Placed(named, document, ("robot",))
    if not isinstance(named, str) or not named.strip():
        return None
    try:
        path = find_robot(named, document.folder)
    except InputError as error:
        problems += (
            document.problem(("robot",), p.message, p.allowed, p.nearest) for p in error.problems
        )
        return None
    try:
        return read_robot(path)
    except InputError as error:
        if path.is_file():
            problems += error.problems
        else:  # the place to look at is where it is named
            problems += (
                document.problem(("robot",), f"{path}: {p.message}") for p in error.problems
            )
        return None


def _overrides(
    document: Document, problems: list[Problem], *, report: bool
) -> tuple[list[LimitSource], list[Placed[NoiseDescription]]]:
    """Return the run's limits and noise; their problems only when no robot reports them."""
    limits: list[LimitSource] = []
    noise: list[Placed[NoiseDescription]] = []
    raw = document.data.get("limits")
    if isinstance(raw, dict):
        limits = [LimitSource(raw, document, ("limits",))]
        if report:
            problems += resolve_limits(limits)[2]
    stated = document.data.get("noise")
    if isinstance(stated, dict):
        description, _ = validate(NoiseDescription, stated, document, ("noise",))
        if description is not None:
            noise = [Placed(description, document, ("noise",))]
    return limits, noise


def _unknown_parameters(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> list[Problem]:
    named = {
        ("design", "parameters"): run.design.parameters or (),
        ("estimate", "fixed"): run.estimate.fixed,
        ("estimate", "prior"): run.estimate.prior,
        ("estimate", "bounds"): run.estimate.bounds,
    }
    valid = robot.parameter_names
    return [
        document.problem(
            key,
            f"no term of the robot {robot.name} has the parameter '{name}'{whose(name)}",
            ", ".join(valid),
            nearest(name, valid),
        )
        for key, names in named.items()
        for name in names
        if name not in valid
    ]


def _undesignable(run: RunDescription, document: Document) -> list[Problem]:
    """Name what is well-formed but cannot be designed."""
    problems = []
    if run.design.start == "rest" and run.trajectory.harmonics < _LEAST_HARMONICS_AT_REST:
        problems.append(
            document.problem(
                ("design", "start"),
                "a series of one harmonic that starts at rest never moves",
                f"periodic, or trajectory.harmonics of at least {_LEAST_HARMONICS_AT_REST}",
            )
        )
    step = run.trajectory.controller_period or run.experiment.step
    low, high = run.trajectory.frequency
    if step > 1 / (2 * high):
        problems.append(
            document.problem(
                ("experiment", "sampling"),
                f"a sampling of {1 / step:g} Hz is too slow for motions of {1 / high:g} s",
                f"at least {2 * high:g} Hz, or a trajectory.controller_period",
            )
        )
        return problems
    fewest = math.ceil(1 / (high * step) * (1 - _ROUNDING))
    most = math.floor(1 / (low * step) * (1 + _ROUNDING))
    if low < high and fewest > most:
        problems.append(
            document.problem(
                ("trajectory", "frequency"),
                f"no period between {1 / high:g} and {1 / low:g} s is a whole number of "
                f"controller steps of {step:g} s",
                f"a range that includes {1 / (fewest * step):g} Hz, or equal bounds",
            )
        )
    return problems


def _completed(run: RunDescription, robot: ResolvedRobot, folder: Path) -> RunDescription:
    """Fill in what follows from other sections, and put the robot itself into the run."""
    update: dict[str, Any] = {
        "format": RUN_FORMAT,
        "robot": robot.description,
        "limits": {},
        "noise": None,
    }
    if run.trajectory.controller_period is None:
        step = run.experiment.step
        update["trajectory"] = run.trajectory.model_copy(update={"controller_period": step})
    if run.design.smoothing is None:
        widths = smoothing_widths(robot)
        update["design"] = run.design.model_copy(update={"smoothing": widths})
    if run.data.file is not None:
        file = str(absolute(run.data.file, folder))
        update["data"] = run.data.model_copy(update={"file": file})
    if any(motion.file is not None for motion in run.validation):
        update["validation"] = tuple(
            motion
            if motion.file is None
            else motion.model_copy(update={"file": str(absolute(motion.file, folder))})
            for motion in run.validation
        )
    completed = run.model_copy(update=update)
    # A copy counts what is updated as named; a stage is named by the user alone.
    completed.model_fields_set.difference_update({"design"} - run.model_fields_set)
    return completed


def smoothing_widths(robot: ResolvedRobot) -> tuple[float, ...]:
    """Return falling widths of the smoothed friction sign, m/s: shares of the speed limit.

    What counts as slow depends on the machine: a width that suits struts of 2 m/s would hide the
    friction of one that moves at 0.5 mm/s altogether.
    """
    limit = robot.limits.get("strut_speed")
    if limit is None:
        return _SMOOTHING_WITHOUT_LIMIT
    fastest = float(np.max(np.abs([limit.lower, limit.upper])))
    # Six digits: the numbers are printed, and copied by people.
    return tuple(float(f"{share * fastest:.6g}") for share in _SMOOTHING)


def _warnings(run: RunDescription, robot: ResolvedRobot) -> list[str]:
    users = [stage for stage in _NOISE_USED_BY if stage in run.stages]
    forces_known = robot.noise is not None and robot.noise.force_covariance is not None
    if users and not forces_known:
        return [f"no noise of the forces is given; needed by: {', '.join(users)}"]
    return []
