"""Two criteria of design, from the same initial parameters, each executed many times.

The paper's Section IV-C: the statistical design (log det F) against the deterministic one
(condition number), both evaluated with LS, and here with GM too. Initial parameters are the start
of the search: one random motion each, the same for both criteria.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from constraints.arrays import Array
from estimation.montecarlo import StudyMonitor
from estimation.montecarlo.repetition import Recipe
from estimation.studies.determinant import DeterminantComparison, compare_determinants
from estimation.studies.linear_prediction import linear_covariances
from estimation.studies.mean_difference import mean_difference
from estimation.studies.variants import (
    TooFewEstimatesError,
    study_section,
    with_exact_lengths,
    with_section,
)
from estimation.studies.workers import results_of
from estimation.uncertainty.differences import Differences
from expdesign.configuration import (
    InputError,
    Kinematics,
    Problem,
    RunConfiguration,
    StudySection,
)
from expdesign.experiment import DesignResult, design
from expdesign.experiment.scaling import parameter_scaling
from expdesign.robot import Robot, robot_from
from expdesign.workers import Job, Monitor

ESTIMATORS = ("ls", "gm")
_SEEDS_APART = 1_000_003


@dataclass(frozen=True, eq=False)
class Agreement:
    """Achieved over predicted variance, pooled over the parameters.

    Attributes
    ----------
    ratio, std_error : float
        1 when the prediction is right; the error comes from the scatter between repetitions.
    """

    ratio: float
    std_error: float

    @property
    def z(self) -> float:
        """How many standard errors the ratio is off."""
        return (self.ratio - 1) / self.std_error


@dataclass(frozen=True, eq=False)
class Trial:
    """One criterion from one set of initial parameters.

    Attributes
    ----------
    number : int
        Of the set, from 1.
    criterion : str
    design : DesignResult
    predicted : dict of (m, m)
        Covariances of LS and GM with exact kinematics.
    values : dict of dict of (K, m)
        Estimates, by kinematics and estimator, SI.
    failed : dict of int
        Repetitions without an estimate, by kinematics.
    """

    number: int
    criterion: str
    design: DesignResult
    predicted: dict[str, Array]
    values: dict[str, dict[str, Array]]
    failed: dict[str, int]

    def agreement(self, kinematics: str, estimator: str) -> Agreement:
        """Return how the achieved variances compare with the predicted ones."""
        values = self.values[kinematics][estimator]
        count = len(values)
        off = (values - values.mean(axis=0)) ** 2 * count / (count - 1)
        squares = np.mean(off / np.diag(self.predicted[estimator]), axis=1)
        return Agreement(float(np.mean(squares)), float(np.std(squares, ddof=1) / np.sqrt(count)))


@dataclass(frozen=True, eq=False)
class DesignStudy:
    """All trials.

    Attributes
    ----------
    configuration : RunConfiguration
    robot : Robot
    trials : tuple of Trial
        Set by set, in the order of the criteria.
    seconds : float
    """

    configuration: RunConfiguration
    robot: Robot
    trials: tuple[Trial, ...]
    seconds: float

    @property
    def section(self) -> StudySection:
        """What the run asked for."""
        return study_section(self.configuration)

    @property
    def sets(self) -> tuple[tuple[Trial, Trial], ...]:
        """Trials of each set: first and second criterion."""
        return tuple((self.trials[k], self.trials[k + 1]) for k in range(0, len(self.trials), 2))

    def determinant(
        self, pair: tuple[Trial, Trial], kinematics: str, estimator: str
    ) -> DeterminantComparison:
        """Compare the determinants of what both designs achieved."""
        first, second = (trial.values[kinematics][estimator] for trial in pair)
        return compare_determinants(first, second, parameter_scaling(self.robot, "nominal"))

    def means(self, pair: tuple[Trial, Trial], kinematics: str, estimator: str) -> Differences:
        """Test whether both designs lead to the same mean estimate."""
        first, second = (trial.values[kinematics][estimator] for trial in pair)
        return mean_difference(first, second)

    def more_precise(
        self, pair: tuple[Trial, Trial], kinematics: str, estimator: str
    ) -> NDArray[np.bool_]:
        """Return for which parameters the first criterion has the smaller spread, (m,)."""
        first, second = (trial.values[kinematics][estimator].std(axis=0, ddof=1) for trial in pair)
        return np.asarray(first < second)


def run_design_study(
    configuration: RunConfiguration, monitor: StudyMonitor | None = None
) -> DesignStudy:
    """Design with both criteria from every set of initial parameters, and execute each many times.

    Raises
    ------
    InputError
        The run cannot be designed or simulated.
    NoDesignError, InfeasibleLimitsError, SingularInformationError
        A design failed.
    TooFewEstimatesError
        Too many repetitions could not be estimated.
    StudyInterruptedError
        A stop was requested.
    """
    began = time.perf_counter()
    section = study_section(configuration)
    robot = robot_from(configuration.robot)
    refuse_unfit_design_study(configuration, robot)
    pairs = [(k, c) for k in range(1, section.sets + 1) for c in section.criteria]
    total = len(pairs) * (1 + len(section.kinematics))
    build = partial(_Bench, configuration)
    jobs = [Job(_designed, pair) for pair in pairs]
    designs = list(results_of(configuration, build, jobs, monitor, (0, total)))
    wanted = [(index, k) for index in range(len(pairs)) for k in section.kinematics]
    jobs = [Job(_executed, (index, designs[index], k)) for index, k in wanted]
    found = list(results_of(configuration, build, jobs, monitor, (len(pairs), total)))
    executed = dict(zip(wanted, found, strict=True))
    size = len(robot.parameter_names)
    for (index, kinematics), (values, failed) in executed.items():
        if len(values["ls"]) <= size:
            raise TooFewEstimatesError(
                f"design {trial_name(*pairs[index])}, kinematics {kinematics}: {failed} of "
                f"{section.repetitions} repetitions have no estimate; the covariance of {size} "
                f"parameters takes more than {size}"
            )
    trials = []
    for index, (number, criterion) in enumerate(pairs):
        trials.append(
            Trial(
                number=number,
                criterion=criterion,
                design=designs[index],
                predicted=linear_covariances(
                    robot, _recipe(configuration, index, designs[index], "exact")().twin
                ),
                values={k: executed[index, k][0] for k in section.kinematics},
                failed={k: executed[index, k][1] for k in section.kinematics},
            )
        )
    return DesignStudy(configuration, robot, tuple(trials), time.perf_counter() - began)


def refuse_unfit_design_study(configuration: RunConfiguration, robot: Robot) -> None:
    """Refuse what a comparison of all parameters' covariances cannot have.

    Raises
    ------
    InputError
        Too few repetitions, or something that is known of the parameters or left out of them.
    """
    section, estimate = study_section(configuration), configuration.run.estimate
    problems = []
    size = len(robot.parameter_names)
    if section.repetitions <= size:
        problems.append(
            Problem(
                f"{section.repetitions} repetitions do not give a covariance of {size} parameters",
                file=configuration.file,
                key="study.repetitions",
                allowed=f"more than {size}",
            )
        )
    problems += [
        Problem(
            "the covariances of two designs are compared over all parameters, with nothing known "
            "of them",
            file=configuration.file,
            key=f"estimate.{key}",
            allowed="nothing",
        )
        for key in ("fixed", "prior", "bounds")
        if getattr(estimate, key)
    ]
    if configuration.run.design.parameters is not None:
        problems.append(
            Problem(
                "the designs of a study judge all parameters",
                file=configuration.file,
                key="design.parameters",
                allowed="all",
            )
        )
    problems += [
        Problem(
            f"the robot {robot.name} has no parameter '{name}'",
            file=configuration.file,
            key="study.shown",
            allowed=", ".join(robot.parameter_names),
        )
        for name in section.shown
        if name not in robot.parameter_names
    ]
    if problems:
        raise InputError(problems)


def trial_name(number: int, criterion: str) -> str:
    """Return the name of a trial's folder."""
    return f"{number}-{criterion}"


@dataclass(frozen=True)
class _Bench:
    """What every job shares."""

    configuration: RunConfiguration


def _designed(bench: _Bench, monitor: Monitor, number: int, criterion: str) -> DesignResult:
    configuration = bench.configuration
    run = configuration.run
    changed = with_section(
        configuration, "design", criterion=criterion, seed=run.design.seed + number - 1
    )
    name = f"{run.name}-{trial_name(number, criterion)}"
    own = changed.run.model_copy(update={"name": name, "workers": 1, "study": None})
    return design(RunConfiguration(own, configuration.robot, configuration.file), monitor)


def _executed(
    bench: _Bench, _monitor: Monitor, index: int, result: DesignResult, kinematics: Kinematics
) -> tuple[dict[str, Array], int]:
    """Return estimates by estimator, (K, m), and how many repetitions have none."""
    workbench = _recipe(bench.configuration, index, result, kinematics)()
    count = study_section(bench.configuration).repetitions
    values: dict[str, list[Array]] = {name: [] for name in ESTIMATORS}
    failed = 0
    for number in range(1, count + 1):
        outcomes = workbench.repeat(number).outcomes
        found = {name: outcomes[name].values for name in ESTIMATORS}
        if any(value is None for value in found.values()):
            failed += 1
            continue
        for name, value in found.items():
            values[name].append(np.asarray(value))
    return {name: np.array(rows) for name, rows in values.items()}, failed


def _recipe(
    configuration: RunConfiguration, index: int, result: DesignResult, kinematics: Kinematics
) -> Recipe:
    """Return how to repeat one design's experiment; no two designs share their noise."""
    seed = configuration.run.montecarlo.seed + _SEEDS_APART * (index + 1)
    changed = with_section(configuration, "montecarlo", estimators=ESTIMATORS, seed=seed)
    differentiation = "central" if kinematics == "central" else "fourier"
    changed = with_section(changed, "estimate", differentiation=differentiation)
    if kinematics == "exact":
        changed = with_exact_lengths(changed)
    return Recipe(changed, result.trajectory)
