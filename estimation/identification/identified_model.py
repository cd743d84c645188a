"""The identified model: as a robot file, and to predict with.

`identified_robot` writes the file `identified-robot.yaml`; `identified_model` takes parameters and
covariance from a result, for predictions of other motions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.diagnosis_result import Diagnosis
from estimation.diagnostics.finding import Status
from estimation.estimators import ParameterEstimate, ParameterPriors, SystematicUncertainty
from estimation.identification.estimation import Estimation
from estimation.identification.estimator_result import SystematicResult
from estimation.identification.result import EstimateFile
from estimation.uncertainty.consistency import ConsistentEstimate
from expdesign.configuration import InputError
from expdesign.configuration.estimate import EstimateSection
from expdesign.configuration.robot import RobotDescription
from expdesign.configuration.run import robot_yaml
from expdesign.configuration.tolerances import (
    Identification,
    IdentifiedDeviation,
    RobotTolerances,
    identified_name,
    machine_name,
)
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot, robot_from
from expdesign.robot.deviation import (
    Deviation,
    apply_deviations,
    as_in_a_file,
    deviations,
    estimated_constants,
)


def identified_robot(estimation: Estimation, diagnosis: Diagnosis | None) -> str:
    """Return the robot file with the parameters of the best estimate.

    With `estimate.consistent` these are the nearest physically consistent parameters.

    Estimated joints, gravity and constants replace those of the robot, with their standard
    deviations as tolerances. Tolerances of the measurement stay. A constant with `estimate: true`
    keeps it, with this tolerance as its prior.
    """
    robot, best = robot_from(estimation.configuration.robot), estimation.best
    found = best.systematic
    description = robot.description.description
    if found is not None and found.estimated:
        tolerances = _tolerances(description, robot, best)
        moved = as_in_a_file(apply_deviations(robot, found.deviations, found.values).description)
        description = moved.model_copy(update={"tolerances": tolerances})
    names, values = estimation.priors.names, best.values
    if (near := _replacement(estimation)) is not None:
        values = near.values
    description = description.model_copy(
        update={
            "name": identified_name(description.name),
            "parameters": dict(zip(names, values.tolist(), strict=True)),
            "identification": _identification(estimation, diagnosis),
        }
    )
    return robot_yaml(description)


def _replacement(estimation: Estimation) -> ConsistentEstimate | None:
    """Return the consistent parameters where the run asks for them; None: the estimate itself."""
    wanted = estimation.configuration.run.estimate.consistent
    return estimation.consistent[estimation.best.estimator] if wanted else None


def _identification(estimation: Estimation, diagnosis: Diagnosis | None) -> Identification:
    best, robot = estimation.best, robot_from(estimation.configuration.robot)
    found = best.systematic
    verdict = None if diagnosis is None else diagnosis.verdict
    # Deviations without a tolerance are random: their errors are in that covariance.
    inexact = np.zeros(0, dtype=bool)
    response = shared = np.zeros((len(best.values), 0))
    constants = [one.name for one in estimated_constants(robot)]
    joint = slice(len(best.values) + len(constants))
    entries: list[tuple[Deviation, float, float]] = []
    if found is not None:
        inexact = np.isfinite([one.std for one in found.deviations])
        whole = zip(found.deviations, found.values.tolist(), found.std.tolist(), strict=True)
        entries = [entry for entry in whole if np.isfinite(entry[0].std)]
        response = np.concatenate([found.response, np.asarray(found.left)])[joint, inexact]
        shared = found.joint_scaled_response[joint]
    return Identification(
        run=estimation.configuration.run.name,
        estimator=best.estimator,
        verdict="not judged" if verdict is None else verdict.status.value,
        summary="" if verdict is None else verdict.summary,
        parameters=estimation.priors.names,
        constants=tuple(constants),
        unconstrained=() if _replacement(estimation) is None else tuple(best.values.tolist()),
        covariance_random=_rows(best.joint_random[joint, joint]),
        covariance_systematic=_rows(shared @ shared.T),
        deviations=tuple(
            IdentifiedDeviation(name=one.name, tolerance=one.std, value=value, std=std)
            for one, value, std in entries
        ),
        response=_rows(response) if entries else (),
    )


def _tolerances(description: RobotDescription, robot: Robot, best: ParameterEstimate) -> Any:
    """Return the tolerances of the robot, reduced to the standard deviations of the estimate."""
    given, found = description.tolerances, best.systematic
    constants = [one.group.split(".")[1:] for one in estimated_constants(robot)]
    if found is None or (given is None and not constants):
        return given
    given = given or RobotTolerances()
    left: dict[str, float] = {}
    for one, std in zip(found.deviations, found.std.tolist(), strict=True):
        if one.of_the_machine:
            left.setdefault(one.name, std)  # a later entry of the name is the error of a prior
    changes: dict[str, Any] = {}
    for group in ("base_joints", "platform_joints"):
        if getattr(given, group) is not None:
            changes[group] = tuple(
                tuple(left.get(f"{group[:-1]}_{j}_{axis}", 0.0) for axis in ("x", "y", "z"))
                for j in range(1, ACTUATORS + 1)
            )
    tilts = [std for name, std in left.items() if name.startswith("gravity_")]
    if tilts:
        changes["gravity"] = float(np.sqrt(np.mean(np.square(tilts))))
    terms = {term: dict(own) for term, own in (given.terms or {}).items()}
    for term, name in constants:
        terms.setdefault(term, {})[name] = 0.0
    if terms:
        changes["terms"] = {
            term: {name: left.get(f"{term}_{name}", std) for name, std in own.items()}
            for term, own in terms.items()
        }
    return given.model_copy(update=changes)


def _rows(matrix: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())


@dataclass(frozen=True, eq=False)
class IdentifiedModel:
    """Parameters with their covariance, to predict with."""

    path: Path
    """The `estimate.json` they come from, for messages."""
    estimate: ParameterEstimate
    """Without motions."""
    priors: ParameterPriors
    doubt: str = ""
    """Serious findings of its diagnosis, in words; empty: none."""


def identified_model(
    result: EstimateFile, path: Path, robot: Robot, estimator: str | None = None
) -> IdentifiedModel:
    """Return the model that an estimator identified, by default the best one.

    Parameters
    ----------
    result : EstimateFile
    path : Path
        The place of its file, for messages.
    robot : Robot
        The robot whose motions are predicted.
    estimator : str, optional

    Raises
    ------
    InputError
        The estimate belongs to another robot, or the estimator is unknown.
    """
    names, key = result.parameters, result.best if estimator is None else estimator
    for wrong, message, allowed in (
        (
            names != robot.parameter_names,
            f"its parameters are not those of the robot {robot.name}",
            ", ".join(robot.parameter_names),
        ),
        (
            machine_name(result.robot) != machine_name(robot.name),
            f"it is an estimate of the robot {result.robot!r}, not of {robot.name!r}",
            robot.name,
        ),
        (
            key not in result.estimators,
            f"it has no estimator '{key}'",
            ", ".join(result.estimators),
        ),
    ):
        if wrong:
            raise InputError(message, file=path, key="--estimate", allowed=allowed)
    entry = result.estimators[key]
    fixed: dict[str, float | None] = {name: entry.values[name] for name in result.fixed}
    estimate = ParameterEstimate(
        estimator=key,
        values=np.array([entry.values[name] for name in names]),
        covariance=entry.covariance,
        systematic=_systematic(entry.systematic, robot),
        covariance_forces=entry.covariance_forces,
        covariance_kinematics=entry.covariance_kinematics,
        freedom=entry.freedom,
        colour=np.where(np.isnan(entry.colour), 1.0, entry.colour),
        influences=(),
        motions=(),
        cost=entry.cost,
        iterations=entry.iterations,
        converged=entry.converged,
        status=entry.status,
        seconds=entry.seconds,
        covariance_joint=entry.covariance_joint,
    )
    priors = ParameterPriors.of(robot, EstimateSection(fixed=fixed))
    return IdentifiedModel(path, estimate, priors, _doubt(result))


def _doubt(result: EstimateFile) -> str:
    verdict = None if result.diagnostics is None else result.diagnostics.verdict
    if verdict is None or verdict.status is Status.ACCEPTED:
        return ""
    return "; ".join(finding.contradiction for finding in verdict.failed if finding.serious)


def _systematic(found: SystematicResult | None, robot: Robot) -> SystematicUncertainty | None:
    """Return the systematic uncertainty; None for deviations that the robot does not have."""
    known = {one.name: one for one in (*deviations(robot), *estimated_constants(robot))}
    if found is None or any(one.name not in known for one in found.deviations):
        return None
    return SystematicUncertainty(
        tuple(
            replace(known[one.name], std=one.tolerance if np.isfinite(one.tolerance) else np.inf)
            for one in found.deviations
        ),
        found.response,
        np.array([one.value for one in found.deviations]),
        np.array([one.std for one in found.deviations]),
        estimated=found.estimated,
        left=found.left,
    )
