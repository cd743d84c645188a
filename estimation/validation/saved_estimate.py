"""An estimate as its run folder keeps it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from estimation.estimators import Knowledge, ParameterEstimate
from expdesign.configuration import EstimateSection, InputError, Problem
from expdesign.robot import Robot

NAME = "estimate.json"


@dataclass(frozen=True, eq=False)
class SavedEstimate:
    """Parameters and their covariance, ready to predict with.

    Attributes
    ----------
    path : Path
    estimate : ParameterEstimate
        Without motions: it predicts others than it was made from.
    knowledge : Knowledge
        Which parameters were free.
    """

    path: Path
    estimate: ParameterEstimate
    knowledge: Knowledge


def read_estimate(source: Path, robot: Robot, estimator: str | None = None) -> SavedEstimate:
    """Read an estimate.

    Parameters
    ----------
    source : Path
        A run folder, or its `estimate.json`.
    robot : Robot
        Whose parameters they are.
    estimator : str, optional
        The best one by default.

    Raises
    ------
    InputError
        There is none, or it is not this robot's.
    """
    path = source / NAME if source.is_dir() else source
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise _refused(
            path, "there is no estimate", "a folder that `expdesign estimate` wrote"
        ) from error
    except ValueError as error:
        raise _refused(path, f"it is no JSON: {error}", "an estimate.json") from error
    try:
        return _saved(path, data, robot, estimator)
    except (KeyError, TypeError, ValueError) as error:
        raise _refused(
            path, f"it does not hold an estimate: {error}", "an estimate.json"
        ) from error


def _saved(path: Path, data: Any, robot: Robot, estimator: str | None) -> SavedEstimate:
    names = tuple(data["parameters"])
    if names != robot.parameter_names:
        raise _refused(
            path,
            f"its parameters are not those of the robot {robot.name}",
            ", ".join(robot.parameter_names),
        )
    if data["robot"] != robot.name:
        raise _refused(
            path,
            f"it is an estimate of the robot {data['robot']!r}, not of {robot.name!r}",
            robot.name,
        )
    key = data["best"] if estimator is None else estimator
    if key not in data["estimators"]:
        raise _refused(path, f"it has no estimator '{key}'", ", ".join(data["estimators"]))
    entry = data["estimators"][key]
    values = np.array([entry["values"][name] for name in names], dtype=float)
    covariance = np.array(entry["covariance"], dtype=float)
    if covariance.shape != (len(names), len(names)):
        raise ValueError(f"covariance: {covariance.shape}")
    share = entry["covariance_kinematics"]
    fixed: dict[str, float | None] = {
        name: float(values[names.index(name)]) for name in data["fixed"]
    }
    return SavedEstimate(
        path=path,
        estimate=ParameterEstimate(
            estimator=key,
            values=values,
            covariance=covariance,
            force_share=np.array(entry["covariance_forces"], dtype=float),
            kinematic_share=None if share is None else np.array(share, dtype=float),
            motions=(),
            cost=float(entry["cost"]),
            iterations=int(entry["iterations"]),
            converged=bool(entry["converged"]),
            status=str(entry["status"]),
            seconds=0.0,
        ),
        knowledge=Knowledge.of(robot, EstimateSection(fixed=fixed)),
    )


def _refused(path: Path, message: str, allowed: str) -> InputError:
    return InputError(Problem(message, file=path, key="--estimate", allowed=allowed))
