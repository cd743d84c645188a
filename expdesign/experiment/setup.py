"""The design problem and the search plan of a run, from its configuration."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import RunConfiguration
from expdesign.configuration.loading import smoothing_widths
from expdesign.evaluation.machine_code import is_usable
from expdesign.experiment.judging import judge, noise_evaluator
from expdesign.noise import Hum
from expdesign.problem.design_problem import build_problem
from expdesign.progress import listen_to_progress, report_progress
from expdesign.recheck.certificate import recheck
from expdesign.solver.feasibility import InfeasibleLimitsError, random_start
from expdesign.solver.phases import coarse_points
from expdesign.solver.starts import SearchPlan, StartResult, run_start
from expdesign.trajectory import FourierTrajectory, KnownHum, TrajectoryFile
from expdesign.workers import Job, Monitor, run_jobs

_PROBE_ATTEMPTS = 8


def plan_search(
    configuration: RunConfiguration, others: Sequence[FourierTrajectory] | None = None
) -> SearchPlan:
    """Return the problem and the plan of a run's search; every worker process builds it once.

    The `others` of the experiment's motions are by default those of `design.others`.

    Examples
    --------
    >>> from expdesign import load_run
    >>> plan = plan_search(load_run("palida-quick"))
    >>> plan.starts, plan.problem.variables.size
    (1, 31)
    """
    run = configuration.run
    noise = noise_evaluator(configuration)
    problem = build_problem(
        noise.robot,
        harmonics=run.trajectory.harmonics,
        frequency=run.trajectory.frequency,
        samples=run.trajectory.samples,
        covariance=noise.covariance,
        criterion=noise.criterion,
        scaling=noise.scaling,
        names=noise.names,
    )
    problem = replace(problem, cost=replace(problem.cost, memory=noise.memory))
    problem = problem.with_variables(rest=run.design.start == "rest")
    if others is None:
        others = [TrajectoryFile.read(Path(file)).trajectory for file in run.design.others]
    problem, evaluator = judge(configuration, problem, noise, others)
    plan = SearchPlan(
        problem=problem,
        evaluator=evaluator,
        starts=run.design.starts,
        hops=run.design.hops if run.design.search == "hopping" else 0,
        weighs_gain=run.design.weighs_gain,
        seed=run.design.seed,
        widths=run.design.smoothing or smoothing_widths(configuration.robot),
        iterations=run.design.max_iterations,
        controller_period=run.controller_period,
        hum=known_hum(configuration),
        workers=run.workers or 1,
        scheduler=run.scheduler,
        max_seconds=run.design.max_seconds,
    )
    # log det F does not depend on the scaling, but the accuracy of its eigenvalues does: F of a
    # random motion gets a unit diagonal.
    probe = probe_motion(plan, 0)
    if evaluator.deviating:
        # The search has other unknowns: components of gravity, for example, instead of tilts.
        scales = problem.cost.scaling
        found = problem.cost.information(problem.variables.pack(probe), plan.widths[-1])
        information = found / np.multiply.outer(scales, scales) * problem.cost.samples
    else:
        information = evaluator.whole_information(probe, problem.cost.samples)
    even = judged = _even_scales(information, problem.cost.samples)
    marginal = problem.cost.marginal
    if marginal is not None:
        own = marginal.interest.T @ information @ marginal.interest
        judged = _even_scales(own, problem.cost.samples)
    problem = replace(problem, even_scaling=(even, judged))
    return replace(plan, problem=problem.with_criterion(evaluator.criterion))


def _even_scales(information: Array, samples: int) -> Array:
    """Return the scales in which F over so many samples has a unit diagonal per sample."""
    sizes = np.sqrt(np.diag(information) / samples)
    return np.asarray(1 / np.where(sizes > 0, sizes, 1.0))


def probe_motion(plan: SearchPlan, number: int) -> FourierTrajectory:
    """Return a random feasible motion that no start of the search uses."""
    problem = plan.problem
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


def ready_plan(
    configuration: RunConfiguration, others: Sequence[FourierTrajectory] | None = None
) -> SearchPlan:
    """Return the plan of `plan_search`; all code that is cached is loaded.

    Worker processes are copies of one that has called this: none of them loads it again.
    """
    plan = plan_search(configuration, others)
    if is_usable() and all(kernel.load() for kernel in plan.problem.kernels):
        report_progress("loading the compiled model")
        # The proof of a trial motion is no step of the design.
        with listen_to_progress(lambda *_: None):
            _run_proof(plan, Monitor())
            _run_solver(plan, Monitor())
    return plan


def compile_search(build: Callable[[], SearchPlan], plan: SearchPlan, monitor: Monitor) -> None:
    """Compile in worker processes, side by side, all code of a search, unless it is cached.

    The model's functions are compiled by LLVM, the loops of the solver and of the proof by Numba.
    Without usable machine code CasADi's virtual machine evaluates the model: nothing is compiled.
    """
    if not is_usable():
        return
    kernels = plan.problem.kernels
    missing = [number for number, kernel in enumerate(kernels) if not kernel.load()]
    if not missing:
        return
    what = "compiling the model for this processor, once"
    # The longest ones first.
    jobs = [Job(_run_proof, ()), *(Job(_compile_kernel, (number,)) for number in missing)]
    jobs.append(Job(_run_solver, ()))
    report_progress(what, 0, len(jobs))
    quiet = Monitor(monitor.stop_requested)
    for done, _ in enumerate(run_jobs(build, jobs, plan.workers, quiet), start=1):
        report_progress(what, done, len(jobs))
    plan.problem.compile()


def _compile_kernel(plan: SearchPlan, _monitor: Monitor, number: int) -> None:
    plan.problem.kernels[number].compile()


def _run_proof(plan: SearchPlan, _monitor: Monitor) -> None:
    recheck(plan.problem.limits, probe_motion(plan, 0))


def _run_solver(plan: SearchPlan, _monitor: Monitor) -> None:
    start = StartResult(1, "random", np.empty(0))
    run_start(replace(plan, iterations=1), Monitor(), start, until=1)


def known_hum(configuration: RunConfiguration) -> KnownHum:
    """Return the hums in the run's noise, of forces or lengths, and the number of periods."""
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
