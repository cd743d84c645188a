"""Estimate of an earlier identification as the prior of a new one of the same machine.

Its systematic error is not drawn anew: it enters the new estimate with the weight of the prior and
adds, with its sign, to the systematic error of the new recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from constraints.arrays import Array
from estimation.measurement_model.motion import NormalEquations
from expdesign.configuration import InputError
from expdesign.configuration.consistency import identification_of
from expdesign.configuration.robot import RobotDescription
from expdesign.configuration.tolerances import Identification
from expdesign.information.identifiable import BaseParameters
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation, deviations, estimated_constants


@dataclass(frozen=True, eq=False)
class PriorEstimate:
    """Earlier estimate of the robot's parameters, as stated in the robot file."""

    values: Array
    """(m + c,), SI: the unconstrained estimate, also if the robot's own parameters are physically
    consistent ones; zeros for the c constants of terms estimated with it, which the robot already
    contains."""
    precision: Array
    """(m + c, m + c), inverse of its random covariance, which includes the constants' own
    tolerances; zero for fixed parameters."""
    deviations: tuple[Deviation, ...]
    response: Array
    """(m + c, t), change of the estimate per unit of each deviation."""

    @classmethod
    def of(cls, robot: Robot) -> PriorEstimate:
        """Read the `identification` of the robot's file.

        Raises
        ------
        InputError
            There is none, or its parameters, constants or geometry differ.
        """
        about = robot.description
        found = about.description.identification
        wrong = ""
        if found is None:
            wrong = f"the robot {robot.name} was not identified: its file has no identification"
        elif found.parameters != robot.parameter_names:
            wrong = "the identification of the robot has other parameters"
        if wrong or found is None:
            raise InputError(
                wrong,
                file=about.source,
                key="estimate.prior_from",
                allowed="none, or a robot such as the identified-robot.yaml of a run folder",
            )
        given = found.unconstrained or robot.parameters
        values, covariance, deviating, response = _split(found, given, robot, "estimate.prior_from")
        return cls(values, invert_covariance(covariance), deviating, response)

    def of_combinations(
        self, base: BaseParameters, names: Sequence[str], held: Array
    ) -> PriorEstimate:
        """Return the prior of combinations β = T p, with all other parameters fixed.

        A normal distribution of p with mean m and covariance C gives β the mean T m and the
        covariance T C Tᵀ. The result is stated for the base parameters, with the parameters that
        regroup into them fixed. Parameters that the estimate held count as exact. Constants of
        terms estimated with p remain unchanged. `names` are those of all m parameters, `held`,
        (m,), the values of all but the base parameters.

        Raises
        ------
        InputError
            The prior of the combinations is singular: some of them would be exact.
        """
        constants = list(range(len(held), len(self.values)))
        at = [*(names.index(name) for name in base.names), *constants]
        own = [*(names.index(name) for name in base.base), *constants]
        matrix = block_diag(base.matrix, np.eye(len(constants)))
        fixed = np.isin(np.arange(len(self.values)), at, invert=True)
        inner = self.precision[np.ix_(at, at)]
        covariance = invert_covariance(inner)
        estimated = np.diag(inner)[: len(base.names)] > 0
        rows = base.matrix[:, estimated] * base.units[estimated]
        rows = rows[np.any(rows != 0, axis=1)]
        rows /= np.linalg.norm(rows, axis=1)[:, None]
        if len(rows) and np.linalg.matrix_rank(rows) < len(rows):
            raise InputError(
                "the robot's identification held some of the parameters that regroup, so that its "
                "estimate of the others is no prior for all combinations "
                "(estimate.parameters: base)",
                key="estimate.prior_from",
                allowed="none, or estimate.parameters: all",
            )
        values, precision = np.pad(held, (0, len(constants))), np.zeros_like(self.precision)
        values[own] += matrix @ (self.conditional_mean(fixed[: len(held)], held) - values)[at]
        precision[np.ix_(own, own)] = invert_covariance(matrix @ covariance @ matrix.T)
        # Fixed parameters now pass their part of the systematic error on to the others.
        change = (
            self.response[at] + covariance @ self.precision[at][:, fixed] @ self.response[fixed]
        )
        response = np.zeros_like(self.response)
        response[own] = matrix @ change
        return replace(self, values=values, precision=precision, response=response)

    def conditional_mean(self, held: NDArray[np.bool_], values: Array) -> Array:
        """Return the mean, (m + c,), given that the held parameters, (m,), have these values.

        The conditional mean of a normal distribution follows from its precision P, with free (f)
        and held (d) entries: m_f − P_ff⁻¹ P_fd (v_d − m_d). P_ff is the conditional precision.
        """
        constants = len(self.values) - len(held)
        held, values = np.pad(held, (0, constants)), np.pad(values, (0, constants))
        others = np.flatnonzero(~held & (np.diag(self.precision) > 0))
        mean = np.where(held, values, self.values)
        prior = NormalEquations(0.0, self.precision, self.precision @ (self.values - mean))
        mean[others] += prior.select(others).eliminate(0).offset
        return mean


@dataclass(frozen=True, eq=False)
class UnloadedMachine(PriorEstimate):
    """Machine as identified before it carried an unknown payload.

    The platform's parameters with the payload have no prior; the others keep the marginal
    covariance that they have in the identification.
    """

    covariance: Array
    """(m + c, m + c), P: random part and part due to the constants' own tolerances."""
    platform: NDArray[np.intp]
    """(10,), indices of `OF_A_BODY`'s parameters."""

    @classmethod
    def read(cls, robot: Robot, machine: RobotDescription) -> UnloadedMachine:
        """Read the identification of the machine.

        Raises
        ------
        InputError
            The identification names deviations that the robot does not have.
        """
        found, names = identification_of(machine), robot.parameter_names
        given = found.unconstrained or [machine.parameters[name] for name in names]
        values, covariance, deviating, response = _split(found, given, robot, "estimate.prior")
        platform = np.array([names.index(name) for name in OF_A_BODY.values()], dtype=np.intp)
        kept = covariance.copy()
        kept[platform] = kept[:, platform] = 0.0
        return cls(values, invert_covariance(kept), deviating, response, covariance, platform)

    @property
    def is_estimated(self) -> NDArray[np.bool_]:
        """(m + c,), whether an entry was estimated; false: held at its value."""
        return np.diag(self.covariance) > 0

    @property
    def transfer(self) -> Array:
        """(10, m + c), T = [1, −G]: payload per unit of p' − p₀.

        G = P_ab P_bb⁻¹ is the regression of the platform's parameters on all others (parameters
        and constants); see `payload_estimate`.
        """
        own, count = self.platform, len(self.platform)
        order = [*own, *np.setdiff1d(np.flatnonzero(self.is_estimated), own)]
        joint = NormalEquations(0.0, self.covariance, np.zeros(len(self.values))).select(order)
        transfer = np.zeros((count, len(self.values)))
        transfer[:, order] = np.hstack([np.eye(count), -joint.eliminate(count).slope.T])
        return transfer


def invert_covariance(covariance: Array) -> Array:
    """Return the inverse, (m, m), of the rows with a non-zero diagonal; zeros elsewhere."""
    std = np.sqrt(np.diag(covariance))
    at = np.flatnonzero(std > 0)
    precision = np.zeros_like(covariance)
    scale = np.multiply.outer(std[at], std[at])
    precision[np.ix_(at, at)] = np.linalg.inv(covariance[np.ix_(at, at)] / scale) / scale
    return (precision + precision.T) / 2


def _split(
    found: Identification, given: Sequence[float] | Array, robot: Robot, key: str
) -> tuple[Array, Array, tuple[Deviation, ...], Array]:
    """Split an identification of parameters into values, covariance and shared systematic effects.

    Zeros for the constants that were estimated with them follow the `given` parameters, (m,).

    The prior covariance, (m + c, m + c), is the random part plus the part due to the constants' own
    tolerances. These were priors of the constants: the random part alone would appear the more
    precise, the less the data determine the constants. The other deviations and their effects on
    parameters and constants, (m + c, t), are the same in later estimates.
    """
    known = {one.name: one for one in deviations(robot)}
    estimated = tuple(one.name for one in estimated_constants(robot))
    if found.constants != estimated:
        raise InputError(
            f"the identification of the robot {robot.name} contains the covariance of its "
            f"parameters with {', '.join(found.constants) or 'no constant of a term'}, but this "
            f"run estimates {', '.join(estimated) or 'none'}: their errors are correlated",
            key=key,
            allowed="estimate: true for the constants in identification.constants, and for no "
            "others; or identify the robot again",
        )
    if unknown := [one.name for one in found.deviations if one.name not in known]:
        raise InputError(
            f"the identification names deviations that the robot {robot.name} does not have: "
            f"{', '.join(unknown)}",
            key=key,
            allowed=", ".join(known),
        )
    covariance = np.array(found.covariance_random)
    response = np.array(found.response).reshape(len(covariance), len(found.deviations))
    own = np.array([one.name in found.constants for one in found.deviations], dtype=bool)
    tolerances = np.array([one.tolerance for one in found.deviations])
    effects = response[:, own] * tolerances[own]
    others = [one for one in found.deviations if one.name not in found.constants]
    return (
        np.pad(np.array(given), (0, len(found.constants))),
        covariance + effects @ effects.T,
        tuple(replace(known[one.name], tolerance=one.tolerance) for one in others),
        response[:, ~own],
    )
