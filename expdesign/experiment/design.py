"""The design of an experiment: from a configuration to a checked trajectory."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial

import numpy as np

from expdesign.configuration import ConfigurationLike, InputError, RunConfiguration, load_run
from expdesign.experiment import result
from expdesign.experiment.judging import noise_evaluator
from expdesign.experiment.precision import (
    derived_precisions,
    experiment_information,
    identified_combinations,
    imprecise,
    parameter_precisions,
    precision,
    predicted_errors,
    scaled_eigenvalues,
    tolerance_std,
    whole,
)
from expdesign.experiment.setup import (
    compile_search,
    plan_search,
    probe_motion,
    ready_plan,
)
from expdesign.information import fisher
from expdesign.information.criteria import criteria
from expdesign.motion.executable import SampledMotion
from expdesign.progress import report_progress, track
from expdesign.recheck.evaluator import Evaluator
from expdesign.recheck.excitable import structural_base
from expdesign.recheck.limit_check import POINTS, unlimited, unlimited_warning
from expdesign.solver.phases import Iteration
from expdesign.solver.search import NoDesignError, SearchResult, search
from expdesign.solver.starts import SearchPlan, status_text
from expdesign.trajectory import FARTHEST, FourierTrajectory, fourier_keys
from expdesign.workers import JobJournal, Monitor, prepare_workers

_PROBES = 3
_FEWEST_PERIODS = 2
_HOPELESS = 1e-2
"""Ratio to the excitation threshold below which the weakest direction of random feasible motions
cannot be optimised into an excited one: the limits are too tight."""


def design(
    config: ConfigurationLike,
    monitor: Monitor | None = None,
    journal: JobJournal | None = None,
    *,
    effort: str | None = None,
    seed: int | None = None,
) -> result.DesignResult:
    """Design the optimal excitation trajectory of a run.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
    monitor : Monitor, optional
        Gets every iteration and may request a stop; the result is then the best so far, marked.
    journal : JobJournal, optional
        Keeps the results of starts and hops, from which an interrupted design continues.
    effort : {"quick", "normal", "thorough"}, optional
        Size of the search, instead of the run's `design.effort`, starts and hops.
    seed : int, optional
        Seed of the search, instead of `design.seed`.

    Raises
    ------
    InputError
        The configuration is not valid.
    SingularInformationError
        The limits do not let some parameters be excited; it names them.
    InfeasibleLimitsError, NoDesignError
        No motion keeps the limits.
    """
    configuration = load_run(config).with_search(effort, seed)
    count = configuration.run.trajectory.count
    if count > 1:
        raise InputError(
            f"{count} motions have a run folder each, and this returns one design",
            file=configuration.file,
            key="trajectory.count",
            allowed="`expdesign.run` or the command, or count: 1",
        )
    return design_result(configuration, find_motion(configuration, monitor or Monitor(), journal))


@dataclass(frozen=True, eq=False)
class FoundMotion:
    """A motion with its search, and the evaluation that the search is for."""

    plan: SearchPlan
    noise: Evaluator
    """That of the noise alone."""
    search: SearchResult


def find_motion(
    configuration: RunConfiguration,
    monitor: Monitor,
    journal: JobJournal | None = None,
    others: Sequence[FourierTrajectory] | None = None,
    origin: FourierTrajectory | None = None,
) -> FoundMotion:
    """Search for the motion of a run.

    `others` are the other motions of the experiment, by default those of `design.others`. With an
    `origin` that motion is improved, instead of random starts.
    """
    if all(limit.is_default for limit in configuration.robot.limits.values()):
        raise InputError(
            "neither robot nor run limit anything: there is no best motion",
            file=configuration.file,
            key="limits",
            allowed="at least limits of the strut's length, speed and force",
        )
    report_progress("building the problem")
    workers = min(configuration.run.workers or 1, configuration.run.design.starts)
    build = partial(ready_plan if workers > 1 else plan_search, configuration, others)
    if workers > 1:
        prepare_workers(build)
    plan = replace(build(), origin=origin)
    noise = noise_evaluator(configuration)
    if origin is None:
        structure = structural_base(noise.robot, noise.names)
        if structure.regrouped:
            weak = fisher.weak_directions(structure)
            raise fisher.SingularInformationError(weak, structural=True)
        _refuse_unexcitable(plan, noise)
    if workers > 1:
        # A single process compiles when it pays off, in a small search never.
        compile_search(build, plan, monitor)
    report_progress("the first start" if workers == 1 else f"starting {workers} processes")
    try:
        return FoundMotion(plan, noise, search(build, plan, monitor, journal))
    except NoDesignError as error:
        _blame_unexcited(plan, noise, error)
        raise


def design_result(configuration: RunConfiguration, found: FoundMotion) -> result.DesignResult:
    """Return the design of a motion that was found, with its own precision."""
    report_progress("the precision of the design")
    plan, evaluator, trajectory = found.plan, found.noise, found.search.trajectory
    samples = configuration.run.trajectory.samples
    one_period = evaluator.whole_information(trajectory, samples)
    information = evaluator.judged(one_period, samples)
    whole_information, total = experiment_information(evaluator, trajectory, configuration)
    periods = configuration.run.experiment.periods
    errors = predicted_errors(configuration, evaluator, trajectory, whole_information, total)
    predicted = result.PredictedStd(
        per_period=precision(evaluator, evaluator.judged(one_period), samples, 1),
        experiment=precision(evaluator, whole_information, total, periods),
        **tolerance_std(evaluator.names, errors),
    )
    robot, section = evaluator.robot, configuration.run.design
    steps = trajectory.period / plan.controller_period
    status, status_text = search_status(found.search)
    return result.DesignResult(
        **fourier_keys(trajectory),
        configuration=configuration,
        name=configuration.run.name,
        robot_name=robot.name,
        criterion=section.criterion,
        scaling=section.scaling,
        parameter_names=evaluator.names,
        controller_period=configuration.run.trajectory.controller_period,
        samples_per_period=whole(steps) or steps,
        samples=samples,
        log_det_information=evaluator.log_det(information),
        criterion_value=plan.evaluator.value(plan.evaluator.information(trajectory, samples)),
        predicted_std=predicted,
        status=status,
        status_text=status_text,
        solver=search_statistics(found.search, section.criterion),
        base_parameters=identified_combinations(
            configuration, evaluator, whole_information, errors
        ),
        derived=derived_precisions(configuration, evaluator, errors),
        hum=plan.hum.distances(trajectory.omega),
        warnings=(
            *configuration.warnings,
            *_warnings(configuration, trajectory, plan),
            *(() if section.others else imprecise(robot, predicted, errors)),
        ),
        motion=SampledMotion.of(robot, trajectory, trajectory.sample_times(round(steps))),
        checks=found.search.finish.check.limits,
        parameters=tuple(parameter_precisions(robot, predicted, errors)),
        iterations=tuple(search_iterations(found.search)),
        eigenvalues=tuple(scaled_eigenvalues(information, robot.scales[evaluator.columns])),
        information=information,
    )


def _refuse_unexcitable(plan: SearchPlan, noise: Evaluator) -> None:
    """Refuse parameters that random feasible motions hardly excite."""
    problem, best, found = plan.problem, 0.0, None
    for number in track("trial motions within the limits", range(_PROBES)):
        trajectory = probe_motion(plan, number)
        scaled = fisher.ScaledInformation.of(noise.information(trajectory, problem.cost.samples))
        values = scaled.eigenvalues()
        ratio = max(float(values[0] / values[-1]), 0.0) if values[-1] > 0 else 0.0
        if found is None or ratio > best:
            best, found = ratio, scaled
    if found is not None and best < _HOPELESS * fisher.EXCITABLE:
        raise fisher.SingularInformationError(found.weak_directions(noise.names))


def _blame_unexcited(plan: SearchPlan, noise: Evaluator, error: NoDesignError) -> None:
    """Raise `SingularInformationError` if all starts without a result are singular."""
    informations = [
        fisher.ScaledInformation.of(
            noise.information(
                plan.problem.variables.trajectory(start.variables), plan.problem.cost.samples
            )
        )
        for start in error.starts
        if np.all(np.isfinite(start.variables))
    ]
    if informations and all(scaled.is_singular() for scaled in informations):
        fewest = min((s.weak_directions(noise.names) for s in informations), key=len)
        raise fisher.SingularInformationError(fewest) from error


def _warnings(
    configuration: RunConfiguration, trajectory: FourierTrajectory, plan: SearchPlan
) -> tuple[str, ...]:
    """Return warnings about missing limits, the period and hums, in words."""
    missing = unlimited(plan.evaluator.robot, trajectory, trajectory.sample_times(POINTS))
    found = [text] if (text := unlimited_warning(missing)) else []
    steps = trajectory.period / plan.controller_period
    if whole(steps) is None:
        step = plan.controller_period
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
        "parameters, and no scatter between periods shows it. " + _hum_advice(configuration, plan)
        for one in plan.hum.distances(trajectory.omega)
        if not one.kept
    ]
    return tuple(found)


def _hum_advice(configuration: RunConfiguration, plan: SearchPlan) -> str:
    """Return the reason why the frequency is near a hum, and a remedy, in words."""
    if plan.hum.periods < _FEWEST_PERIODS:
        return f"Measure {_FEWEST_PERIODS} periods or more"
    low, high = configuration.run.trajectory.frequency
    if low == high:
        return "The frequency is fixed: choose another one"
    return (
        f"No whole number of controller steps within {100 * FARTHEST:g} % of the best period keeps "
        "away from every hum: measure more periods, or let the controller's step be shorter"
    )


def search_statistics(search: SearchResult, criterion: str) -> result.SearchStatistics:
    """Return the statistics of a search; values of the criterion have its own sign."""
    finish = search.finish
    phases = [phase for start in (*search.starts, finish) for phase in start.phases]
    evaluations: Counter[str] = Counter()
    for phase in phases:
        evaluations.update(phase.evaluations)
    sign = 1 if criteria()[criterion].larger_is_better else -1
    return result.SearchStatistics(
        name="dense interior point, then Ipopt through CasADi",
        iterations=sum(phase.iterations for phase in phases),
        evaluations=dict(evaluations),
        seconds=search.seconds,
        cpu_seconds=search.cpu_seconds,
        best_start=search.best.index,
        finish={
            "shrink": finish.shrink,
            "record": asdict(finish.phases[-1]) if finish.phases else None,
        },
        starts=tuple(
            result.StartSummary(
                index=start.index,
                kind=start.kind,
                criterion_value=sign * start.merit if start.usable else np.nan,
                finished_value=sign * search.merits.get(start.index, np.nan),
                iterations=start.iterations,
                converged=start.converged,
                status=start.status,
                best=start is search.best,
                seconds=start.seconds,
                stages=tuple(asdict(phase) for phase in start.phases),
            )
            for start in search.starts
        ),
        ended=search.ended,
    )


def search_iterations(search: SearchResult) -> Iterator[Iteration]:
    """Yield the iterations of every start; those of the finish follow the ones of its start."""
    for start in search.starts:
        yield from start.trace
        if start is search.best:
            for one in search.finish.trace:
                number = start.iterations + one.iteration
                yield replace(one, kind=start.kind, iteration=number)


def search_status(search: SearchResult) -> tuple[str, str]:
    """Return the status of a design and how its start and finish ended, in words.

    The status is ``"limits broken"``, ``"interrupted"``, ``"converged"`` or ``"not converged"``.
    """
    best, finish = search.best, search.finish
    end = status_text(finish.phases[-1].status) if finish.phases else "not solved again"
    text = f"start: {best.status}; finish: {end}" + (f"; {search.lost}" if search.lost else "")
    if not finish.check.passed:
        return "limits broken", text
    if search.interrupted:
        return "interrupted", text
    converged = best.converged and (finish.converged or not finish.phases)
    return "converged" if converged else "not converged", text
