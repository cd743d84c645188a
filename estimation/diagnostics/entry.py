"""The one call: diagnostics and verdict of an estimate, or of its prediction of held-out data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from estimation.diagnostics.diagnosis import ExperimentDiagnosis, diagnose_experiments
from estimation.diagnostics.verdict import Verdict, verdict
from estimation.estimators.experiment import Experiment
from estimation.estimators.knowledge import Knowledge
from estimation.estimators.result import ParameterEstimate
from expdesign.robot import Robot


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """Everything that is known of how well an estimate fits.

    Attributes
    ----------
    estimator : str
    experiments : tuple of ExperimentDiagnosis
    verdict : Verdict
    """

    estimator: str
    experiments: tuple[ExperimentDiagnosis, ...]
    verdict: Verdict


def diagnose(
    robot: Robot,
    experiments: Sequence[Experiment],
    knowledge: Knowledge,
    estimate: ParameterEstimate,
    *,
    held_out: bool = False,
) -> Diagnosis:
    """Diagnose an estimate.

    Parameters
    ----------
    experiments : sequence of Experiment
        Those that the estimate was made from, in the same order; or others, with motions of their
        own, when `held_out`.
    knowledge : Knowledge
        What the estimate knew besides the data.
    estimate : ParameterEstimate
        Of any estimator.
    held_out : bool
        The forces of the experiments were not used for the estimate: Cov(p̂) is part of what the
        residuals may be.
    """
    results = diagnose_experiments(robot, experiments, knowledge, estimate, held_out=held_out)
    return Diagnosis(estimate.estimator, results, verdict(results))
