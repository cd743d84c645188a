"""Forces of an identified machine along a motion, with their uncertainty and the force limit.

With Q = A p and the covariance C of p, the covariance of Q is A C Aᵀ at every instant. C has a
random share, independent in another recording, and the systematic share of the tolerances. If
constants θ of terms were estimated with p (the pitch of cogging), C is the covariance of both, and
[A, ∂(A p)/∂θ] replaces A: their errors are correlated with those of p and compensate them in part.
Other effects of a wrong geometry on Q are not included.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError
from expdesign.configuration.tolerances import Identification
from expdesign.robot import Robot
from expdesign.robot.deviation import deviating_forces, deviations
from expdesign.runfolder import OpenNumber, described, strutwise
from expdesign.runfolder.fields import TIME
from expdesign.trajectory import FourierTrajectory

LIMIT = "actuator_force"
"""Key of the limit that is judged."""
SIGMAS = 2.0
"""Standard deviations that are added to a force which is compared with its limit."""
CERTIFY_COMMAND = "`expdesign certify DIR --robot DIR/identified-robot.yaml`"
_SAMPLES = 400
"""Of one period: many to each of its harmonics."""


@dataclass(frozen=True, eq=False)
class ForceUncertainty:
    """Forces along a motion, and their standard deviations, (N,) and (N, 6)."""

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


@dataclass(frozen=True)
class ActuatorForce:
    """The force of one actuator along a motion, with its uncertainty and its limit."""

    actuator: Annotated[int, described("1", "actuator")]
    rms: Annotated[float, described("N", "root mean square of the standard deviation")]
    largest: Annotated[float, described("N", "its largest value")]
    rms_random: Annotated[
        float, described("N", "root mean square of the random share, which repetition lowers")
    ]
    largest_force: Annotated[float, described("N", "largest absolute force on the same motion")]
    force: Annotated[
        OpenNumber, described("N", "force that comes closest to a limit; empty: no limit")
    ] = np.nan
    bound: Annotated[OpenNumber, described("N", "this limit (actuator_force), as stated")] = np.nan
    excess: Annotated[
        OpenNumber, described("N", "the force's excess over it; negative: distance")
    ] = np.nan
    likely_excess: Annotated[
        OpenNumber,
        described("N", f"largest excess of a force with {SIGMAS:g} standard deviations added"),
    ] = np.nan


def force_uncertainty(
    robot: Robot, known: Identification, trajectory: FourierTrajectory
) -> ForceUncertainty:
    """Return forces and their standard deviations along one period of a trajectory."""
    time = np.linspace(0.0, trajectory.period, _SAMPLES, endpoint=False)
    return forces_along(robot, known, time, np.concatenate(trajectory.sample(time), axis=1))


def forces_along(
    robot: Robot, known: Identification, time: Array, state: Array
) -> ForceUncertainty:
    """Return forces and their standard deviations at times (N,), s, and states (N, 18).

    Raises
    ------
    InputError
        The identification has other parameters or constants than the robot.
    """
    entries = {one.name: one for one in deviations(robot)}
    path = robot.description.source
    if known.parameters != robot.parameter_names:
        raise InputError(
            "the identification is that of other parameters",
            path,
            key="identification.parameters",
            allowed=", ".join(robot.parameter_names),
        )
    if unknown := [name for name in known.constants if name not in entries]:
        raise InputError(
            f"the robot has no constant {', '.join(unknown)}, which the identification names",
            path,
            key="identification.constants",
            allowed="constants of its terms, as the estimate has written them",
        )
    regressors = columns = robot.regressor(*np.split(state, 3, axis=1))
    if known.constants:
        still = np.zeros((len(state), state.shape[1] // 3))  # no rate of the acceleration counts
        found = deviating_forces(
            robot,
            np.concatenate([state, still], axis=1),
            time,
            None,
            robot.parameters,
            [entries[name] for name in known.constants],
        )
        columns = np.concatenate([found.regressors, found.columns], axis=2)
    random = np.array(known.covariance_random)
    total = random + np.array(known.covariance_systematic)
    return ForceUncertainty(
        time, regressors @ robot.parameters, _std(columns, total), _std(columns, random)
    )


def _std(columns: Array, covariance: Array) -> Array:
    variances = np.einsum("nij,jk,nik->ni", columns, covariance, columns, optimize=True)
    return np.sqrt(np.maximum(variances, 0.0))  # rounding can make them negative


def by_actuator(found: ForceUncertainty, robot: Robot) -> tuple[ActuatorForce, ...]:
    """Return the numbers of each actuator, with the robot's stated limit on its force."""
    rms, random = (np.sqrt(np.mean(one**2, axis=0)) for one in (found.std, found.std_random))
    columns = [rms, np.max(found.std, axis=0), random, np.max(np.abs(found.forces), axis=0)]
    if (limit := robot.limit(LIMIT)) is not None:
        lower, upper = limit.stated_bounds
        above = found.forces - upper > lower - found.forces
        bounds = np.where(above, upper, lower)
        excess = np.maximum(found.forces - upper, lower - found.forces)
        worst = np.argmax(excess, axis=0), np.arange(excess.shape[1])
        columns += [one[worst] for one in (found.forces, bounds, excess)]
        columns.append(np.max(excess + SIGMAS * found.std, axis=0))
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return tuple(ActuatorForce(j, *row) for j, row in enumerate(rows, start=1))


def worst_force(rows: Sequence[ActuatorForce]) -> ActuatorForce | None:
    """Return the row that comes closest to a limit with its uncertainty; None without a limit."""
    limited = [row for row in rows if np.isfinite(row.likely_excess)]
    return max(limited, key=lambda row: row.likely_excess, default=None)


def force_limit_in_words(row: ActuatorForce) -> str:
    """Return an actuator's force, its uncertainty, and its verdict against the limit in words.

    Examples
    --------
    >>> force_limit_in_words(ActuatorForce(3, 0.8, 1.2, 0.5, 464.9, 464.9, 450.0, 14.9, 17.3))
    'strut 3: 464.9 N, limit 450 N, exceeded by 14.9 N, by up to 17.3 N with 2 σ'
    """
    begin = f"strut {row.actuator}: {row.force:.4g} N, limit {row.bound:.4g} N"
    if row.excess > 0:
        return (
            f"{begin}, exceeded by {row.excess:.3g} N, by up to {row.likely_excess:.3g} N with "
            f"{SIGMAS:g} σ"
        )
    if row.likely_excess > 0:
        return f"{begin}, kept, but exceeded by up to {row.likely_excess:.3g} N with {SIGMAS:g} σ"
    return f"{begin}, kept, also with {SIGMAS:g} σ of the force ({-row.likely_excess:.3g} N left)"


def force_warning(rows: Sequence[ActuatorForce]) -> str:
    """Return a warning if a force exceeds its limit by more than noise explains; else empty."""
    beyond = [row for row in rows if row.excess > SIGMAS * row.rms_random]
    if not beyond:
        return ""
    worst = max(beyond, key=lambda row: row.excess)
    return (
        "the identified machine exceeds its force limit on this motion: "
        f"{force_limit_in_words(worst)}. {CERTIFY_COMMAND} judges the motion from rest to rest"
    )
