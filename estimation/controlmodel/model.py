"""A control model: a robot, where its numbers come from, and how sure they are."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from estimation.controlmodel.functions import ModelFunction, model_functions
from estimation.controlmodel.vectors import Vectors, vectors_of
from expdesign.configuration.identification import Identification, machine_name
from expdesign.robot import Robot
from expdesign.robot.deviation import deviations
from expdesign.robot.deviation_slope import deviating_forces
from expdesign.runfolder import ArrayTable, described, strutwise
from expdesign.runfolder.fields import TIME
from expdesign.trajectory import FourierTrajectory

_COUNT, _SEED = 100, 0
"""States that a format tests itself with."""
DOUBLE, SINGLE = 4e-12, 1e-5
"""Deviation of a force that is allowed in double and single precision, as a share of the largest:
1e-9 N and 2.3 mN of 230 N."""


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where a model's numbers come from."""

    file: Annotated[str, described("", "the robot file")]
    sha256: Annotated[str, described("", "its SHA-256")]
    made: Annotated[str, described("", "when the estimate ended, UTC; empty: not known")]
    version: Annotated[str, described("", "version of expdesign that made the model")]
    run: Annotated[str, described("", "run of the estimate; empty: not from an estimate")] = ""
    estimator: Annotated[str, described("", "ls, gm or ml")] = ""
    verdict: Annotated[str, described("", "what its diagnostics say")] = ""

    @property
    def sentence(self) -> str:
        """The same in words."""
        if not self.run:
            return f"nominal values of {self.file}: no estimate"
        when = f", {self.made}" if self.made else ""
        return f"run {self.run}, estimator {self.estimator}, verdict: {self.verdict}{when}"


@dataclass(frozen=True, eq=False)
class ControlModel:
    """What all formats are written from."""

    robot: Robot
    origin: Origin
    width: float
    """Of the sign of dry friction, m/s; 0: the exact one."""
    uncertainty: ForceUncertainty | None = None
    """Along a motion; None without an estimate or a motion."""

    @property
    def prefix(self) -> str:
        """The robot's name as an identifier of C, with which all names begin."""
        name = re.sub(r"\W", "_", machine_name(self.robot.name), flags=re.ASCII)
        return f"{'robot_' if name[0].isdigit() else ''}{name}_model"

    @property
    def identification(self) -> Identification | None:
        """How the robot's values are known."""
        return self.robot.description.description.identification

    @property
    def functions(self) -> dict[str, ModelFunction]:
        """What it computes."""
        return dict(model_functions(self.robot.terms))

    @cached_property
    def vectors(self) -> Vectors:
        """States and what it returns there."""
        return vectors_of(self.robot, self.width, _COUNT, _SEED)

    @property
    def largest_force(self) -> float:
        """Limit of the actuators' forces, N; where there is none, the largest of the vectors."""
        limit = self.robot.limit("actuator_force")
        return float(abs(self.vectors.forces).max() if limit is None else max(limit.upper))


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
