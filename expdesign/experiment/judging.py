"""Quantities that a design is judged by: interest, nuisances, deviations within the tolerances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.linalg as sla

from constraints.arrays import Array
from expdesign.configuration import InputError, RunConfiguration
from expdesign.configuration.consistency import identification_of, refuse_missing_task
from expdesign.configuration.design import TaskSection
from expdesign.configuration.noise import NOISE_FROM_DATA
from expdesign.information import fisher
from expdesign.information.criteria import criteria
from expdesign.information.fisher import information_matrix
from expdesign.information.identifiable import DEPENDENT, listed, root_of
from expdesign.information.marginal import Marginal, earlier_information
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.motion.benchmark import motion_of_run
from expdesign.problem.design_problem import DesignProblem
from expdesign.recheck.evaluator import Evaluator
from expdesign.recheck.excitable import structural_base
from expdesign.robot import Robot, robot_from
from expdesign.robot.derived import derived_quantities
from expdesign.robot.deviation import Deviation, toleranced_deviations
from expdesign.robot.fixed_lengths import group_effects
from expdesign.trajectory import FourierTrajectory, TrajectoryFile

_TASK_SAMPLES = 400


def noise_evaluator(configuration: RunConfiguration) -> Evaluator:
    """Return the evaluation of the unknown parameters by the noise alone.

    For the change since a prior they are those that have changed; otherwise the information of
    earlier recordings adds.
    """
    design, robot = configuration.run.design, recorded_robot(configuration)
    names = unknown_parameters(configuration, robot)
    covariance, memory = force_noise(configuration)
    marginal, samples = None, count_experiment_samples(configuration)
    if design.is_change:
        changed = np.array([robot.parameter_names.index(name) for name in names], dtype=np.intp)
        marginal = Marginal.of_change(identification_of(design.priors[0]), changed, samples)
    elif design.prior is not None:
        earlier = earlier_recordings(configuration, names, ())
        marginal = replace(Marginal.of_all(len(names), samples), earlier=earlier)
    return Evaluator(
        robot,
        covariance,
        criteria()[design.criterion],
        robot.scales if design.scaling == "nominal" else np.ones(len(robot.scales)),
        names,
        memory,
        marginal,
        unknown=None if design.is_change else names,
    )


def recorded_robot(configuration: RunConfiguration) -> Robot:
    """Return the robot; its forces are those of voltages if the run's recordings contain these."""
    voltages = configuration.records_voltages
    return robot_from(replace(configuration.robot, forces_of_voltages=voltages))


def unknown_parameters(configuration: RunConfiguration, robot: Robot) -> tuple[str, ...]:
    """Return the unknown parameters in the order of the regressor; the others are held."""
    if configuration.run.design.parameters == "base":
        return structural_base(robot).base
    design = configuration.run.design
    wanted = design.named_parameters or robot.parameter_names
    return tuple(
        name for name in robot.parameter_names if name in wanted and name not in design.known
    )


def judge(
    configuration: RunConfiguration,
    problem: DesignProblem,
    noise: Evaluator,
    others: Sequence[FourierTrajectory] = (),
) -> tuple[DesignProblem, Evaluator]:
    """Return problem and evaluation of the quantities that the criterion judges.

    With `design.counts` ``total`` the deviations within the robot's tolerances are nuisances, as
    the run's estimator treats them. Without any, the evaluation is that of the noise. The
    information of the experiment's other motions is added.
    """
    robot = noise.robot
    unknown = noise.unknown or robot.parameter_names
    columns = np.array([robot.parameter_names.index(name) for name in unknown], dtype=np.intp)
    chosen = counted_deviations(configuration, robot)
    section, samples = configuration.run.design, count_experiment_samples(configuration)
    if noise.marginal is None and section.interest is None and not chosen and not others:
        return problem, noise
    if section.interest is None:
        marginal = noise.marginal or Marginal.of_all(len(unknown), samples)
        names = noise.names
        judged = noise.scaling[[robot.parameter_names.index(name) for name in names]]
    else:
        names, slopes = _interest(configuration, robot)
        slopes, sizes = slopes[:, columns], robot.scales[columns]
        if section.scaling == "nominal" and isinstance(section.interest, tuple):
            judged = np.linalg.norm(slopes * sizes, axis=1)
        else:
            judged = np.ones(len(names))
        directions, shares, _ = np.linalg.svd(slopes / judged[:, None] * sizes)
        rank = int(np.sum(shares > DEPENDENT * shares[0]))
        if not rank or not np.all(judged > 0):
            raise _refusal(configuration, "known parameters determine a quantity of interest")
        if rank < len(names):
            # Some follow from others: as many combinations, with the same sum of variances.
            slopes = directions[:, :rank].T @ (slopes / judged[:, None])
            names, judged = tuple(f"combination {k + 1}" for k in range(rank)), np.ones(rank)
        marginal = Marginal.of_quantities(slopes, sizes, samples)
    scaling, searched = noise.scaling[columns], marginal
    if chosen:
        estimated = configuration.run.estimate.estimates_tolerances
        keys = dict.fromkeys([one.key for one in chosen])
        own = np.diag([one.tolerance for one in chosen])
        effects = group_effects(robot, chosen)
        scaling = np.concatenate([scaling, np.ones(len(effects))])
        marginal, searched = (
            marginal.with_effects(each, tuple(keys), estimated=estimated) for each in (own, effects)
        )
    evaluator = replace(
        noise,
        names=names,
        marginal=marginal,
        unknown=unknown,
        deviating=chosen,
        judged_scales=judged,
    )
    earlier = None if section.is_change else earlier_recordings(configuration, unknown, chosen)
    if others:
        count = problem.cost.samples
        every = [evaluator.whole_information(one, count) for one in others]
        found = np.sum(every, axis=0) * (samples / count)
        earlier = found if earlier is None else earlier + found
    if earlier is not None:
        to_unknowns = _to_deviations(robot, chosen, len(unknown))
        evaluator = replace(evaluator, marginal=replace(marginal, earlier=earlier))
        searched = replace(searched, earlier=to_unknowns.T @ earlier @ to_unknowns)
    return problem.with_marginal(searched, scaling, judged, columns, chosen), evaluator


def _to_deviations(robot: Robot, chosen: Sequence[Deviation], parameters: int) -> Array:
    """Return the matrix from a search's unknowns to parameters and deviations, SI."""
    if not chosen:
        return np.eye(parameters)
    tolerances = np.array([one.tolerance for one in chosen])
    inverse = tolerances[:, None] * np.linalg.pinv(group_effects(robot, chosen))
    return sla.block_diag(np.eye(parameters), inverse)


def earlier_recordings(
    configuration: RunConfiguration, names: Sequence[str], chosen: Sequence[Deviation]
) -> Array | None:
    """Return the information of earlier recordings, (k + n, k + n), SI, or None without any.

    Raises
    ------
    InputError
        An earlier estimate did not contain some of them.
    """
    total, deviating = None, [one.name for one in chosen]
    for machine in configuration.run.design.priors:
        known = identification_of(machine)
        variance = zip(known.parameters, np.diag(known.covariance_random), strict=False)
        held = {name for name, value in variance if not value > 0}.intersection(names)
        if missing := [*held, *({*deviating} - {one.name for one in known.deviations})]:
            raise InputError(
                f"the estimate of the run {known.run} does not contain {listed(sorted(missing))}",
                file=configuration.file,
                key="design.prior",
                allowed="an estimate of the same parameters with the same tolerances; parameters "
                "that it held can be `design.known`",
            )
        found = earlier_information(known, names, deviating)
        total = found if total is None else total + found
    return total


def _interest(configuration: RunConfiguration, robot: Robot) -> tuple[tuple[str, ...], Array]:
    """Return names of the quantities of interest and their derivatives to the parameters, (k, m).

    Of a task they are combinations of the parameters: the sum of their variances is the variance
    of the predicted forces, averaged over the motion and summed over the actuators.
    """
    interest, every = configuration.run.design.interest, robot.parameter_names
    if isinstance(interest, TaskSection):
        refuse_missing_task(configuration.run, configuration.file)
        if interest.task.file is not None:
            motion = TrajectoryFile.read(Path(interest.task.file)).trajectory
        else:
            motion = motion_of_run(configuration, interest.task, robot.home, "design.interest.task")
        samples = motion.sample(motion.sample_times(_TASK_SAMPLES))
        regressors = robot.regressor(*samples) / np.sqrt(_TASK_SAMPLES)
        root = root_of(information_matrix(regressors, np.eye(ACTUATORS)))
        return every, root
    derived = derived_quantities(robot)
    names, rows = list[str](), list[Array]()
    for name in interest or ():
        if name in every:
            names.append(name)
            rows.append(np.eye(len(every))[every.index(name)])
            continue
        own = [k for k, one in enumerate(derived.quantities) if one.group == name]
        if not own:
            raise _refusal(configuration, f"the terms of {robot.name} do not determine the {name}")
        names += [derived.names[k] for k in own]
        rows += [derived.jacobian[k] for k in own]
    return tuple(names), np.array(rows)


def _refusal(configuration: RunConfiguration, message: str) -> InputError:
    allowed = "names of parameters or of other derived quantities"
    return InputError(message, file=configuration.file, key="design.interest", allowed=allowed)


def counted_deviations(configuration: RunConfiguration, robot: Robot) -> tuple[Deviation, ...]:
    """Return the deviations whose share of the errors the criterion counts."""
    run = configuration.run
    if run.design.counts == "noise" or run.estimate.systematic == "none":
        return ()
    return inexact_deviations(configuration, robot)


def inexact_deviations(configuration: RunConfiguration, robot: Robot) -> tuple[Deviation, ...]:
    """Return the robot's deviations with tolerances as they were before any recording.

    The tolerances of an identified robot contain what its recordings showed. As a prior these add
    their information, and the tolerances are those that its identification states.
    """
    design, stated = configuration.run.design, dict[str, float]()
    for machine in () if design.is_change else design.priors:
        own = reversed(identification_of(machine).deviations)
        for name, tolerance in {one.name: one.tolerance for one in own}.items():
            # A later estimate may begin with the tolerances that an earlier one left.
            stated[name] = max(tolerance, stated.get(name, 0.0))
    return tuple(
        replace(one, tolerance=stated.get(one.name, one.tolerance))
        for one in toleranced_deviations(robot)
    )


def criterion_symbol(configuration: RunConfiguration) -> str:
    """Return the symbol of the matrix in the criterion: ``F``, or ``S`` with nuisances."""
    design = configuration.run.design
    nuisances = counted_deviations(configuration, recorded_robot(configuration))
    return "S" if nuisances or design.interest is not None else design.information


def nuisances_in_words(configuration: RunConfiguration) -> str:
    """Return the meaning of S where the criterion counts nuisances; empty without any."""
    design, parts = configuration.run.design, list[str]()
    if design.others:
        parts.append(f"for {1 + len(design.others)} recordings of a period, of design.others too")
    if design.interest is not None:
        parts.append("S is the information on design.interest, other parameters being unknown")
    if design.prior is not None and not design.is_change:
        runs = listed([identification_of(machine).run for machine in design.priors])
        parts.append(f"S includes the recordings of {runs}")
    if counted_deviations(configuration, recorded_robot(configuration)):
        verb = "estimated" if configuration.run.estimate.estimates_tolerances else "budgeted"
        parts.append(f"the tolerances count as {verb}")
    return "; ".join(parts)


def count_experiment_samples(configuration: RunConfiguration) -> float:
    """Return the number of samples of the experiment, by which data and priors are weighed.

    It is that of the highest frequency: motions are compared for the same measuring time.
    """
    experiment = configuration.run.experiment
    return experiment.periods * experiment.sampling / configuration.run.trajectory.frequency[1]


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
