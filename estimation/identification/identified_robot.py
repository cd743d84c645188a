"""The robot that an estimate found, as a robot file: `identified-robot.yaml`."""

from __future__ import annotations

from typing import Any

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.diagnosis_result import Diagnosis
from estimation.estimators import ParameterEstimate
from estimation.identification.result import EstimationResult
from estimation.uncertainty.consistency import ConsistentEstimate
from expdesign.configuration.identification import (
    IDENTIFIED_ROBOT,
    Identification,
    IdentifiedDeviation,
    identified_name,
)
from expdesign.configuration.robot import RobotDescription
from expdesign.configuration.tolerances import RobotTolerances
from expdesign.configuration.writing import robot_yaml
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot, robot_from
from expdesign.robot.deviation import Deviation, apply_deviations, as_in_a_file, estimated_constants

FILE = IDENTIFIED_ROBOT


def identified_robot(result: EstimationResult, diagnosis: Diagnosis | None) -> str:
    """Return the robot file with the parameters of the best estimate.

    With `estimate.consistent` they are the nearest ones that some set of bodies has.

    Joints, gravity and constants are those that were estimated, where they were; their tolerances
    are then what the estimate left of them, each for itself. Tolerances of the measurement stay.
    A constant that the file says to estimate still is: with this tolerance as its prior.
    """
    robot, best = robot_from(result.configuration.robot), result.best
    found = best.systematic
    description = robot.description.description
    if found is not None and found.estimated:
        tolerances = _tolerances(description, robot, best)
        moved = as_in_a_file(apply_deviations(robot, found.deviations, found.values).description)
        description = moved.model_copy(update={"tolerances": tolerances})
    names, values = result.knowledge.names, best.values
    if (near := _taken(result)) is not None:
        values = near.values
    description = description.model_copy(
        update={
            "name": identified_name(description.name),
            "parameters": dict(zip(names, values.tolist(), strict=True)),
            "identification": _identification(result, diagnosis),
        }
    )
    return robot_yaml(description)


def _taken(result: EstimationResult) -> ConsistentEstimate | None:
    """Return what stands for the estimate in the file; None: the estimate itself."""
    wanted = result.configuration.run.estimate.consistent
    return result.consistent[result.best.estimator] if wanted else None


def _identification(result: EstimationResult, diagnosis: Diagnosis | None) -> Identification:
    best = result.best
    found = best.systematic
    verdict = None if diagnosis is None else diagnosis.verdict
    # What was estimated without a tolerance is random: its errors are in that covariance.
    inexact = np.zeros(0, dtype=bool)
    response = shared = np.zeros((len(best.values), 0))
    constants = [one.name for one in estimated_constants(robot_from(result.configuration.robot))]
    joint = slice(len(best.values) + len(constants))
    entries: list[tuple[Deviation, float, float]] = []
    if found is not None:
        inexact = np.isfinite([one.std for one in found.deviations])
        whole = zip(found.deviations, found.values.tolist(), found.std.tolist(), strict=True)
        entries = [entry for entry in whole if np.isfinite(entry[0].std)]
        response = np.concatenate([found.response, np.asarray(found.left)])[joint, inexact]
        shared = found.joint_scaled_response[joint]
    return Identification(
        run=result.configuration.run.name,
        estimator=best.estimator,
        verdict="not judged" if verdict is None else verdict.status.value,
        summary="" if verdict is None else verdict.summary,
        parameters=result.knowledge.names,
        constants=tuple(constants),
        unconstrained=() if _taken(result) is None else tuple(best.values.tolist()),
        covariance_random=_rows(best.joint_random[joint, joint]),
        covariance_systematic=_rows(shared @ shared.T),
        deviations=tuple(
            IdentifiedDeviation(name=one.name, tolerance=one.std, value=value, std=std)
            for one, value, std in entries
        ),
        response=_rows(response) if entries else (),
    )


def _tolerances(description: RobotDescription, robot: Robot, best: ParameterEstimate) -> Any:
    """Return the tolerances with what the estimate left of those of the machine."""
    given, found = description.tolerances, best.systematic
    constants = [one.group.split(".")[1:] for one in estimated_constants(robot)]
    if found is None or (given is None and not constants):
        return given
    given = given or RobotTolerances()
    left: dict[str, float] = {}
    for one, std in zip(found.deviations, found.std.tolist(), strict=True):
        if one.of_the_machine:
            left.setdefault(one.name, std)  # one that follows is the error of an earlier prior
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
