"""Robot, noise and recordings with the values that a first estimate gives.

Friction in proportion to the load makes the forces a product of two unknowns. With the load held
they are linear again; held at the nominal parameters, the estimate would carry their error. Here
the load is taken at a Gauss–Markov estimate, and once more at the next: each round reduces the
load's error to the share μ, a few per cent. The load's own error, an estimate's standard
deviation, adds a share of the same relative size to the covariance; it is neglected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimation.data.measurement import Measurement
from estimation.estimators import (
    Experiment,
    ParameterPriors,
    PerturbedMachine,
    SystematicUncertainty,
    linear_estimate,
)
from estimation.identification.noise_choice import residual_noise
from expdesign.robot import Robot

_ROUNDS = 2


def estimated_machine(robot: Robot, systematic: SystematicUncertainty | None) -> PerturbedMachine:
    """Return the machine with its estimated deviations; the robot as described without any."""
    if systematic is None or not systematic.estimated:
        return PerturbedMachine.exact(robot)
    return PerturbedMachine.of(robot, systematic.deviations, systematic.values)


def apply_calibration(data: Measurement, machine: PerturbedMachine) -> Measurement:
    """Remove the estimated length offsets, force gains and delay from a recording.

    The rate of the clock stays: its effect on the motion is far below the noise.
    """
    if not machine.chosen:
        return data
    return replace(
        data,
        lengths=data.lengths - machine.zeros,
        forces=data.forces / machine.gains,
        force_delay=data.force_delay + machine.delay,
    )


def linearise_at_load(
    robot: Robot, experiments: Sequence[Experiment], knowledge: ParameterPriors
) -> tuple[Robot, tuple[Experiment, ...]]:
    """Return the robot with its friction at the estimated load, and the experiments with its A.

    Without a term that depends on the load both are returned unchanged.

    Raises
    ------
    UnidentifiableError
        The data do not determine some parameters at all.
    """
    present = tuple(experiments)
    if not robot.graph.loaded:
        return robot, present
    for _ in range(_ROUNDS):
        robot = robot.with_load_at(linear_estimate(robot, present, knowledge, "gm").values)
        present = tuple(experiment.of_robot(robot) for experiment in present)
    return robot, present


def with_residual_noise(
    robot: Robot, experiments: Sequence[Experiment], knowledge: ParameterPriors
) -> tuple[Experiment, ...]:
    """Return the experiments with an unknown Σ estimated from Gauss–Markov residuals."""
    present = list(experiments)
    used = int(np.count_nonzero(knowledge.free)) // len(present)
    unknown = [n for n, e in enumerate(present) if e.noise.forces.includes_model_error]
    for _ in range(_ROUNDS if unknown else 0):
        values = linear_estimate(robot, present, knowledge, "gm").values
        for number in unknown:
            experiment = present[number]
            rest = experiment.forces - experiment.fitted_regressors @ values
            own = residual_noise(rest, experiment.record.forces.counts, used)
            noise = replace(experiment.noise, forces=own)
            present[number] = replace(experiment, noise=noise)
    return tuple(present)
