"""Models identified on simulated experiments, and what each predicts of other motions."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from constraints.arrays import Mask
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.lack_of_fit import LackOfFit
from estimation.diagnostics.record import Diagnosis
from estimation.diagnostics.residuals import VarianceComparison
from estimation.estimators import Experiment, ParameterEstimate
from estimation.identification import prepare_experiment, run_estimators
from estimation.identification.estimate import parameter_knowledge
from estimation.studies.study import study_section, unknown_parameters
from estimation.twin import Twin
from estimation.validation.motions import motion_of_run
from expdesign.configuration import InputError, RunConfiguration, ValidationMotion
from expdesign.robot import Robot, robot_from
from expdesign.trajectory import FourierTrajectory

SITUATIONS = {
    "without": "no cogging",
    "unknown": "cogging that the model does not know",
    "known": "cogging in the identification too",
}
"""Cogging in neither experiment; in the validation alone; in the identification too."""

_COGGING = {"without": (False, False), "unknown": (False, True), "known": (True, True)}
"""Whether there is cogging while a model is identified, and while it is validated."""

_FIRST_MOTION = 100_001
_FEWEST_PERIODS = 3

Predicted = dict[str, tuple[tuple[Experiment, Diagnosis], ...]]
"""Every motion of one run with its diagnosis, by situation."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """One motion, predicted by one model: its tests, and the assumptions that fail and matter."""

    bias: LackOfFit
    variances: VarianceComparison
    against: tuple[str, ...]

    def says(self, wanted: Mask) -> bool:
        """Tell whether the test was done, and exactly these actuators failed."""
        return not self.bias.refused and bool(np.all(self.bias.failed == wanted))


@dataclass(frozen=True, eq=False)
class ValidationRun:
    """What one identification predicts: all motions by situation, the first by wrong parameter."""

    situations: dict[str, tuple[Prediction, ...]]
    wrong: dict[str, Prediction]


class ValidationBench:
    """What all runs share: robot, twins and motions, built once per process."""

    def __init__(self, configuration: RunConfiguration, design: FourierTrajectory) -> None:
        section, seed = study_section(configuration), configuration.run.montecarlo.seed
        self.configuration = configuration
        self.design = design
        self.robot: Robot = robot_from(configuration.robot)
        self.knowledge = parameter_knowledge(configuration, self.robot)
        self.trajectories = refuse_unfit_validation_study(configuration, self.robot)
        self.wrong = section.wrong
        machines = {
            cogging: configuration.with_section(
                "experiment", cogging=section.cogging if cogging else None
            )
            for cogging in (False, True)
        }
        self.identified = {key: Twin.of(made, design, seed) for key, made in machines.items()}
        self.predicted_on = {
            key: tuple(
                Twin.of(
                    made.with_section("experiment", periods=motion.periods, lost=None),
                    trajectory,
                    seed,
                )
                for motion, trajectory in zip(section.motions, self.trajectories, strict=True)
            )
            for key, made in machines.items()
        }

    def repeat(self, number: int) -> ValidationRun:
        """Return run `number`, counted from 1."""
        estimates = self.estimates(number)
        predicted = self.predicted(number, estimates)
        estimate = estimates[False]
        experiment, _ = predicted["without"][0]
        wrong: dict[str, Prediction] = {}
        for name, factor in self.wrong.items():
            values = estimate.values.copy()
            values[self.robot.parameter_names.index(name)] *= factor
            wrong[name] = _judged(self._diagnosis(experiment, replace(estimate, values=values)))
        return ValidationRun(
            {key: tuple(_judged(d) for _, d in pairs) for key, pairs in predicted.items()}, wrong
        )

    def predicted(self, number: int, estimates: dict[bool, ParameterEstimate]) -> Predicted:
        """Return every motion of one run as the run's models predict it, by situation."""
        measured = {
            key: tuple(
                prepare_experiment(
                    self.configuration,
                    self.robot,
                    twin.measurement(_FIRST_MOTION * (k + 1) + number),
                    self.trajectories[k],
                    held_out=True,
                )
                for k, twin in enumerate(twins)
            )
            for key, twins in self.predicted_on.items()
        }
        return {
            situation: tuple((e, self._diagnosis(e, estimates[own])) for e in measured[on])
            for situation, (own, on) in _COGGING.items()
        }

    def estimates(self, number: int) -> dict[bool, ParameterEstimate]:
        """Return the models of one run, identified without cogging and with it."""
        found = {}
        for cogging, twin in self.identified.items():
            data = twin.measurement(number)
            experiment = prepare_experiment(self.configuration, self.robot, data, self.design)
            found[cogging] = run_estimators(self.robot, [experiment], self.knowledge, ("ml",))["ml"]
        return found

    def _diagnosis(self, experiment: Experiment, estimate: ParameterEstimate) -> Diagnosis:
        return diagnose(self.robot, [experiment], self.knowledge, estimate, held_out=True)


def refuse_unfit_validation_study(
    configuration: RunConfiguration, robot: Robot
) -> tuple[FourierTrajectory, ...]:
    """Return the motions of the study, refusing what cannot be predicted or made wrong.

    Raises
    ------
    InputError
        A parameter that the robot does not have, or a motion that cannot be.
    """
    section = study_section(configuration)
    for name in section.wrong:
        if problems := unknown_parameters(configuration, robot, f"study.wrong.{name}", [name]):
            raise InputError(problems)
    return tuple(
        _trajectory(configuration, robot, f"study.motions[{number}]", motion)
        for number, motion in enumerate(section.motions, start=1)
    )


def _trajectory(
    configuration: RunConfiguration, robot: Robot, key: str, motion: ValidationMotion
) -> FourierTrajectory:
    message, allowed = "", ""
    if motion.periods < _FEWEST_PERIODS:
        key, allowed = f"{key}.periods", f"{_FEWEST_PERIODS} or more"
        message = "one period shows no scatter between periods to test against"
    elif motion.motion == "file":
        message = "a recorded motion cannot be repeated on the digital twin"
        allowed = "circle | line | spline"
    if message:
        raise InputError(message, file=configuration.file, key=key, allowed=allowed)
    return motion_of_run(configuration, motion, robot.home, key)


def _judged(diagnosis: Diagnosis) -> Prediction:
    tests = diagnosis.experiments[0].tests
    against = tuple(f.assumption for f in diagnosis.verdict.failed if f.serious)
    return Prediction(tests.lack_of_fit, tests.variance_comparison, against)
