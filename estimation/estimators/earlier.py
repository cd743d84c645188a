"""An estimate that was made before, as the prior of another one of the same machine.

What the tolerances made of it is not drawn anew: it goes into the new estimate as it is, with the
prior's weight, and comes together with what they make of the new recordings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation, deviations


@dataclass(frozen=True, eq=False)
class EarlierEstimate:
    """What the robot file says of the estimate that its parameters come from."""

    values: Array
    """(m,), SI: the estimate itself, also where the robot's parameters are those of bodies."""
    precision: Array
    """(m, m), inverse of its random covariance; zero for what it did not estimate."""
    deviations: tuple[Deviation, ...]
    response: Array
    """(m, t), what it moves by per unit of each deviation."""

    @classmethod
    def of(cls, robot: Robot) -> EarlierEstimate:
        """Take the `identification` of the robot's file.

        Raises
        ------
        InputError
            There is none, or it is of other parameters or another geometry.
        """
        about = robot.description
        found = about.description.identification
        known = {one.name: one for one in deviations(robot)}
        wrong = ""
        if found is None:
            wrong = f"the robot {robot.name} was not identified: its file has no identification"
        elif found.parameters != robot.parameter_names:
            wrong = "the identification of the robot is that of other parameters"
        elif any(one.name not in known for one in found.deviations):
            wrong = "the identification names deviations that the robot does not have"
        if wrong or found is None:
            raise InputError(
                wrong,
                file=about.source,
                key="estimate.prior_from",
                allowed="none, or a robot such as the identified-robot.yaml of a run folder",
            )
        covariance = np.array(found.covariance_random)
        std = np.sqrt(np.diag(covariance))
        at = np.flatnonzero(std > 0)
        precision = np.zeros_like(covariance)
        scale = np.multiply.outer(std[at], std[at])
        precision[np.ix_(at, at)] = np.linalg.inv(covariance[np.ix_(at, at)] / scale) / scale
        return cls(
            np.array(found.unconstrained or robot.parameters),
            (precision + precision.T) / 2,
            tuple(replace(known[one.name], std=one.tolerance) for one in found.deviations),
            np.array(found.response).reshape(len(covariance), len(found.deviations)),
        )
