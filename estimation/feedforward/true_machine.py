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


def true_machine(
    configuration: RunConfiguration, saved: SavedEstimate, machine: DeviatingMachine, times: Array
) -> TrueMachine:
    """Return the digital twin or, where the recording is of a real machine, one that is drawn.

    Of a real machine nobody knows the true parameters. They are drawn from the estimate's normal
    distribution, and again until none is beyond its bound: what is simulated then shows what the
    estimate's uncertainty costs, and nothing of what the model does not know.

    Only p is drawn, by its whole covariance: geometry, gains and constants of terms stay as the
    estimate has them. The part of the covariance that comes from their being estimated with p, or
    from their tolerances, belongs to errors of p that errors of θ make up for in the forces. With θ
    held nothing does, and the errors come out too large.

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
    lower = np.array([one.lower for one in bounds])
    upper = np.array([one.upper for one in bounds])
    # A parameter that the estimate itself has beyond its bound stays where it is.
    within = (estimate.values >= lower) & (estimate.values <= upper)
    rng = np.random.default_rng(np.random.SeedSequence(section.seed, spawn_key=(FIRST_DRAW,)))
    # A covariance with zeros for fixed parameters is semidefinite, and rounding makes it less.
    drawn = rng.multivariate_normal(
        estimate.values, estimate.covariance, _MOST_DRAWS, check_valid="ignore", method="eigh"
    )
    kept = np.all(~within | ((drawn >= lower) & (drawn <= upper)), axis=1)
    if not np.any(kept):
        raise ComputationError(
            f"none of {_MOST_DRAWS} machines drawn from the estimate's covariance has all its "
            "parameters within their bounds: the estimate is too uncertain to be simulated"
        )
    values = drawn[int(np.argmax(kept))]
    gains = np.tile(machine.gains, (len(times), 1))
    return TrueMachine("drawn", Model(machine.robot, values), None, gains)
