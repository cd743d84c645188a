"""Noise that nobody knows, taken from residuals of the estimates that it weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimation.estimators import Experiment, Knowledge, linear_estimate
from estimation.identification.noise_choice import residual_noise
from expdesign.robot import Robot

_ROUNDS = 2


def with_residual_noise(
    robot: Robot, experiments: Sequence[Experiment], knowledge: Knowledge
) -> tuple[Experiment, ...]:
    """Take Σ that nobody knows from residuals of Gauss–Markov estimates, which are made anew."""
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
