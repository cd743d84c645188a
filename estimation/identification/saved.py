"""An estimate that was made before, read again to predict other motions with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from estimation.diagnostics.finding import Status
from estimation.estimators import ParameterEstimate, ParameterPriors, SystematicUncertainty
from estimation.identification.estimate_file import EstimateFile
from estimation.identification.estimator_result import SystematicKeys
from expdesign.configuration import InputError
from expdesign.configuration.identification import machine_name
from expdesign.configuration.sections.estimate import EstimateSection
from expdesign.robot import Robot
from expdesign.robot.deviation import deviations, estimated_constants
from expdesign.runfolder import copied


@dataclass(frozen=True, eq=False)
class SavedEstimate:
    """Parameters and their covariance, without motions, and the place of the `estimate.json`."""

    path: Path
    estimate: ParameterEstimate
    knowledge: ParameterPriors
    doubt: str = ""
    """What its own recordings say against it, in words; empty: nothing."""


def saved_estimate(
    found: EstimateFile, path: Path, robot: Robot, estimator: str | None = None
) -> SavedEstimate:
    """Return an estimate to predict with; `path` is the place of its file, for messages.

    Raises
    ------
    InputError
        It is not this robot's.
    """
    names, key = found.parameters, found.best if estimator is None else estimator
    for wrong, message, allowed in (
        (
            names != robot.parameter_names,
            f"its parameters are not those of the robot {robot.name}",
            ", ".join(robot.parameter_names),
        ),
        (
            machine_name(found.robot) != machine_name(robot.name),
            f"it is an estimate of the robot {found.robot!r}, not of {robot.name!r}",
            robot.name,
        ),
        (
            key not in found.estimators,
            f"it has no estimator '{key}'",
            ", ".join(found.estimators),
        ),
    ):
        if wrong:
            raise InputError(message, file=path, key="--estimate", allowed=allowed)
    entry = found.estimators[key]
    fixed: dict[str, float | None] = {name: entry.values[name] for name in found.fixed}
    return SavedEstimate(
        path,
        copied(
            ParameterEstimate,
            entry,
            estimator=key,
            values=np.array([entry.values[name] for name in names]),
            freedom=_or(entry.freedom, np.inf, len(names)),
            colour=_or(entry.colour, 1.0, len(names)),
            influences=(),
            systematic=_systematic(entry.systematic, robot),
            motions=(),
        ),
        ParameterPriors.of(robot, EstimateSection(fixed=fixed)),
        _doubt(found),
    )


def _doubt(found: EstimateFile) -> str:
    verdict = None if found.diagnostics is None else found.diagnostics.verdict
    if verdict is None or verdict.status is Status.ACCEPTED:
        return ""
    return "; ".join(finding.contradiction for finding in verdict.failed if finding.serious)


def _or(numbers: Array, missing: float, count: int) -> Array:
    """Return numbers with those that are missing, all of them in a folder that has none."""
    known = numbers if len(numbers) == count else np.full(count, np.nan)
    return np.where(np.isnan(known), missing, known)


def _systematic(keys: SystematicKeys | None, robot: Robot) -> SystematicUncertainty | None:
    """Return what tolerances do to an estimate; None where the robot has not what deviates."""
    known = {one.name: one for one in (*deviations(robot), *estimated_constants(robot))}
    if keys is None or any(one.name not in known for one in keys.deviations):
        return None
    return SystematicUncertainty(
        tuple(
            replace(known[one.name], std=one.tolerance if np.isfinite(one.tolerance) else np.inf)
            for one in keys.deviations
        ),
        keys.response,
        np.array([one.value for one in keys.deviations]),
        np.array([one.std for one in keys.deviations]),
        estimated=keys.estimated,
        left=keys.left,
    )
