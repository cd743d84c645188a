"""The design problem and the search plan of a run, from its configuration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from constraints.arrays import Array
from expdesign.configuration import InputError, RunConfiguration
from expdesign.configuration.consistency import identification_of
from expdesign.configuration.loading import smoothing_widths
from expdesign.configuration.noise import NOISE_FROM_DATA
from expdesign.information import fisher
from expdesign.information.criteria import criteria
from expdesign.noise import Hum
from expdesign.problem.design_problem import build_problem
from expdesign.recheck.excitable import structural_base
from expdesign.recheck.information import Evaluator
from expdesign.robot import Robot, robot_from
from expdesign.solver.feasibility import InfeasibleLimitsError, random_start
from expdesign.solver.phases import coarse_points
from expdesign.solver.starts import SearchPlan
from expdesign.trajectory import FourierTrajectory, KnownHum

_PROBE_ATTEMPTS = 8


def plan_search(configuration: RunConfiguration) -> SearchPlan:
    """Return the problem and the plan of a run's search; every worker process builds it once.

    Examples
    --------
    >>> from expdesign import load_run
    >>> plan = plan_search(load_run("palida-quick"))
    >>> plan.starts, plan.problem.variables.size
    (1, 31)
    """
    run = configuration.run
    robot = robot_from(configuration.robot)
    names = judged_parameters(configuration, robot)
    scaling = robot.scales if run.design.scaling == "nominal" else np.ones(len(robot.scales))
    criterion = criteria()[run.design.criterion]
    covariance, memory = force_noise(configuration)
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
    problem = replace(problem, cost=replace(problem.cost, memory=memory))
    problem = problem.with_prior(prior, scaling).with_variables(rest=run.design.start == "rest")
    plan = SearchPlan(
        problem=problem,
        evaluator=Evaluator(robot, covariance, criterion, scaling, names, memory, prior),
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
    # log det F does not depend on the scaling, but the accuracy of its eigenvalues does: F of a
    # random motion gets a unit diagonal.
    information = plan.evaluator.whole_information(probe_motion(plan, 0), problem.cost.samples)
    sizes = np.sqrt(np.diag(information) / problem.cost.samples)
    even = replace(problem, even_scaling=1 / np.where(sizes > 0, sizes, 1.0))
    return replace(plan, problem=even.with_criterion(criterion))


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


def prior_machine(
    configuration: RunConfiguration, robot: Robot, names: tuple[str, ...]
) -> fisher.PriorMachine | None:
    """Return the prior knowledge of the robot by `design.prior`; None without one.

    The number of samples is that at the highest allowed frequency: motions are compared for the
    same measuring time.
    """
    machine = configuration.run.design.prior
    if machine is None:
        return None
    changed = np.array([robot.parameter_names.index(name) for name in names], dtype=np.intp)
    experiment = configuration.run.experiment
    samples = experiment.periods * experiment.sampling / configuration.run.trajectory.frequency[1]
    return fisher.PriorMachine.of(identification_of(machine), changed, samples)


def force_noise(configuration: RunConfiguration) -> tuple[Array, fisher.PeriodicNoise | None]:
    """Return Σ of the forces, (6, 6), N², and their coloured noise in the experiment; None: white.

    Raises
    ------
    InputError
        The run states no noise of the forces.
    """
    noise, experiment = configuration.robot.noise, configuration.run.experiment
    if noise is None or noise.force_covariance is None:
        raise InputError(
            "the design needs the noise of the forces, and neither robot nor run state it",
            file=configuration.file,
            key="noise",
            allowed=f"force_std (six values) or force_covariance (6 × 6); {NOISE_FROM_DATA}",
        )
    spectrum = noise.force_spectrum
    if spectrum is None:
        return noise.force_covariance, None
    memory = fisher.PeriodicNoise(spectrum, experiment.sampling, experiment.periods)
    return noise.force_covariance, memory


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


def judged_parameters(configuration: RunConfiguration, robot: Robot) -> tuple[str, ...]:
    """Return the parameters that the criterion judges, in the order of the regressor."""
    if configuration.run.design.parameters == "base":
        return structural_base(robot).base
    wanted = configuration.run.design.named_parameters
    return tuple(name for name in robot.parameter_names if wanted is None or name in wanted)
