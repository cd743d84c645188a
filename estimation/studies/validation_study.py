"""How surely the validation tells a right model from a wrong one, on many simulated experiments.

The paper's Fig. 7: a model is identified on the designed motion and predicts the benchmark. It is
right, or the machine has a cogging force that the model does not know, or one of its parameters is
wrong on purpose.
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.diagnostics import Diagnosis, diagnose
from estimation.estimators import Experiment, ParameterEstimate
from estimation.identification import prepare_experiment, run_estimators
from estimation.identification.estimate import parameter_knowledge
from estimation.montecarlo import StudyMonitor
from estimation.montecarlo.repetition import FAILURES
from estimation.studies.share import Share
from estimation.studies.variants import TooFewEstimatesError, study_section, with_section
from estimation.studies.workers import results_of
from estimation.twin import Twin
from estimation.validation.motions import benchmark_motion
from expdesign.configuration import InputError, Problem, RunConfiguration, ValidationMotion
from expdesign.experiment.design import controller_period
from expdesign.robot import Robot, robot_from
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import Job, Monitor

SITUATIONS = ("without", "unknown", "known")
"""Cogging in neither experiment; in the validation alone; in the identification too."""

_FIRST_MOTION = 100_001
_FEWEST_PERIODS = 3


@dataclass(frozen=True, eq=False)
class Prediction:
    """One motion, predicted by one model.

    Attributes
    ----------
    failed : (6,) of bool
        Actuators that fail the lack-of-fit test.
    refused : str
        Why there was no such test; empty when there was.
    variance_model_error, variance_measurement_error : (6,)
        Of single samples about the prediction, and of their noise, N².
    against : tuple of str
        Assumptions that fail and matter.
    """

    failed: NDArray[np.bool_]
    refused: str
    variance_model_error: Array
    variance_measurement_error: Array
    against: tuple[str, ...]

    def says(self, wanted: NDArray[np.bool_]) -> bool:
        """Tell whether the test was done, and exactly these actuators failed."""
        return not self.refused and bool(np.all(self.failed == wanted))


@dataclass(frozen=True, eq=False)
class ValidationRun:
    """One identification and what its model predicts.

    Attributes
    ----------
    situations : dict of tuple of Prediction
        By situation, one per motion.
    wrong : dict of Prediction
        By the parameter that is wrong, of the first motion.
    """

    situations: dict[str, tuple[Prediction, ...]]
    wrong: dict[str, Prediction]


@dataclass(frozen=True, eq=False)
class ValidationStudy:
    """All runs.

    Attributes
    ----------
    configuration : RunConfiguration
    robot : Robot
    motions : tuple of str
        Names.
    runs : tuple of ValidationRun
    failed : int
        Runs that could not be estimated, and are not among them.
    first : dict of tuple of (Experiment, Diagnosis)
        The first run's motions by situation, to be drawn.
    seconds : float
    """

    configuration: RunConfiguration
    robot: Robot
    motions: tuple[str, ...]
    runs: tuple[ValidationRun, ...]
    failed: int
    first: dict[str, tuple[tuple[Experiment, Diagnosis], ...]]
    seconds: float

    def expected(self, situation: str) -> NDArray[np.bool_]:
        """Return which actuators should fail, (6,)."""
        amplitudes = np.broadcast_to(study_section(self.configuration).cogging.amplitude, 6)
        return np.asarray(amplitudes > 0) if situation == "unknown" else np.zeros(6, dtype=bool)

    def as_expected(self, situation: str, motion: int) -> Share:
        """Return how often exactly the right actuators fail on one motion, counted from 0."""
        wanted = self.expected(situation)
        return Share.of([run.situations[situation][motion].says(wanted) for run in self.runs])

    def everywhere_as_expected(self, situation: str) -> Share:
        """Return how often exactly the right actuators fail on all motions."""
        wanted = self.expected(situation)
        return Share.of(
            [all(one.says(wanted) for one in run.situations[situation]) for run in self.runs]
        )

    def power(self, parameter: str) -> Share:
        """Return how often a wrong parameter is seen on the first motion."""
        return Share.of([bool(run.wrong[parameter].against) for run in self.runs])

    def tests_against(self, parameter: str) -> list[tuple[str, int]]:
        """Return which tests saw a wrong parameter, and in how many runs, most often first."""
        seen: Counter[str] = Counter()
        for run in self.runs:
            seen.update(set(run.wrong[parameter].against))
        return sorted(seen.items(), key=lambda item: (-item[1], item[0]))


def run_validation_study(
    configuration: RunConfiguration,
    design: FourierTrajectory,
    monitor: StudyMonitor | None = None,
) -> ValidationStudy:
    """Identify, predict and test many times.

    Raises
    ------
    InputError
        The run cannot be simulated or estimated, or a motion cannot be made.
    TooFewEstimatesError
        No run can be estimated.
    StudyInterruptedError
        A stop was requested.
    """
    began = time.perf_counter()
    section = study_section(configuration)
    build = partial(ValidationBench, configuration, design)
    bench = build()
    jobs = [Job(_validated, (number,)) for number in range(1, section.repetitions + 1)]
    done = list(results_of(configuration, build, jobs, monitor, (0, len(jobs))))
    runs = tuple(run for run in done if run is not None)
    if not runs:
        raise TooFewEstimatesError("no run of the study could be estimated")
    return ValidationStudy(
        configuration,
        bench.robot,
        tuple(_motion_name(motion) for motion in section.motions),
        runs,
        len(done) - len(runs),
        bench.predicted(1 + next(k for k, run in enumerate(done) if run is not None)),
        time.perf_counter() - began,
    )


def _motion_name(motion: ValidationMotion) -> str:
    return motion.motion + ("" if motion.mirror == "none" else f", mirrored {motion.mirror}")


class ValidationBench:
    """What all runs share: robot, twins and motions, built once per process.

    Parameters
    ----------
    configuration : RunConfiguration
    design : FourierTrajectory
    """

    def __init__(self, configuration: RunConfiguration, design: FourierTrajectory) -> None:
        section = study_section(configuration)
        self.configuration = configuration
        self.design = design
        self.robot: Robot = robot_from(configuration.robot)
        self.knowledge = parameter_knowledge(configuration, self.robot)
        self.trajectories = refuse_unfit_validation_study(configuration, self.robot)
        self.wrong = section.wrong
        clean = with_section(configuration, "experiment", cogging=None)
        cogging = with_section(configuration, "experiment", cogging=section.cogging)
        seed = configuration.run.montecarlo.seed
        self.identified = {
            key: Twin.of(made, design, seed) for key, made in (("no", clean), ("yes", cogging))
        }
        self.predicted_on = {
            key: tuple(
                Twin.of(with_section(made, "experiment", periods=motion.periods), trajectory, seed)
                for motion, trajectory in zip(section.motions, self.trajectories, strict=True)
            )
            for key, made in (("no", clean), ("yes", cogging))
        }

    def validate(self, number: int) -> ValidationRun:
        """Return run `number`, counted from 1."""
        estimates = self._estimates(number)
        predicted = self._predicted(number, estimates)
        estimate = estimates["no"]
        experiment, _ = predicted["without"][0]
        wrong: dict[str, Prediction] = {}
        for name, factor in self.wrong.items():
            values = estimate.values.copy()
            values[self.robot.parameter_names.index(name)] *= factor
            model = replace(estimate, values=values)
            wrong[name] = _judged(self._diagnosis(experiment, model))
        return ValidationRun(
            {key: tuple(_judged(d) for _, d in pairs) for key, pairs in predicted.items()}, wrong
        )

    def predicted(self, number: int) -> dict[str, tuple[tuple[Experiment, Diagnosis], ...]]:
        """Return every motion of one run with its diagnosis, by situation."""
        return self._predicted(number, self._estimates(number))

    def _predicted(
        self, number: int, estimates: dict[str, ParameterEstimate]
    ) -> dict[str, tuple[tuple[Experiment, Diagnosis], ...]]:
        measured = {
            key: tuple(
                prepare_experiment(
                    self.configuration,
                    self.robot,
                    twin.measurement(_FIRST_MOTION * (k + 1) + number),
                    self.trajectories[k],
                )
                for k, twin in enumerate(twins)
            )
            for key, twins in self.predicted_on.items()
        }
        made = {"without": ("no", "no"), "unknown": ("no", "yes"), "known": ("yes", "yes")}
        return {
            situation: tuple((e, self._diagnosis(e, estimates[own])) for e in measured[on])
            for situation, (own, on) in made.items()
        }

    def _estimates(self, number: int) -> dict[str, ParameterEstimate]:
        """Return the models of one run, identified without cogging and with it."""
        return {key: self._estimate(key, number) for key in self.identified}

    def _estimate(self, cogging: str, number: int) -> ParameterEstimate:
        data = self.identified[cogging].measurement(number)
        experiment = prepare_experiment(self.configuration, self.robot, data, self.design)
        return run_estimators(self.robot, [experiment], self.knowledge, ("ml",))["ml"]

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
        if name not in robot.parameter_names:
            raise InputError(
                Problem(
                    f"the robot {robot.name} has no parameter '{name}'",
                    file=configuration.file,
                    key=f"study.wrong.{name}",
                    allowed=", ".join(robot.parameter_names),
                )
            )
    return tuple(
        _trajectory(configuration, robot, number, motion)
        for number, motion in enumerate(section.motions)
    )


def _trajectory(
    configuration: RunConfiguration, robot: Robot, number: int, motion: ValidationMotion
) -> FourierTrajectory:
    key = f"study.motions[{number + 1}]"
    if motion.periods < _FEWEST_PERIODS:
        raise InputError(
            Problem(
                "one period shows no scatter between periods to test against",
                file=configuration.file,
                key=f"{key}.periods",
                allowed=f"{_FEWEST_PERIODS} or more",
            )
        )
    if motion.motion == "file":
        raise InputError(
            Problem(
                "a recorded motion cannot be repeated on the digital twin",
                file=configuration.file,
                key=key,
                allowed="circle | line | spline",
            )
        )
    try:
        return benchmark_motion(motion, robot.home, controller_period(configuration))
    except ValueError as error:
        raise InputError(Problem(str(error), file=configuration.file, key=key)) from error


def _judged(diagnosis: Diagnosis) -> Prediction:
    one = diagnosis.experiments[0]
    failed = one.lack_of_fit.failed
    return Prediction(
        failed=np.zeros(6, dtype=bool) if one.lack_of_fit.refused else np.asarray(failed),
        refused=one.lack_of_fit.refused,
        variance_model_error=np.asarray(one.variances.model_error),
        variance_measurement_error=np.asarray(one.variances.measurement_error),
        against=tuple(f.assumption for f in diagnosis.verdict.failed if f.serious),
    )


def _validated(bench: ValidationBench, _monitor: Monitor, number: int) -> ValidationRun | None:
    try:
        return bench.validate(number)
    except FAILURES:
        return None
