"""Loading a run: from a file, a mapping or a validated model to a complete configuration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from expdesign.configuration.document import Document, Placed, document_from_mapping, read_yaml
from expdesign.configuration.finding import absolute, find_file
from expdesign.configuration.noise import NoiseDescription
from expdesign.configuration.parameters import whose
from expdesign.configuration.problem import InputError, Key, Problem, nearest
from expdesign.configuration.robot import ResolvedRobot, RobotDescription, read_robot, resolve_robot
from expdesign.configuration.run import RUN_FORMAT, RunConfiguration, RunDescription
from expdesign.configuration.section import Section, validate
from expdesign.configuration.sections.data import DataSection
from expdesign.configuration.sections.experiment import ValidationMotion
from expdesign.library import robot_files, run_files

S = TypeVar("S", bound=Section)
F = TypeVar("F", DataSection, ValidationMotion)

_ROUNDING = 1e-12
_LEAST_HARMONICS_AT_REST = 2
_SMOOTHING = (0.2, 0.1, 0.05)
_SMOOTHING_WITHOUT_LIMIT = (0.4, 0.2, 0.1)
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
    document = _document(source)
    run, problems = validate(RunDescription, document.data, document)
    # Even when the run is wrong, so that the problems of both are reported.
    named = document.data.get("robot") if run is None else run.robot
    robot_source = _robot_source(named, ("robot",), document, problems)
    robot: ResolvedRobot | None = None
    truth: ResolvedRobot | None = None
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
            )
            if run is not None and run.experiment.truth is not None:
                truth = _true_machine(
                    run.experiment.truth, robot_source, own_noise, document, problems
                )
        except InputError as error:
            problems += error.problems
    if run is not None and robot is not None:
        problems += _unknown_parameters(run, robot, document)
        problems += _undesignable(run, document)
        problems += _unknown_spectrum(run, robot, document)
    if problems or run is None or robot is None:
        raise InputError(problems)
    forces_known = robot.noise is not None and robot.noise.force_covariance is not None
    users = () if forces_known else [stage for stage in run.stages if stage in _NOISE_USED_BY]
    missing_noise = [f"no noise of the forces is given; needed by: {', '.join(users)}"]
    return RunConfiguration(
        run=_completed(run, robot, truth, document.folder),
        robot=robot,
        file=document.file,
        warnings=(
            *robot.warnings,
            *(missing_noise if users else ()),
            *_other_warnings(truth, robot),
        ),
        truth=truth,
    )


def _document(source: str | PathLike[str] | Mapping[str, Any] | RunDescription) -> Document:
    if isinstance(source, RunDescription):
        # As a file would state it, so that it names the same stages.
        source = source.model_dump(by_alias=True, include=source.model_fields_set)
    if isinstance(source, Mapping):
        return document_from_mapping(source)
    return read_yaml(find_file(source, "run", run_files()))


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
    named: str | RobotDescription,
    robot: Placed[RobotDescription],
    run_noise: list[Placed[NoiseDescription]],
    document: Document,
    problems: list[Problem],
) -> ResolvedRobot | None:
    """Return the machine that the twin is; its noise is its own, the robot's where it has none.

    The run's noise overrides both, key by key.
    """
    source = _robot_source(named, ("experiment", "truth"), document, problems)
    if source is None:
        return None
    noise = [
        Placed(one.value.noise, one.document, (*one.key, "noise"))
        for one in (robot, source)
        if one.value.noise is not None
    ]
    bare = source.value.model_copy(update={"noise": None})
    return resolve_robot(Placed(bare, source.document, source.key), (), [*noise, *run_noise])


def _other_warnings(truth: ResolvedRobot | None, robot: ResolvedRobot) -> list[str]:
    """Return what is odd about the true machine beyond what is odd about the robot."""
    found = () if truth is None else truth.warnings
    return [f"experiment.truth: {text}" for text in found if text not in robot.warnings]


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


def _undesignable(run: RunDescription, document: Document) -> Iterator[Problem]:
    """Name what is well-formed but cannot be designed."""
    if run.design.start == "rest" and run.trajectory.harmonics < _LEAST_HARMONICS_AT_REST:
        yield document.problem(
            ("design", "start"),
            "a series of one harmonic that starts at rest never moves",
            f"periodic, or trajectory.harmonics of at least {_LEAST_HARMONICS_AT_REST}",
        )
    step = run.controller_period
    low, high = run.trajectory.frequency
    if step > 1 / (2 * high):
        yield document.problem(
            ("experiment", "sampling"),
            f"a sampling of {1 / step:g} Hz is too slow for motions of {1 / high:g} s",
            f"at least {2 * high:g} Hz, or a trajectory.controller_period",
        )
        return
    fewest = math.ceil(1 / (high * step) * (1 - _ROUNDING))
    most = math.floor(1 / (low * step) * (1 + _ROUNDING))
    if low < high and fewest > most:
        yield document.problem(
            ("trajectory", "frequency"),
            f"no period between {1 / high:g} and {1 / low:g} s is a whole number of "
            f"controller steps of {step:g} s",
            f"a range that includes {1 / (fewest * step):g} Hz, or equal bounds",
        )


def _unknown_spectrum(
    run: RunDescription, robot: ResolvedRobot, document: Document
) -> Iterator[Problem]:
    """Name spectra of noise that say nothing up to half of the sampling."""
    if robot.noise is None:
        return
    for kind in ("force", "length"):
        spectrum = getattr(robot.noise, f"{kind}_spectrum")
        if spectrum is not None and not spectrum.covers(run.experiment.sampling):
            yield document.problem(
                ("experiment", "sampling"),
                f"a sampling of {run.experiment.sampling:g} Hz, but noise.{kind}_spectrum was "
                f"measured at {spectrum.highest:g} Hz",
                f"{spectrum.highest:g} Hz at most, or a spectrum that reaches half of the sampling",
            )


def _completed(
    run: RunDescription, robot: ResolvedRobot, truth: ResolvedRobot | None, folder: Path
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
            "design": _filled(run.design, smoothing=smoothing_widths(robot)),
            "experiment": run.experiment.model_copy(update={"truth": machine}),
            "data": _with_absolute_file(run.data, folder),
            "validation": tuple(_with_absolute_file(motion, folder) for motion in run.validation),
        }
    )
    # A copy counts what is updated as named; a stage is named by the user alone.
    completed.model_fields_set.intersection_update(run.model_fields_set)
    return completed


def _filled(section: S, **values: object) -> S:
    """Return a section with values for those of its keys that are None."""
    missing = {key: value for key, value in values.items() if getattr(section, key) is None}
    return section.model_copy(update=missing)


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
    fastest = float(np.max(np.abs([limit.lower, limit.upper])))
    # Six digits: the numbers are printed, and copied by people.
    return tuple(float(f"{share * fastest:.6g}") for share in _SMOOTHING)
