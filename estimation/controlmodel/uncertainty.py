"""Uncertainty of a control model's forces by the covariance of the estimate.

With Q = A p and the covariance C of p, the covariance of Q is A C Aᵀ at every instant. C has the
random share, which another recording draws anew, and the systematic one of the tolerances. Where
constants θ of terms were estimated with p (the pitch of cogging), C is that of both together, and
[A, ∂(A p)/∂θ] stands for A: their errors go with those of p, and cancel in part. What a wrong
geometry does to Q beside moving these is not counted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from expdesign.configuration.identification import Identification
from expdesign.robot import Robot
from expdesign.robot.deviation import deviations
from expdesign.robot.deviation_slope import deviating_forces
from expdesign.runfolder import ArrayTable, described, strutwise
from expdesign.runfolder.fields import TIME
from expdesign.trajectory import FourierTrajectory

WRITTEN_BY = "`expdesign model`"

_SAMPLES = 400
"""Of one period: many to each of its harmonics."""


@dataclass(frozen=True, eq=False)
class ForceUncertainty:
    """Forces along one period of a motion, and their standard deviations, (N,) and (N, 6)."""

    time: Annotated[Array, TIME]
    forces: Annotated[Array, strutwise("Q", "N", "force of the model, actuator")]
    std: Annotated[
        Array, strutwise("Q", "N", "standard deviation of the force, actuator", suffix="_std")
    ]
    std_random: Annotated[
        Array,
        strutwise(
            "Q",
            "N",
            "its share that another recording would draw anew, actuator",
            suffix="_std_random",
        ),
    ]


UNCERTAINTY = ArrayTable("uncertainty.csv", WRITTEN_BY, ForceUncertainty)


@dataclass(frozen=True)
class ActuatorUncertainty:
    """The standard deviation of one actuator's force along a motion."""

    actuator: Annotated[int, described("1", "actuator")]
    rms: Annotated[float, described("N", "root mean square of the standard deviation")]
    largest: Annotated[float, described("N", "its largest value")]
    rms_random: Annotated[
        float, described("N", "root mean square of the random share, which repetition lowers")
    ]
    largest_force: Annotated[float, described("N", "largest absolute force on the same motion")]


def force_uncertainty(
    robot: Robot, known: Identification, trajectory: FourierTrajectory
) -> ForceUncertainty:
    """Return forces and their standard deviations along one period of a trajectory."""
    time = np.linspace(0.0, trajectory.period, _SAMPLES, endpoint=False)
    motion = trajectory.sample(time)
    entries = {one.name: one for one in deviations(robot)}
    still = np.zeros_like(motion.pose)  # the rate of the acceleration, which moves no constant
    found = deviating_forces(
        robot,
        np.concatenate([*motion, still], axis=1),
        time,
        None,
        robot.parameters,
        [entries[name] for name in known.constants],
    )
    columns = np.concatenate([found.regressors, found.columns], axis=2)
    random = np.array(known.covariance_random)
    total = random + np.array(known.covariance_systematic)
    return ForceUncertainty(
        time, found.regressors @ robot.parameters, _std(columns, total), _std(columns, random)
    )


def by_actuator(found: ForceUncertainty) -> tuple[ActuatorUncertainty, ...]:
    """Return the numbers of each actuator."""
    rms, random = (np.sqrt(np.mean(one**2, axis=0)) for one in (found.std, found.std_random))
    columns = (rms, np.max(found.std, axis=0), random, np.max(np.abs(found.forces), axis=0))
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return tuple(ActuatorUncertainty(j, *row) for j, row in enumerate(rows, start=1))


def _std(columns: Array, covariance: Array) -> Array:
    variances = np.einsum("nij,jk,nik->ni", columns, covariance, columns, optimize=True)
    return np.sqrt(np.maximum(variances, 0.0))  # what rounding leaves below zero
