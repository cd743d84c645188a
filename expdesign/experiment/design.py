"""The design of an experiment: from a configuration to a checked trajectory."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from functools import partial

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import ConfigurationLike, InputError, RunConfiguration, load_run
from expdesign.configuration.loading import smoothing_widths
from expdesign.configuration.noise import NOISE_FROM_DATA
from expdesign.configuration.prior import identification_of
from expdesign.experiment.predicted_precision import (
    experiment_information,
    identified_combinations,
    precision,
)
from expdesign.experiment.result import DesignResult, imprecise, whole
from expdesign.experiment.systematic import systematic_std
from expdesign.information.criteria import CRITERIA
from expdesign.information.fisher import (
    EXCITABLE,
    ScaledInformation,
    SingularInformationError,
    weak_directions,
)
from expdesign.information.marginal import PriorMachine
from expdesign.information.periodic_noise import PeriodicNoise
from expdesign.noise.hum import Hum
from expdesign.problem.design_problem import DesignProblem, build_problem
from expdesign.progress import report_progress, track
from expdesign.recheck.excitable import structural_base
from expdesign.recheck.information import Evaluator
from expdesign.recheck.unlimited import POINTS, unlimited, unlimited_warning
from expdesign.robot import Robot, robot_from
from expdesign.solver.continuation import coarse_points
from expdesign.solver.finish import FARTHEST
from expdesign.solver.hum_distance import KnownHum
from expdesign.solver.initial import InfeasibleLimitsError, random_start
from expdesign.solver.jobs import DesignTask, SearchPlan
from expdesign.solver.search import NoDesignError, search
from expdesign.trajectory import FourierTrajectory
from expdesign.workers import Monitor

_PROBES = 3
_PROBE_ATTEMPTS = 8
_FEWEST_PERIODS = 2
_HOPELESS = 1e-2
"""A random feasible motion whose weakest direction is this factor below what counts as excited
will not be optimised into an exciting one: the limits themselves are too tight."""


def design(config: ConfigurationLike, monitor: Monitor | None = None) -> DesignResult:
    """Design the optimal excitation trajectory of a run.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
    monitor : Monitor, optional
        Gets every iteration and may ask to stop; the best so far is then the result, marked.

    Raises
    ------
    InputError
        The configuration is not valid.
    SingularInformationError
        The limits do not let some parameters be excited; it names them.
    InfeasibleLimitsError, NoDesignError
        No motion keeps the limits.
    """
    configuration = load_run(config)
    began = time.perf_counter()
    if all(limit.is_default for limit in configuration.robot.limits.values()):
        raise InputError(
            "neither robot nor run limit anything: there is no best motion",
            file=configuration.file,
            key="limits",
            allowed="at least limits of the strut's length, speed and force",
        )
    watch = monitor or Monitor()
    report_progress("building the problem")
    task = design_task(configuration)
    _refuse_inseparable(task)
    _refuse_unexcitable(task)
    workers = min(task.plan.workers, task.plan.starts)
    if workers > 1:
        # One process alone does so as soon as it is worth it, and in a small search it never is.
        task.problem.compile()
    report_progress("the first start" if workers == 1 else f"starting {workers} processes")
    try:
        found = search(partial(design_task, configuration), task.plan, watch)
    except NoDesignError as error:
        _blame_unexcited(task, error)
        raise
    report_progress("the precision of the design")
    trajectory = found.finished.trajectory
    evaluator, samples = task.evaluator, configuration.run.trajectory.samples
    information = evaluator.information(trajectory, samples)
    whole_information, total = experiment_information(evaluator, trajectory, configuration)
    periods = configuration.run.experiment.periods
    experiment = precision(evaluator, whole_information, total, periods)
    return DesignResult(
        configuration=configuration,
        robot=evaluator.robot,
        trajectory=trajectory,
        samples=samples,
        samples_per_period=trajectory.period / task.plan.controller_period,
        parameter_names=evaluator.names,
        information=information,
        log_det_information=evaluator.log_det(information),
        criterion_value=evaluator.value(information),
        per_period=precision(evaluator, information, samples, 1),
        experiment=experiment,
        base_parameters=identified_combinations(configuration, evaluator, whole_information),
        hum=task.plan.hum.distances(trajectory.omega),
        systematic=systematic_std(
            evaluator.robot,
            trajectory,
            samples,
            evaluator.names,
            evaluator.covariance,
            _length_covariance(configuration),
            evaluator.prior,
        ),
        check=found.finished.check,
        search=found,
        seconds=time.perf_counter() - began,
        warnings=(
            *configuration.warnings,
            *_unlimited(evaluator.robot, trajectory),
            *_warnings(configuration, trajectory, task),
            *imprecise(evaluator.robot, experiment),
        ),
    )


def design_task(configuration: RunConfiguration) -> DesignTask:
    """Build problem, evaluator and plan of a run; every worker process does it once."""
    run = configuration.run
    robot = robot_from(configuration.robot)
    names = judged_parameters(configuration, robot)
    scaling = robot.scales if run.design.scaling == "nominal" else np.ones(len(robot.scales))
    criterion = CRITERIA[run.design.criterion]
    covariance, memory = force_covariance(configuration), force_memory(configuration)
    prior = prior_machine(configuration, robot, names)
    problem = build_problem(
        robot,
        harmonics=run.trajectory.harmonics,
        frequency=run.trajectory.frequency,
        samples=run.trajectory.samples,
        covariance=covariance,
        criterion=criterion,
        scaling=scaling,
        names=names,
    )
    problem = problem.with_noise(memory).with_prior(prior, scaling)
    if run.design.start == "rest":
        problem = problem.with_variables(rest=True)
    plan = SearchPlan(
        starts=run.design.starts,
        hops=run.design.hops if run.design.search == "hopping" else 0,
        seed=run.design.seed,
        widths=run.design.smoothing or smoothing_widths(configuration.robot),
        iterations=run.design.max_iterations,
        controller_period=run.controller_period,
        hum=known_hum(configuration),
        workers=run.workers or 1,
        scheduler=run.scheduler,
        max_seconds=run.design.max_seconds,
    )
    evaluator = Evaluator(robot, covariance, criterion, scaling, names, memory, prior)
    return DesignTask(_well_scaled(problem, evaluator, plan), evaluator, plan)


def _well_scaled(problem: DesignProblem, evaluator: Evaluator, plan: SearchPlan) -> DesignProblem:
    """Give the problem a scaling in which a random motion's F has a unit diagonal.

    log det F does not depend on the scaling, but the digits that its eigenvalues keep do.
    """
    information = evaluator.whole_information(_probe(problem, plan, 0), problem.cost.samples)
    sizes = np.sqrt(np.diag(information) / problem.cost.samples)
    scaling = 1 / np.where(sizes > 0, sizes, 1.0)
    return replace(problem, even_scaling=scaling).with_criterion(problem.criterion)


def _probe(problem: DesignProblem, plan: SearchPlan, number: int) -> FourierTrajectory:
    """Return one of a few random feasible motions that no start uses."""
    points = coarse_points(problem.variables.harmonics)
    for attempt in range(_PROBE_ATTEMPTS):
        rng = np.random.default_rng(
            np.random.SeedSequence(plan.seed, spawn_key=(0, number, attempt))
        )
        try:
            x = random_start(problem, rng, points, plan.widths[0])
        except InfeasibleLimitsError:
            if attempt + 1 == _PROBE_ATTEMPTS:
                raise
        else:
            return problem.variables.trajectory(x)
    raise AssertionError("the last attempt returns or raises")


def prior_machine(
    configuration: RunConfiguration, robot: Robot, names: tuple[str, ...]
) -> PriorMachine | None:
    """Return what `design.prior` knows of the robot; None without one.

    The experiment's samples are those at the highest frequency that is allowed: motions are
    compared at the same measuring time.
    """
    machine = configuration.run.design.prior
    if machine is None:
        return None
    changed = np.array([robot.parameter_names.index(name) for name in names], dtype=np.intp)
    experiment = configuration.run.experiment
    samples = experiment.periods * experiment.sampling / configuration.run.trajectory.frequency[1]
    return PriorMachine.of(identification_of(machine), changed, samples)


def force_covariance(configuration: RunConfiguration) -> Array:
    """Return Σ, (6, 6), N²; refuse a run that states no noise of the forces."""
    noise = configuration.robot.noise
    if noise is None or noise.force_covariance is None:
        raise InputError(
            "the design needs the noise of the forces, and neither robot nor run state it",
            file=configuration.file,
            key="noise",
            allowed=f"force_std (six values) or force_covariance (6 × 6); {NOISE_FROM_DATA}",
        )
    return noise.force_covariance


def _length_covariance(configuration: RunConfiguration) -> Array | None:
    noise = configuration.robot.noise
    return None if noise is None else noise.length_covariance


def force_memory(configuration: RunConfiguration) -> PeriodicNoise | None:
    """Return the noise of the forces in the run's experiment; None where it is white."""
    noise, experiment = configuration.robot.noise, configuration.run.experiment
    if noise is None or noise.force_spectrum is None:
        return None
    return PeriodicNoise(noise.force_spectrum, experiment.sampling, experiment.periods)


def known_hum(configuration: RunConfiguration) -> KnownHum:
    """Return the hums that the run's noise has, in forces or lengths, and the run's periods."""
    noise = configuration.robot.noise
    spectra = () if noise is None else (noise.force_spectrum, noise.length_spectrum)
    frequencies = {
        float(frequency)
        for spectrum in spectra
        if spectrum is not None
        for part in spectrum.parts
        if isinstance(part, Hum)
        for frequency in part.frequencies
    }
    return KnownHum(tuple(sorted(frequencies)), configuration.run.experiment.periods)


def judged_parameters(configuration: RunConfiguration, robot: Robot) -> tuple[str, ...]:
    """Return the parameters that the criterion judges, in the order of the regressor."""
    if configuration.run.design.parameters == "base":
        return structural_base(robot).base
    wanted = configuration.run.design.named_parameters
    return tuple(name for name in robot.parameter_names if wanted is None or name in wanted)


def _refuse_inseparable(task: DesignTask) -> None:
    """Fail before anything is searched where no motion of the machine tells parameters apart."""
    found = structural_base(task.evaluator.robot, task.evaluator.names)
    if found.regrouped:
        raise SingularInformationError(weak_directions(found), structural=True)


def _refuse_unexcitable(task: DesignTask) -> None:
    """Fail early when random feasible motions are hopelessly far from exciting everything."""
    problem, best, found = task.problem, 0.0, None
    for number in track("trial motions within the limits", range(_PROBES)):
        trajectory = _probe(problem, task.plan, number)
        scaled = ScaledInformation.of(task.evaluator.information(trajectory, problem.cost.samples))
        values = scaled.eigenvalues()
        ratio = max(float(values[0] / values[-1]), 0.0) if values[-1] > 0 else 0.0
        if found is None or ratio > best:
            best, found = ratio, scaled
    if found is not None and best < _HOPELESS * EXCITABLE:
        raise SingularInformationError(found.weak_directions(task.evaluator.names))


def _blame_unexcited(task: DesignTask, error: NoDesignError) -> None:
    """Raise `SingularInformationError` if that is why none of the starts has a result."""
    informations = [
        ScaledInformation.of(
            task.evaluator.information(
                task.problem.variables.trajectory(start.variables), task.problem.cost.samples
            )
        )
        for start in error.starts
        if np.all(np.isfinite(start.variables))
    ]
    if informations and all(scaled.is_singular() for scaled in informations):
        fewest = min((s.weak_directions(task.evaluator.names) for s in informations), key=len)
        raise SingularInformationError(fewest) from error


def _unlimited(robot: Robot, trajectory: FourierTrajectory) -> tuple[str, ...]:
    """Return a warning of what is not limited, with what the motion does there, or nothing."""
    found = unlimited(robot, trajectory, trajectory.sample_times(POINTS))
    warning = unlimited_warning(found)
    return (warning,) if warning else ()


def _warnings(
    configuration: RunConfiguration, trajectory: FourierTrajectory, task: DesignTask
) -> tuple[str, ...]:
    found = []
    steps = trajectory.period / task.plan.controller_period
    if whole(steps) is None:
        step = task.plan.controller_period
        slower, faster = (1 / (count * step) for count in (math.ceil(steps), math.floor(steps)))
        found.append(
            f"the frequency is fixed, and its period is {steps:.6g} controller steps, not a whole "
            "number: a controller that repeats a table will not repeat this motion exactly. "
            f"{math.ceil(steps)} steps would be {slower:.9g} Hz, {math.floor(steps)} steps "
            f"{faster:.9g} Hz"
        )
    found += [
        f"the hum of {one.frequency:g} Hz is {one.lines:.2g} lines of the record from multiple "
        f"{one.multiple} of the motion's frequency: it repeats in every period and biases the "
        "parameters, and no scatter between periods shows it. "
        + _no_way_around(configuration, task)
        for one in task.plan.hum.distances(trajectory.omega)
        if not one.kept
    ]
    return tuple(found)


def _no_way_around(configuration: RunConfiguration, task: DesignTask) -> str:
    """Return why the frequency does not keep away from a hum, and what would help."""
    if task.plan.hum.periods < _FEWEST_PERIODS:
        return f"Measure {_FEWEST_PERIODS} periods or more"
    low, high = configuration.run.trajectory.frequency
    if low == high:
        return "The frequency is fixed: choose another one"
    return (
        f"No whole number of controller steps within {100 * FARTHEST:g} % of the best period keeps "
        "away from every hum: measure more periods, or let the controller's step be shorter"
    )
