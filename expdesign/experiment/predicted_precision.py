"""What the experiment of a design will tell: its information, precision and combinations."""

from __future__ import annotations

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.experiment.combinations import (
    KnownCombination,
    identified_base,
    known_combinations,
)
from expdesign.experiment.result import PredictedPrecision, whole
from expdesign.information.fisher import parameter_covariance
from expdesign.information.identifiable import BaseParameters, root_of
from expdesign.recheck.excitable import structural_base
from expdesign.recheck.information import Evaluator
from expdesign.trajectory import FourierTrajectory


def precision(
    evaluator: Evaluator, information: Array, samples: int, periods: float
) -> PredictedPrecision:
    """Return the standard deviations of F, (k, k), over so many samples and periods."""
    std = np.sqrt(np.diag(parameter_covariance(information, evaluator.names)))
    named = dict(zip(evaluator.names, std.tolist(), strict=True))
    return PredictedPrecision(samples, periods, named)


def identified_combinations(
    configuration: RunConfiguration, evaluator: Evaluator, information: Array
) -> tuple[KnownCombination, ...]:
    """Return the combinations that the whole experiment, with this information, identifies."""
    robot = evaluator.robot
    base = identified_base(root_of(information), evaluator.names, robot.scales[evaluator.columns])
    # What is neither judged nor regrouped counts as known.
    together = configuration.run.design.parameters == "base"
    structure = structural_base(robot) if together else BaseParameters.each(evaluator.names)
    at = [robot.parameter_names.index(name) for name in structure.names]
    judged = [structure.names.index(name) for name in evaluator.names]
    covariance = np.zeros((len(at), len(at)))
    covariance[np.ix_(judged, judged)] = parameter_covariance(information, evaluator.names)
    scales = dict(zip(robot.parameter_names, robot.scales.tolist(), strict=True))
    return known_combinations(base, structure, robot.parameters[at], covariance, scales)


def experiment_information(
    evaluator: Evaluator, trajectory: FourierTrajectory, configuration: RunConfiguration
) -> tuple[Array, int]:
    """Return F of the whole experiment, (k, k), and its number of samples."""
    experiment = configuration.run.experiment
    per_period = trajectory.period * experiment.sampling
    total = int(np.ceil(experiment.periods * per_period * (1 - 1e-12)))
    count = whole(per_period)
    if count is not None:
        information = evaluator.whole_information(trajectory, count) * experiment.periods
    elif evaluator.memory is not None:
        # What a period of nearly as many samples tells, for all of them.
        count = max(1, round(per_period))
        information = evaluator.whole_information(trajectory, count) * (total / count)
    else:
        motion = trajectory.sample(np.arange(total) / experiment.sampling)
        information = evaluator.of_regressors(evaluator.robot.regressor(*motion), trajectory.omega)
    # All that was known before counts, and not what is the share of a measuring time.
    counted = total if evaluator.prior is None else evaluator.prior.samples
    return evaluator.judged(information, counted), total
