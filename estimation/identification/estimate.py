"""The whole way from measurements to parameters."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from constraints.arrays import Array
from estimation.data.measurement import Measurement
from estimation.estimators import (
    Experiment,
    ParameterEstimate,
    ParameterPriors,
    add_prior_response,
    cramer_rao_covariance,
    linear_estimate,
    maximum_likelihood,
    systematic_share,
)
from estimation.identification.estimated_machine import (
    apply_calibration,
    estimated_machine,
    linearise_at_load,
    with_residual_noise,
)
from estimation.identification.recording import prepare_recording
from estimation.identification.result import EstimationResult, PreparedRecording, best_of
from estimation.identification.term_selection import Selection
from estimation.uncertainty.consistency import consistent_estimate
from estimation.uncertainty.intervals import identified_combinations, parameter_rows
from expdesign.configuration import ConfigurationLike, InputError, RunConfiguration, load_run
from expdesign.configuration.robot import RobotDescription
from expdesign.configuration.run import add_terms
from expdesign.progress import report_progress, track
from expdesign.robot import Robot, robot_from
from expdesign.robot.deviation import Deviation, toleranced_deviations
from expdesign.trajectory import FourierTrajectory


def estimate(
    config: ConfigurationLike,
    data: Measurement | Sequence[Measurement],
    design: FourierTrajectory | Sequence[FourierTrajectory | None] | None = None,
) -> EstimationResult:
    """Estimate the parameters from one or several recordings.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
        Its sections `estimate` and `noise` and its robot are used.
    data : Measurement or sequence of Measurement
        Recordings of different trajectories are combined in one estimate.
    design : FourierTrajectory or sequence, optional
        The trajectory of each recording (one for all of them, or one each); without it the period
        comes from the recording.

    Raises
    ------
    InputError
        The configuration, or a recording's period, does not fit.
    MotionFitError
        No motion has the measured lengths.
    UnidentifiableError
        The data do not determine some parameters at all; it names them.
    """
    configuration = load_run(config)
    began = time.perf_counter()
    recordings = (data,) if isinstance(data, Measurement) else tuple(data)
    if not recordings:
        raise ValueError("estimate needs at least one recording")
    robot = robot_from(configuration.robot)
    knowledge = parameter_priors(configuration, robot)
    wanted = configuration.run.estimate.estimators
    refuse_ml_without_fit(configuration, wanted, "estimate")
    designs = _one_each(design, len(recordings))
    # One thread: the products are small, and the order of their sums must not depend on cores.
    with threadpool_limits(limits=1, user_api="blas"):
        pairs = tuple(zip(recordings, designs, strict=True))
        records = tuple(
            prepare_recording(configuration, robot, recording, trajectory)
            for recording, trajectory in track("the motion of each recording", pairs)
        )
        selection = Selection.of(configuration, robot, [r.experiment for r in records])
        if selection is not None and selection.chosen:
            configuration = add_terms(configuration, selection.added)
            robot = robot_from(configuration.robot)
            knowledge = parameter_priors(configuration, robot)
            records = tuple(
                replace(r, experiment=r.experiment.with_terms_of(robot)) for r in records
            )
        records = _with_residual_noise(robot, records, knowledge)
        robot, experiments = linearise_at_load(robot, [r.experiment for r in records], knowledge)
        records = tuple(
            replace(record, experiment=experiment)
            for record, experiment in zip(records, experiments, strict=True)
        )
        report_progress("what is not known exactly")
        chosen = (
            toleranced_deviations(robot) if configuration.run.estimate.systematic != "none" else ()
        )
        joint = chosen if configuration.run.estimate.systematic == "estimated" else ()
        estimates = {
            name: add_systematic_uncertainty(found, knowledge, chosen)
            for name, found in run_estimators(robot, experiments, knowledge, wanted, joint).items()
        }
        bound = _bound(robot, experiments, knowledge, estimates)
        machine = estimated_machine(robot, best_of(estimates).systematic)
        if machine.chosen:
            # What follows sees the machine as it was found, along motions like those estimated.
            robot = machine.robot
            records = tuple(
                replace(
                    prepare_recording(
                        configuration.with_section("estimate", harmonics=motion.harmonics),
                        robot,
                        apply_calibration(recording, machine),
                        trajectory,
                    ),
                    least_harmonics=record.least_harmonics,
                )
                for record, recording, trajectory, motion in zip(
                    records, recordings, designs, best_of(estimates).motions, strict=True
                )
            )
            records = _with_residual_noise(robot, records, knowledge)
        report_progress("the nearest parameters that bodies have")
        consistent = {
            name: consistent_estimate(robot, found, knowledge) for name, found in estimates.items()
        }
        report_progress("what is identified")
        combinations = {
            name: identified_combinations(robot, knowledge.names, result.values, result.covariance)
            for name, result in estimates.items()
        }
    rows = [
        row for result in estimates.values() for row in parameter_rows(robot, result, knowledge)
    ]
    return EstimationResult(
        configuration=configuration,
        robot=robot,
        knowledge=knowledge,
        records=records,
        estimates=estimates,
        rows=tuple(rows),
        combinations=combinations,
        consistent=consistent,
        bound=bound,
        selection=selection,
        seconds=time.perf_counter() - began,
        warnings=(
            *configuration.warnings,
            *(warning for recording in recordings for warning in recording.warnings),
            *(() if selection is None else selection.warnings),
            *_warnings(records, knowledge, estimates),
            *(
                f"{name}: {_no_bodies(configuration)}"
                for name, found in consistent.items()
                if found is None
            ),
        ),
    )


def run_estimators(
    robot: Robot,
    experiments: Sequence[Experiment],
    knowledge: ParameterPriors,
    wanted: Sequence[str],
    deviations: Sequence[Deviation] = (),
) -> dict[str, ParameterEstimate]:
    """Return the estimates wanted, in the order ls, gm, ml.

    Maximum likelihood estimates the deviations given, too, with their tolerances as priors.
    """
    # Maximum likelihood begins from Gauss–Markov.
    needed = {*wanted, "gm"} if "ml" in wanted else wanted
    linear = [name for name in ("ls", "gm") if name in needed]
    results = {
        name: linear_estimate(robot, experiments, knowledge, name)
        for name in track("linear estimates", linear)
    }
    if "ml" in wanted:
        start = results["gm"]
        results["ml"] = maximum_likelihood(robot, experiments, knowledge, start, deviations)
    return {name: found for name, found in results.items() if name in wanted}


def add_systematic_uncertainty(
    estimate: ParameterEstimate, knowledge: ParameterPriors, tolerances: Sequence[Deviation]
) -> ParameterEstimate:
    """Return an estimate with what the tolerances given, and those of its prior, do to it.

    It is returned as it is after pointwise kinematics, where what they do is not known. What it
    has estimated of them is counted already.
    """
    found = estimate.systematic
    own = () if found is None else found.deviations
    known = {one.name for one in own}
    others = [one for one in tolerances if one.name not in known]
    if others:
        chosen, values = (*own, *others), None
        if found is not None:
            values = np.concatenate([found.values, np.zeros(len(others))])
        found = systematic_share(estimate.influences, chosen, knowledge.free, values)
    if knowledge.prior_estimate is not None:
        found = add_prior_response(
            found, estimate.influences, knowledge.prior_estimate, knowledge.free
        )
    return estimate.with_systematic(found)


def _with_residual_noise(
    robot: Robot, records: tuple[PreparedRecording, ...], knowledge: ParameterPriors
) -> tuple[PreparedRecording, ...]:
    """Take Σ that nobody knows from residuals of Gauss–Markov estimates."""
    present = with_residual_noise(robot, [record.experiment for record in records], knowledge)
    return tuple(replace(r, experiment=e) for r, e in zip(records, present, strict=True))


def _bound(
    robot: Robot,
    experiments: Sequence[Experiment],
    knowledge: ParameterPriors,
    estimates: Mapping[str, ParameterEstimate],
) -> Array | None:
    if "ml" in estimates:
        return estimates["ml"].covariance_random
    if any(experiment.fit is None for experiment in experiments):
        return None
    motions = [experiment.motion for experiment in experiments]
    last = list(estimates.values())[-1]
    robot, values = estimated_machine(robot, last.systematic).robot, last.values
    return cramer_rao_covariance(robot, experiments, motions, knowledge, values)


def parameter_priors(configuration: RunConfiguration, robot: Robot) -> ParameterPriors:
    """Return what the run's `estimate:` section says of the robot's parameters.

    Raises
    ------
    InputError
        It fixes all of them.
    """
    knowledge = ParameterPriors.of(robot, configuration.run.estimate)
    if not np.any(knowledge.free):
        raise InputError(
            "every parameter is fixed: there is nothing to estimate",
            file=configuration.file,
            key="estimate.fixed",
        )
    return knowledge


def refuse_ml_without_fit(
    configuration: RunConfiguration, estimators: Sequence[str], section: str
) -> None:
    """Refuse maximum likelihood with a differentiation that gives no Fourier series.

    Raises
    ------
    InputError
        The estimators of the section, ``"estimate"`` or ``"montecarlo"``, have it.
    """
    differentiation = configuration.run.estimate.differentiation
    if "ml" in estimators and differentiation != "fourier":
        raise InputError(
            "maximum likelihood estimates the motion as a Fourier series, "
            f"'{differentiation}' differentiation gives it none",
            file=configuration.file,
            key=f"{section}.estimators",
            allowed="[ls, gm], or estimate.differentiation: fourier",
        )


def _one_each(
    design: FourierTrajectory | Sequence[FourierTrajectory | None] | None, count: int
) -> list[FourierTrajectory | None]:
    if design is None or isinstance(design, FourierTrajectory):
        return [design] * count
    designs = list(design)
    if len(designs) == 1:
        return designs * count
    if len(designs) != count:
        raise ValueError(f"{count} recordings, but {len(designs)} designs")
    return designs


def _no_bodies(configuration: RunConfiguration) -> str:
    """Say that no parameters of bodies were found, and what of the run can be why."""
    section = configuration.run.estimate
    causes = {
        "that are fixed (`estimate.fixed`)": bool(section.fixed),
        "within the bounds (`estimate.bounds`)": bool(section.bounds),
        "that the earlier identification held (`estimate.prior`)": isinstance(
            section.prior, RobotDescription
        ),
    }
    told = [cause for cause, there in causes.items() if there]
    if told:
        return f"no bodies have the values {' and '.join(told)}, whatever the other parameters are"
    return (
        "no parameters that bodies have were found near the estimate: the search did not converge, "
        "and whether the estimate is physically consistent is not known"
    )


def _warnings(
    records: Sequence[PreparedRecording],
    knowledge: ParameterPriors,
    estimates: Mapping[str, ParameterEstimate],
) -> list[str]:
    found = []
    for record in records:
        where = f"{record.source}: " if record.source and len(records) > 1 else ""
        dropped = record.experiment.record.dropped
        if dropped:
            found.append(f"{where}{dropped} rows of incomplete periods were left out")
        noise = record.experiment.noise
        found += [
            f"{where}too few periods to see the noise, and none is given: {source}. Record three "
            "periods or more"
            for own, source in (
                (noise.forces, "Σ comes from the residuals and includes the model's error"),
                (noise.lengths, "Δ comes from what the fitted motion leaves of the lengths"),
            )
            if own.includes_model_error
        ]
        found += [where + warning for warning in record.warnings]
        if record.harmonics_of_forces != record.harmonics:
            found.append(
                f"{where}the forces show {record.harmonics_of_forces} harmonics of the motion, the "
                f"lengths alone {record.harmonics}: LS and GM know only these, and their intervals "
                "are too narrow. Take ML, which counts all"
            )
        if record.experiment.fit is None:
            found.append(
                f"{where}pointwise differentiation: the errors of rates and accelerations are in "
                "the regressor, estimates are biased and the intervals do not cover"
            )
    for name, result in estimates.items():
        if not result.converged:
            found.append(f"{name}: {result.status}")
        found += [
            f"{name}: {knowledge.names[k]} stands at its bound (`estimate.bounds`), which its "
            "standard deviation does not count"
            for k in np.flatnonzero(knowledge.at_bound(result.values))
        ]
    return found
