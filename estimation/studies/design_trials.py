"""Designs by two criteria from the same initial parameters, each executed many times."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from constraints.arrays import Array
from estimation.montecarlo.repetition import Workbench
from estimation.studies.records import AgreementRow
from estimation.studies.study import (
    TooFewEstimatesError,
    results_of,
    study_section,
    unknown_parameters,
    with_exact_lengths,
)
from estimation.twin import Twin
from expdesign.configuration import InputError, Problem, RunConfiguration
from expdesign.configuration.sections.experiment import Kinematics
from expdesign.experiment import DesignResult
from expdesign.experiment.several import designed
from expdesign.information.periodic_noise import PeriodicNoise
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.robot import Robot
from expdesign.workers import Job, Monitor

ESTIMATORS = ("ls", "gm")
_SEEDS_APART = 1_000_003


@dataclass(frozen=True, eq=False)
class Trial:
    """One criterion from one set of initial parameters."""

    number: int
    criterion: str
    design: DesignResult
    predicted: dict[str, Array]
    """(m, m), covariances of LS and GM with exact kinematics."""
    values: dict[str, dict[str, Array]]
    """(K, m), estimates by kinematics and estimator, SI."""
    failed: dict[str, int]
    """Repetitions without an estimate, by kinematics."""

    @property
    def name(self) -> str:
        """Of its folder."""
        return trial_name(self.number, self.criterion)

    def predicted_std(self, estimator: str) -> Array:
        """Return the standard deviations predicted with exact kinematics, (m,), SI."""
        return np.asarray(np.sqrt(np.diag(self.predicted[estimator])))

    def agreement(self, kinematics: str, estimator: str) -> AgreementRow:
        """Return how the achieved variances compare with the predicted ones."""
        values = self.values[kinematics][estimator]
        count = len(values)
        off = (values - values.mean(axis=0)) ** 2 * count / (count - 1)
        squares = np.mean(off / np.diag(self.predicted[estimator]), axis=1)
        ratio, error = float(np.mean(squares)), float(np.std(squares, ddof=1) / np.sqrt(count))
        return AgreementRow(
            self.number, self.criterion, estimator, ratio, error, (ratio - 1) / error
        )


def run_trials(
    configuration: RunConfiguration, robot: Robot, monitor: Monitor | None
) -> tuple[Trial, ...]:
    """Design from every set of initial parameters, and execute; errors as `DesignStudy.run`."""
    section = study_section(configuration)
    pairs = [(k, c) for k in range(1, section.sets + 1) for c in section.criteria]
    total = len(pairs) * (1 + len(section.kinematics))
    build = partial(replace, configuration)
    jobs = [Job(_designed, (_variant(configuration, *pair),)) for pair in pairs]
    designs = list(results_of(configuration, build, jobs, monitor, (0, total)))
    wanted = [(index, k) for index in range(len(pairs)) for k in section.kinematics]
    jobs = [Job(_executed, (index, designs[index], k)) for index, k in wanted]
    found = list(results_of(configuration, build, jobs, monitor, (len(pairs), total)))
    size = len(robot.parameter_names)
    for (index, kinematics), (values, failed) in zip(wanted, found, strict=True):
        if len(values["ls"]) <= size:
            raise TooFewEstimatesError(
                f"design {trial_name(*pairs[index])}, kinematics {kinematics}: {failed} of "
                f"{section.repetitions} repetitions have no estimate; the covariance of {size} "
                f"parameters takes more than {size}"
            )
    by_trial = dict(zip(wanted, found, strict=True))
    return tuple(
        Trial(
            *pair,
            made,
            linear_covariances(robot, _workbench(configuration, index, made, "exact").twin),
            {k: by_trial[index, k][0] for k in section.kinematics},
            {k: by_trial[index, k][1] for k in section.kinematics},
        )
        for index, (pair, made) in enumerate(zip(pairs, designs, strict=True))
    )


def refuse_unfit_design_study(configuration: RunConfiguration, robot: Robot) -> None:
    """Refuse what a comparison of all parameters' covariances cannot have.

    Raises
    ------
    InputError
        Too few repetitions, or something that is known of the parameters or left out of them.
    """
    section, run = study_section(configuration), configuration.run
    size = len(robot.parameter_names)
    found: list[tuple[str, str, str]] = []
    if section.repetitions <= size:
        message = f"{section.repetitions} repetitions do not give a covariance of {size} parameters"
        found.append(("study.repetitions", message, f"more than {size}"))
    message = (
        "the covariances of two designs are compared over all parameters, with nothing known of "
        "them"
    )
    found += [
        (f"estimate.{key}", message, "nothing")
        for key in ("fixed", "prior", "bounds")
        if getattr(run.estimate, key)
    ]
    if run.design.parameters is not None:
        found.append(("design.parameters", "the designs of a study judge all parameters", "all"))
    problems = [
        Problem(message, file=configuration.file, key=key, allowed=allowed)
        for key, message, allowed in found
    ]
    problems += unknown_parameters(configuration, robot, "study.shown", section.shown)
    if problems:
        raise InputError(problems)


def trial_name(number: int, criterion: str) -> str:
    """Return the name of a trial's folder."""
    return f"{number}-{criterion}"


def _variant(configuration: RunConfiguration, number: int, criterion: str) -> RunConfiguration:
    """Return the run of one trial's design alone."""
    run = configuration.run
    changed = configuration.with_section(
        "design", criterion=criterion, seed=run.design.seed + number - 1
    )
    name = f"{run.name}-{trial_name(number, criterion)}"
    own = changed.run.model_copy(update={"name": name, "study": None})
    return RunConfiguration(own, configuration.robot, configuration.file)


def _designed(
    _built: RunConfiguration, monitor: Monitor, variant: RunConfiguration
) -> DesignResult:
    return designed(variant, monitor)


def _executed(
    configuration: RunConfiguration,
    _monitor: Monitor,
    index: int,
    result: DesignResult,
    kinematics: Kinematics,
) -> tuple[dict[str, Array], int]:
    """Return estimates by estimator, (K, m), and how many repetitions have none."""
    workbench = _workbench(configuration, index, result, kinematics)
    count = study_section(configuration).repetitions
    found = []
    for number in range(1, count + 1):
        outcomes = workbench.repeat(number).outcomes
        values = [outcomes[name].values for name in ESTIMATORS]
        if all(one is not None for one in values):
            found.append(values)
    return {
        name: np.array([values[k] for values in found], dtype=np.float64)
        for k, name in enumerate(ESTIMATORS)
    }, count - len(found)


def _workbench(
    configuration: RunConfiguration, index: int, result: DesignResult, kinematics: Kinematics
) -> Workbench:
    """Return what repeats one design's experiment; no two designs share their noise."""
    seed = configuration.run.montecarlo.seed + _SEEDS_APART * (index + 1)
    changed = configuration.with_section("montecarlo", estimators=ESTIMATORS, seed=seed)
    differentiation = "central" if kinematics == "central" else "fourier"
    changed = changed.with_section("estimate", differentiation=differentiation)
    if kinematics == "exact":
        changed = with_exact_lengths(changed)
    return Workbench.of(changed, result.trajectory)


def linear_covariances(robot: Robot, twin: Twin) -> dict[str, Array]:
    """Return the covariances of LS and GM by name, (m, m) each, SI.

    Over the samples and periods that the twin executes, at the true motion:
    (ΨᵀΨ)⁻¹ ΨᵀΣΨ (ΨᵀΨ)⁻¹ and F⁻¹ = (Ψᵀ Σ⁻¹ Ψ)⁻¹; of noise with memory over the lines of the period,
    or of the record where that is no whole number of samples.
    """
    states = twin.truth.executed.sample(twin.grid.distinct_times)
    regressors = robot.regressor(*states)
    repeats = twin.grid.count / len(twin.grid.distinct_times)
    covariance = twin.truth.force_covariance
    flat = regressors.reshape(-1, regressors.shape[2])

    def inner(weights: Array) -> Array:
        return flat.T @ np.matmul(weights, regressors).reshape(flat.shape) * repeats

    def inverse(matrix: Array) -> Array:
        return np.asarray(np.linalg.inv(matrix), dtype=np.float64)

    plain = inverse(inner(np.eye(ACTUATORS)))
    spectrum = twin.force_noise.spectrum
    if spectrum is not None:
        memory = PeriodicNoise(spectrum, twin.grid.sampling, repeats)
        omega = 2 * np.pi * twin.grid.sampling / len(regressors)
        return {
            "ls": plain @ (memory.spread(regressors, omega) * repeats) @ plain,
            "gm": inverse(memory.information(regressors, omega) * repeats),
        }
    return {
        "ls": plain @ inner(covariance) @ plain,
        "gm": inverse(inner(inverse(covariance))),
    }
