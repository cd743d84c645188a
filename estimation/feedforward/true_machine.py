"""The machine that is moved: the twin, or one that the estimate leaves possible."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from constraints.arrays import Array
from estimation.estimators import DeviatingMachine
from estimation.feedforward.forward_dynamics import Model
from estimation.identification.saved import SavedEstimate
from estimation.twin.disturbances import force_factors
from expdesign.configuration import ComputationError, RunConfiguration
from expdesign.configuration.sections.disturbances import Cogging
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.term import parameters_of
from expdesign.robot import robot_from
from expdesign.robot.deviation import Deviation

_MOST_DRAWS = 10_000

FIRST_DRAW = 200_001
"""Number of the repetition whose noise the loop has: no experiment and no validation has it."""


@dataclass(frozen=True, eq=False)
class TrueMachine:
    """What the controllers drive."""

    kind: Literal["twin", "drawn"]
    model: Model
    cogging: Cogging | None
    gains: Array
    """(T, 6), measured over true force."""
    warning: str = ""
    """What was not drawn, in words."""


def true_machine(
    configuration: RunConfiguration, saved: SavedEstimate, machine: DeviatingMachine, times: Array
) -> TrueMachine:
    """Return the digital twin or, where the recording is of a real machine, one that is drawn.

    Of a real machine nobody knows the true parameters. They are drawn from the estimate's normal
    distribution, and again until none is beyond its bound: what is simulated then shows what the
    estimate's uncertainty costs, and nothing of what the model does not know.

    Parameters and what is not known exactly, θ (constants of terms, geometry, gains), are drawn
    together: errors of the one make up for those of the other in the forces. An estimate that an
    earlier version saved does not say how they go together: of it p is drawn alone.

    Parameters
    ----------
    machine : DeviatingMachine
        With the geometry, constants and gains that were estimated.
    times : (T,) array
        s.

    Raises
    ------
    ComputationError
        No machine with parameters within their bounds is found.
    """
    section = configuration.run.experiment
    if configuration.run.data.file is None:
        robot = robot_from(configuration.truth or configuration.robot)
        gains = np.ones((len(times), ACTUATORS))
        if section.force_constant is not None:
            gains = force_factors(section.force_constant, times, float(times[-1]))
        return TrueMachine("twin", Model(robot, robot.parameters), section.cogging, gains)
    estimate, bounds = saved.estimate, parameters_of(machine.robot.terms)
    values, covariance = estimate.values, estimate.joint
    chosen: tuple[Deviation, ...] = ()
    if covariance is None:
        covariance = estimate.covariance
    elif estimate.systematic is not None:
        values, chosen = estimate.joint_values, estimate.systematic.deviations
    endless = np.full(len(chosen), np.inf)
    lower = np.array([one.lower for one in bounds] + [one.lower for one in chosen])
    upper = np.concatenate([[one.upper for one in bounds], endless])
    # A parameter that the estimate itself has beyond its bound stays where it is.
    within = (values >= lower) & (values <= upper)
    rng = np.random.default_rng(np.random.SeedSequence(section.seed, spawn_key=(FIRST_DRAW,)))
    # In standard deviations: units differ by orders, and rounding must not. A covariance with zeros
    # for what is exact is semidefinite, and rounding makes it less.
    std = np.sqrt(np.diag(covariance))
    scale = np.where(std > 0, std, 1.0)
    unit = covariance / np.multiply.outer(scale, scale)
    drawn = values + scale * rng.multivariate_normal(
        np.zeros(len(values)), unit, _MOST_DRAWS, check_valid="ignore", method="eigh"
    )
    kept = np.all(~within | ((drawn >= lower) & (drawn <= upper)), axis=1)
    if not np.any(kept):
        raise ComputationError(
            f"none of {_MOST_DRAWS} machines drawn from the estimate's covariance has all its "
            "parameters within their bounds: the estimate is too uncertain to be simulated"
        )
    values, theta = np.split(drawn[int(np.argmax(kept))], [len(bounds)])
    warning = ""
    if chosen:
        machine = DeviatingMachine.of(robot_from(configuration.robot), chosen, theta)
    elif estimate.joint is None:
        warning = (
            f"{saved.path}: `systematic.left` is missing, an earlier version wrote it. Parameters "
            "of the machine that moves are drawn alone, without what was estimated with them or "
            "has tolerances, and the errors with the identified model are too large. Estimate again"
        )
    gains = np.tile(machine.gains, (len(times), 1))
    return TrueMachine("drawn", Model(machine.robot, values), None, gains, warning)
