"""An estimate that was made before, as the prior of another one of the same machine.

What the tolerances made of it is not drawn anew: it goes into the new estimate as it is, with the
prior's weight, and comes together with what they make of the new recordings.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from constraints.arrays import Array
from expdesign.configuration import InputError
from expdesign.configuration.identification import Identification
from expdesign.configuration.prior import identification_of
from expdesign.configuration.robot import RobotDescription
from expdesign.information.identifiable import BaseParameters
from expdesign.mechanism.terms.rigid_platform import OF_A_BODY
from expdesign.robot import Robot
from expdesign.robot.deviation import Deviation, deviations, estimated_constants


@dataclass(frozen=True, eq=False)
class UnloadedMachine:
    """A machine as it was identified before it carried a payload."""

    values: Array
    """(m + c,), p₀, SI; zeros for the constants of terms that were estimated with it."""
    covariance: Array
    """(m + c, m + c), P: its random share, with that of the constants' own tolerances."""
    platform: NDArray[np.intp]
    """(10,), places of `OF_A_BODY`'s parameters."""

    @property
    def known(self) -> NDArray[np.bool_]:
        """(m + c,), false: it was held at its value."""
        return np.diag(self.covariance) > 0

    @property
    def transfer(self) -> Array:
        """(10, m + c), T = [1, −G]: what p' − p₀ says of the payload.

        G = P_ab P_bb⁻¹ is what a change of the others (parameters and constants) makes expect of
        the platform's; see `estimation.estimators.payload`.
        """
        others = self.known.copy()
        others[self.platform] = False
        std = np.sqrt(np.diag(self.covariance))[others]
        between = self.covariance[np.ix_(others, others)] / np.multiply.outer(std, std)
        across = self.covariance[np.ix_(others, self.platform)] / std[:, None]
        transfer = np.zeros((len(self.platform), len(self.values)))
        transfer[:, others] = -np.linalg.solve(between, across).T / std
        transfer[np.arange(len(self.platform)), self.platform] = 1.0
        return transfer


@dataclass(frozen=True, eq=False)
class PriorEstimate:
    """What the robot file says of the estimate that its parameters come from."""

    values: Array
    """(m + c,), SI: the estimate itself, also where the robot's parameters are those of bodies; and
    zeros for the c constants of terms that were estimated with it, which the robot has in it."""
    precision: Array
    """(m + c, m + c), inverse of its random covariance, with that of the constants' own
    tolerances; zero for what it did not estimate."""
    deviations: tuple[Deviation, ...]
    response: Array
    """(m + c, t), what it moves by per unit of each deviation."""
    unloaded: UnloadedMachine | None = None
    """The machine that it was of, where that carries a payload now."""

    @classmethod
    def of(cls, robot: Robot) -> PriorEstimate:
        """Take the `identification` of the robot's file.

        Raises
        ------
        InputError
            There is none, or it is of other parameters, constants or another geometry.
        """
        about = robot.description
        found = about.description.identification
        wrong = ""
        if found is None:
            wrong = f"the robot {robot.name} was not identified: its file has no identification"
        elif found.parameters != robot.parameter_names:
            wrong = "the identification of the robot is that of other parameters"
        if wrong or found is None:
            raise InputError(
                wrong,
                file=about.source,
                key="estimate.prior_from",
                allowed="none, or a robot such as the identified-robot.yaml of a run folder",
            )
        values = _with_constants(found.unconstrained or robot.parameters, found)
        covariance, deviating, response = _known(found, robot, "estimate.prior_from")
        return cls(values, _inverse(covariance), deviating, response)

    @classmethod
    def without_payload(cls, robot: Robot, machine: RobotDescription) -> PriorEstimate:
        """Take the identification of a machine that carries an unknown payload now.

        Nothing is known of the platform's parameters with the payload; the others have the
        covariance that they had together with the platform's.

        Raises
        ------
        InputError
            The identification names deviations that the robot does not have.
        """
        found, names = identification_of(machine), robot.parameter_names
        covariance, deviating, response = _known(found, robot, "estimate.prior")
        unloaded = UnloadedMachine(
            _with_constants(
                found.unconstrained or [machine.parameters[name] for name in names], found
            ),
            covariance,
            np.array([names.index(name) for name in OF_A_BODY.values()], dtype=np.intp),
        )
        kept = covariance.copy()
        kept[unloaded.platform] = kept[:, unloaded.platform] = 0.0
        return cls(unloaded.values, _inverse(kept), deviating, response, unloaded)

    def of_combinations(
        self, base: BaseParameters, names: Sequence[str], held: Array
    ) -> PriorEstimate:
        """Return what it knows of combinations β = T p, where all other parameters are held.

        A normal distribution of p with the mean m and the covariance C is one of β with T m and
        T C Tᵀ, whatever is known of each parameter of it. It is told of the base parameters, where
        those that regroup into them are held; what the earlier estimate held is known to it.
        Constants of terms that were estimated with p stay beside β as they are.

        Parameters
        ----------
        base : BaseParameters
            Of the parameters that are not fixed.
        names : sequence of str
            Of all m parameters.
        held : (m,)
            Values where all but the base parameters stay.

        Raises
        ------
        InputError
            It knows less than there are combinations: some of them exactly.
        """
        constants = list(range(len(held), len(self.values)))
        at = [*(names.index(name) for name in base.names), *constants]
        own = [*(names.index(name) for name in base.base), *constants]
        matrix = block_diag(base.matrix, np.eye(len(constants)))
        fixed = np.isin(np.arange(len(self.values)), at, invert=True)
        inner = self.precision[np.ix_(at, at)]
        covariance = _inverse(inner)
        estimated = np.diag(inner)[: len(base.names)] > 0
        told = base.matrix[:, estimated] * base.units[estimated]
        told = told[np.any(told != 0, axis=1)]
        told /= np.linalg.norm(told, axis=1)[:, None]
        if len(told) and np.linalg.matrix_rank(told) < len(told):
            raise InputError(
                "the robot's identification held some of the parameters that regroup, and what it "
                "found of the others is no prior of all combinations (estimate.parameters: base)",
                key="estimate.prior_from",
                allowed="none, or estimate.parameters: all",
            )
        values, precision = np.pad(held, (0, len(constants))), np.zeros_like(self.precision)
        values[own] += matrix @ (self.conditional_mean(fixed[: len(held)], held) - values)[at]
        precision[np.ix_(own, own)] = _inverse(matrix @ covariance @ matrix.T)
        # Beside what is fixed now, they move with what the earlier estimate made of that, too.
        moved = self.response[at] + covariance @ self.precision[at][:, fixed] @ self.response[fixed]
        response = np.zeros_like(self.response)
        response[own] = matrix @ moved
        return replace(self, values=values, precision=precision, response=response)

    def conditional_mean(self, held: NDArray[np.bool_], values: Array) -> Array:
        """Return its mean, (m + c,), when it is known that those held, of m, have these values.

        The conditional mean of a normal distribution, by its precision P of the others (f) and of
        those held (d): m_f − P_ff⁻¹ P_fd (v_d − m_d). P_ff is their precision.
        """
        constants = len(self.values) - len(held)
        held, values = np.pad(held, (0, constants)), np.pad(values, (0, constants))
        std = np.sqrt(np.diag(self.precision))
        others = np.flatnonzero(~held & (std > 0))
        scale = std[others]
        own = self.precision[np.ix_(others, others)] / np.multiply.outer(scale, scale)
        pull = self.precision[np.ix_(others, held)] @ (values - self.values)[held]
        mean = np.where(held, values, self.values)
        mean[others] -= np.linalg.solve(own, pull / scale) / scale
        return mean


def _with_constants(parameters: Sequence[float] | Array, found: Identification) -> Array:
    """Return parameters, and zeros for the constants that were estimated with them."""
    return np.pad(np.array(parameters), (0, len(found.constants)))


def _inverse(covariance: Array) -> Array:
    """Return the precision of a covariance, (m, m), or back; zero where its diagonal is zero."""
    std = np.sqrt(np.diag(covariance))
    at = np.flatnonzero(std > 0)
    precision = np.zeros_like(covariance)
    scale = np.multiply.outer(std[at], std[at])
    precision[np.ix_(at, at)] = np.linalg.inv(covariance[np.ix_(at, at)] / scale) / scale
    return (precision + precision.T) / 2


def _known(
    found: Identification, robot: Robot, key: str
) -> tuple[Array, tuple[Deviation, ...], Array]:
    """Return the covariance of an identification and what tolerances do to it beside.

    The covariance, (m + c, m + c), is the random share with that of the constants' own tolerances:
    they were priors, and without what they say of the constants the random share alone would be
    taken for the more precise, the less the data said. The other deviations, and what each does to
    parameters and constants, (m + c, t), are the same in later estimates.
    """
    known = {one.name: one for one in deviations(robot)}
    estimated = tuple(one.name for one in estimated_constants(robot))
    if found.constants != estimated:
        raise InputError(
            f"the identification of the robot {robot.name} has the covariance of its parameters "
            f"with {', '.join(found.constants) or 'no constant of a term'}, and estimated are "
            f"{', '.join(estimated) or 'none'} now: errors of both go together",
            key=key,
            allowed="estimate: true for the constants that it has (identification.constants), and "
            "for no others. One without them may be of an earlier version: estimate again",
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
    moved = response[:, own] * tolerances[own]
    others = [one for one in found.deviations if one.name not in found.constants]
    return (
        covariance + moved @ moved.T,
        tuple(replace(known[one.name], std=one.tolerance) for one in others),
        response[:, ~own],
    )
