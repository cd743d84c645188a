"""Estimation of the parameters: recordings made ready, estimators, uncertainty, consistency."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import combinations

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from constraints.arrays import Array
from estimation.channels.check import ChannelCheck
from estimation.channels.lag import slow_low_pass_warning
from estimation.data.measurement import Measurement, add_motors
from estimation.estimators import (
    Experiment,
    ParameterEstimate,
    ParameterPriors,
    PerturbedMachine,
    add_prior_response,
    cramer_rao_covariance,
    linear_estimate,
    maximum_likelihood,
    systematic_share,
)
from estimation.estimators.covariance import EstimatedDeviation
from estimation.estimators.prior_estimate import UnloadedMachine
from estimation.estimators.result import PayloadEstimate, payload_estimate
from estimation.identification.calibration import apply_calibration, estimated_machine
from estimation.identification.harmonics import weigh_signs, with_raised_harmonics
from estimation.identification.periods import UnsuitableDataError, leave_out_ramps, with_clock
from estimation.identification.recording import (
    PreparedRecording,
    check_recording,
    fold_measurement,
    linearise_at_load,
    prepare_recording,
    with_residual_noise,
)
from estimation.identification.term_selection import Selection
from estimation.measurement_model import HarmonicMotion, Motion, SplineMotion
from estimation.processing import PeriodSource
from estimation.uncertainty.consistency import ConsistentEstimate, consistent_estimate
from estimation.uncertainty.intervals import (
    ParameterRow,
    difference_test,
    parameter_rows,
)
from expdesign.configuration import ConfigurationLike, InputError, RunConfiguration, load_run
from expdesign.configuration.estimate import EstimateSection, name_in_run_file
from expdesign.configuration.robot import RobotDescription
from expdesign.configuration.run import add_terms
from expdesign.configuration.tolerances import Identification
from expdesign.progress import report_progress, track
from expdesign.robot import Robot, robot_from
from expdesign.robot.deviation import Deviation, low_passes, toleranced_deviations
from expdesign.trajectory import FourierTrajectory


def estimate_parameters(
    config: ConfigurationLike,
    data: Measurement | Sequence[Measurement],
    design: FourierTrajectory | Sequence[FourierTrajectory | None] | None = None,
    *,
    refuse_channels: bool = False,
) -> Estimation:
    """Estimate the parameters from one or several recordings, without a diagnosis.

    Parameters, exceptions: see `estimation.identification.estimate`.
    """
    configuration = load_run(config)
    began = time.perf_counter()
    data = (data,) if isinstance(data, Measurement) else tuple(data)
    _refuse_none_or_repeated(data, prior_identification(configuration))
    configuration = add_motors(configuration, data)
    section = configuration.run.estimate
    robot = robot_from(configuration.robot)
    priors = parameter_priors(configuration, robot)
    refuse_ml_without_fit(configuration, section.estimators, "estimate")
    designs = _match_designs(design, len(data))
    # One thread: the products are small, and the order of their sums must not depend on cores.
    with threadpool_limits(limits=1, user_api="blas"):
        data = tuple(map(partial(leave_out_ramps, configuration), data, designs))
        pairs = tuple(zip(data, designs, strict=True))
        folded = [fold_measurement(configuration, *pair) for pair in pairs]
        channels = tuple(
            check_recording(configuration, robot, parts, plan, has_units=measurement.has_units)
            for parts, (measurement, plan) in zip(folded, pairs, strict=True)
        )
        if refuse_channels:
            for check, pair in zip(channels, pairs, strict=True):
                _refuse_channels(configuration, robot, check, *pair)
        recordings = tuple(
            prepare_recording(configuration, robot, *pair, folded=parts)
            for pair, parts in zip(
                track("the motion of each recording", pairs), folded, strict=True
            )
        )
        _refuse_selection(section, data, recordings)
        experiments: Sequence[Experiment] = [each.experiment for each in recordings]
        selection = Selection.of(configuration, robot, experiments)
        if selection is not None and selection.chosen:
            configuration = add_terms(configuration, selection.added)
            robot = robot_from(configuration.robot)
            priors = parameter_priors(configuration, robot)
            experiments = [
                weigh_signs(robot, each.with_terms_of(robot), priors) for each in experiments
            ]
        experiments = with_residual_noise(robot, experiments, priors, section.spectrum)
        robot, experiments = linearise_at_load(robot, experiments, priors)
        report_progress("deviations of the machine")
        chosen = toleranced_deviations(robot) if section.systematic != "none" else ()
        joint = chosen if section.systematic in ("auto", "estimated") else ()
        estimates = {
            name: add_systematic_uncertainty(found, priors, chosen)
            for name, found in run_estimators(
                robot, experiments, priors, section.estimators, joint
            ).items()
        }
        estimated_recordings = recordings = _with_experiments(recordings, experiments)
        bound = _bound(robot, experiments, priors, estimates)
        best = best_of(estimates)
        of_tolerances = _tolerance_warnings(robot, experiments, priors, best, section)
        machine = estimated_machine(robot, best.systematic)
        estimates, priors = _with_true_damping(machine, estimates, priors)
        if machine.chosen:
            # Diagnoses take the machine as estimated, along the estimated motions.
            robot, parts = machine.robot, zip(recordings, pairs, best.motions, strict=True)
            recordings = tuple(_prepare_estimated(configuration, machine, *each) for each in parts)
            experiments = [each.experiment for each in recordings]
            experiments = with_residual_noise(robot, experiments, priors, section.spectrum)
        elif machine.robot.delay_std:
            robot = machine.robot
            experiments = [each.with_terms_of(robot) for each in experiments]
        recordings = _with_experiments(recordings, experiments)
        report_progress("the nearest physically consistent parameters")
        consistent = {
            name: consistent_estimate(robot, found, priors) for name, found in estimates.items()
        }
    return Estimation(
        configuration=configuration,
        robot=robot,
        priors=priors,
        recordings=recordings,
        estimates=estimates,
        rows=tuple(
            row for found in estimates.values() for row in parameter_rows(robot, found, priors)
        ),
        consistent=consistent,
        bound=bound,
        selection=selection,
        channels=channels,
        fingerprints=tuple(measurement.fingerprint for measurement in data),
        seconds=time.perf_counter() - began,
        warnings=(
            *configuration.warnings,
            *(warning for measurement in data for warning in measurement.warnings),
            *(() if selection is None else selection.warnings),
            *_warnings(estimated_recordings, channels, priors, estimates),
            *of_tolerances,
            *_low_pass_warnings(robot_from(configuration.robot), recordings, best),
            *(
                f"{name}: {_inconsistency(configuration)}"
                for name, found in consistent.items()
                if found is None
            ),
        ),
    )


def _with_experiments(
    recordings: Sequence[PreparedRecording], experiments: Sequence[Experiment]
) -> tuple[PreparedRecording, ...]:
    pairs = zip(recordings, experiments, strict=True)
    return tuple(replace(recording, experiment=own) for recording, own in pairs)


def _prepare_estimated(
    configuration: RunConfiguration,
    machine: PerturbedMachine,
    before: PreparedRecording,
    pair: tuple[Measurement, FourierTrajectory | None],
    motion: Motion,
) -> PreparedRecording:
    """Prepare a recording for the machine as estimated, along its estimated motion."""
    data = apply_calibration(configuration, *pair, machine)
    found = prepare_recording(configuration, machine.robot, data, pair[1], estimated=motion)
    return replace(found, fewest_harmonics=before.fewest_harmonics)


@dataclass(frozen=True, eq=False)
class Estimation:
    """Estimates in memory, with the robot, the experiments and the priors behind them."""

    configuration: RunConfiguration
    """The run, its robot with the terms that were added."""
    robot: Robot
    priors: ParameterPriors
    recordings: tuple[PreparedRecording, ...]
    estimates: dict[str, ParameterEstimate]
    rows: tuple[ParameterRow, ...]
    consistent: dict[str, ConsistentEstimate | None]
    """The nearest physically consistent parameters, by estimator; None: fixed values or bounds
    exclude them."""
    bound: Array | None
    """(m, m) Cramér–Rao bound as a covariance, at the best estimate."""
    seconds: float
    warnings: tuple[str, ...]
    selection: Selection | None = None
    """The choice of further terms; None: none was tried."""
    channels: tuple[ChannelCheck, ...] = ()
    """The check of the channels of each recording."""
    fingerprints: tuple[str, ...] = ()
    """Fingerprint of each recording."""

    @property
    def prior_recordings(self) -> tuple[str, ...]:
        """Fingerprints of the recordings in the prior estimate."""
        prior = prior_identification(self.configuration)
        return () if prior is None else prior.recordings

    @property
    def best(self) -> ParameterEstimate:
        """The estimate to use: ML if there is one, else GM, else LS."""
        return best_of(self.estimates)

    @cached_property
    def payloads(self) -> dict[str, PayloadEstimate]:
        """The payload by every estimator; empty unless the prior is of a machine without it."""
        before = self.priors.prior_estimate
        if not isinstance(before, UnloadedMachine):
            return {}
        return {name: payload_estimate(found, before) for name, found in self.estimates.items()}

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """The recordings as the estimators saw them."""
        return tuple(recording.experiment for recording in self.recordings)

    @property
    def pointwise(self) -> bool:
        """Whether a motion was differentiated pointwise: intervals lack the noise of lengths."""
        return any(recording.experiment.fit is None for recording in self.recordings)

    def __getitem__(self, estimator: str) -> ParameterEstimate:
        """Return one estimator's result."""
        return self.estimates[estimator]


def best_of(estimates: Mapping[str, ParameterEstimate]) -> ParameterEstimate:
    """Return the estimate to use of those by estimator: ML if there is one, else GM, else LS."""
    return next(estimates[name] for name in ("ml", "gm", "ls") if name in estimates)


def run_estimators(
    robot: Robot,
    experiments: Sequence[Experiment],
    priors: ParameterPriors,
    wanted: Sequence[str],
    deviations: Sequence[Deviation] = (),
) -> dict[str, ParameterEstimate]:
    """Return the estimates of the wanted estimators, in the order ls, gm, ml.

    Maximum likelihood estimates the given deviations as well, with their tolerances as priors.
    """
    # Maximum likelihood starts from Gauss–Markov.
    needed = {*wanted, "gm"} if "ml" in wanted else wanted
    linear = [name for name in ("ls", "gm") if name in needed]
    results = {
        name: linear_estimate(robot, experiments, priors, name)
        for name in track("linear estimates", linear)
    }
    if "ml" in wanted:
        found, present, longer = results["gm"], None, list(experiments)
        # It ends: harmonics only grow, to a third of the samples of a period at most.
        while longer != present:
            present = longer
            found = maximum_likelihood(robot, present, priors, found, deviations)
            ends = zip(found.influences, found.motions, strict=True)
            longer = [
                with_raised_harmonics(robot, each, found.values, end.machine, motion)
                for each, (end, motion) in zip(present, ends, strict=True)
            ]
        results["ml"] = found
    return {name: found for name, found in results.items() if name in wanted}


def add_systematic_uncertainty(
    estimate: ParameterEstimate, priors: ParameterPriors, tolerances: Sequence[Deviation]
) -> ParameterEstimate:
    """Add the uncertainty due to the tolerances, and to those of the prior, to an estimate.

    Deviations that were estimated are already included. After pointwise kinematics, where the
    effect of the tolerances is unknown, the estimate is returned unchanged.
    """
    found = estimate.systematic
    own = () if found is None else found.deviations
    known = {one.name for one in own}
    others = [EstimatedDeviation.of(one) for one in tolerances if one.name not in known]
    if others:
        chosen, estimated = (*own, *others), found is not None
        found = systematic_share(estimate.influences, chosen, estimated=estimated)
    if priors.prior_estimate is not None:
        found = add_prior_response(found, estimate.influences, priors.prior_estimate)
    return estimate.with_systematic(found)


def _with_true_damping(
    machine: PerturbedMachine, estimates: dict[str, ParameterEstimate], priors: ParameterPriors
) -> tuple[dict[str, ParameterEstimate], ParameterPriors]:
    """Return the best estimate and the priors with the damping of the motors as estimated."""
    best = best_of(estimates)
    values = machine.parameters(best.values)
    start = np.where(priors.free, priors.start, values)
    return estimates | {best.estimator: replace(best, values=values)}, replace(priors, start=start)


def _bound(
    robot: Robot,
    experiments: Sequence[Experiment],
    priors: ParameterPriors,
    estimates: Mapping[str, ParameterEstimate],
) -> Array | None:
    if "ml" in estimates:
        return estimates["ml"].covariance_random
    if any(experiment.fit is None for experiment in experiments):
        return None
    last = list(estimates.values())[-1]
    robot, values = estimated_machine(robot, last.systematic).robot, last.values
    return cramer_rao_covariance(robot, experiments, priors, values)


def _tolerance_warnings(
    robot: Robot,
    experiments: Sequence[Experiment],
    priors: ParameterPriors,
    best: ParameterEstimate,
    section: EstimateSection,
) -> list[str]:
    """Return the warning that tolerances do not count, or the advice to estimate the deviations.

    The advice is for a much smaller σ, which is the Cramér–Rao bound with the deviations as
    unknowns.
    """
    chosen = toleranced_deviations(robot)
    pointwise = any(experiment.fit is None for experiment in experiments)
    if section.systematic == "none" and chosen:
        return [
            "the tolerances of the robot do not count, by `estimate.systematic: none`: standard "
            "deviations and intervals are those of the noise alone"
        ]
    if section.estimates_tolerances or pointwise or not chosen:
        return []
    bound = cramer_rao_covariance(robot, experiments, priors, best.values, chosen)
    ratios = best.std[priors.free] / np.sqrt(np.diag(bound)[priors.free])
    gain = float(np.median(ratios))
    if not gain >= _WORTH_ESTIMATING:
        return []
    how = [
        *(["`ml` to `estimate.estimators`"] if "ml" not in section.estimators else []),
        *(["`systematic: auto` to `estimate`"] if section.systematic == "budget" else []),
    ]
    most = int(np.argmax(ratios))
    return [
        f"σ would be {gain:.2g} times smaller in the median, {ratios[most]:.2g} times for "
        f"{np.array(priors.names)[priors.free][most]}, if maximum likelihood estimated the "
        "deviations within the tolerances with the parameters (predicted from these data). What to "
        f"do: add {' and '.join(how)}"
    ]


_WORTH_ESTIMATING = 1.2
"""Ratio of standard deviations from which estimated deviations are advised."""


def parameter_priors(configuration: RunConfiguration, robot: Robot) -> ParameterPriors:
    """Return the priors, bounds and fixed values of `estimate:`; refuse a run that fixes all."""
    priors = ParameterPriors.of(robot, configuration.run.estimate)
    if not np.any(priors.free):
        raise InputError(
            "every parameter is fixed: there is nothing to estimate",
            file=configuration.file,
            key="estimate.fixed",
        )
    return priors


def refuse_ml_without_fit(
    configuration: RunConfiguration, estimators: Sequence[str], section: str
) -> None:
    """Refuse maximum likelihood without a motion among the estimators of a section of the run."""
    differentiation = configuration.run.estimate.differentiation
    if "ml" in estimators and configuration.run.estimate.pointwise:
        raise InputError(
            "maximum likelihood estimates the motion as a Fourier series or a spline, "
            f"'{differentiation}' differentiation gives it none",
            file=configuration.file,
            key=f"{section}.estimators",
            allowed="[ls, gm], or estimate.differentiation: fourier",
        )


def prior_identification(configuration: RunConfiguration) -> Identification | None:
    """Return the earlier estimate that is the prior of a run's estimate; None without one."""
    section = configuration.run.estimate
    if isinstance(section.prior, RobotDescription):
        return section.prior.identification
    identified = configuration.robot.description.identification
    return identified if section.prior_from == "robot" else None


def _refuse_none_or_repeated(data: Sequence[Measurement], prior: Identification | None) -> None:
    """Refuse no recording, or one that is given twice: its noise would count as independent."""
    if not data:
        raise ValueError("estimate needs at least one recording")
    for number, one in enumerate(data, 1):
        if prior is not None and one.fingerprint in prior.recordings:
            raise UnsuitableDataError(
                f"recording {number} is in the prior, the estimate of the run {prior.run}: it "
                "would count twice",
                file=one.file,
                allowed="recordings that the prior does not contain, or no prior",
            )
    if len(data) == 1:
        return
    blocks = map(_moving_blocks, data)
    given = zip(range(1, len(data) + 1), data, blocks, strict=True)
    for (first, one, own), (second, other, others) in combinations(given, 2):
        shared = _shared_rows(one, other, own, others)
        if shared > _FEW_ROWS * min(len(one.time), len(other.time)):
            same = shared == len(one.time) == len(other.time)
            how = "are the same" if same else f"have {shared} rows in common"
            raise UnsuitableDataError(
                f"recordings {first} and {second} {how}: what is repeated adds no information, and "
                "its noise would count as independent",
                file=other.file,
                allowed="each recording once, and windows of one file that do not overlap",
            )


_FEW_ROWS = 0.005
"""Share of the rows that two recordings may have in common."""
_BLOCK = 10
"""Moving rows in sequence that are not equal in two recordings by chance."""
_Blocks = tuple[NDArray[np.intp], Array]


def _moving_blocks(data: Measurement) -> _Blocks:
    """Return where blocks of rows begin, and numbers that are equal for equal blocks only.

    A block has ten rows with other lengths than the row before. Rows at rest may be equal by
    chance.
    """
    places = 1 + np.flatnonzero(np.any(np.diff(data.lengths, axis=0), axis=1))
    values = *data.lengths[places].T, *data.forces[places].T, np.diff(places, prepend=0)
    # Sums with irrational weights are equal only if all terms are.
    weights = np.sqrt(np.arange(2, 2 + len(values)))
    rows = np.sum([weight * each for weight, each in zip(weights, values, strict=True)], axis=0)
    count = max(len(places) - _BLOCK + 1, 0)
    shifted = [weight * rows[i : i + count] for i, weight in enumerate(weights[:_BLOCK])]
    return places[:count], np.sum(shifted, axis=0)


def _shared_rows(one: Measurement, other: Measurement, own: _Blocks, others: _Blocks) -> int:
    """Return the number of equal rows at the distance of most equal blocks; 0 without one."""
    (places, blocks), (other_places, other_blocks) = own, others
    few = max(int(_FEW_ROWS / 2 * len(blocks)), 1)
    if not np.any(np.isin(other_blocks, blocks[::few])):
        return 0
    _, first, second = np.intersect1d(blocks, other_blocks, return_indices=True)
    distances, counts = np.unique(places[first] - other_places[second], return_counts=True)
    later = int(distances[np.argmax(counts)])
    rows = [np.concatenate([each.lengths, each.forces], axis=1) for each in (one, other)]
    length = min(len(rows[0]) - max(later, 0), len(rows[1]) - max(-later, 0))
    aligned = (rows[i][max(by, 0) :][:length] for i, by in enumerate((later, -later)))
    return int(np.count_nonzero(np.all(np.equal(*aligned), axis=1)))


def _refuse_channels(
    configuration: RunConfiguration,
    robot: Robot,
    check: ChannelCheck,
    data: Measurement,
    design: FourierTrajectory | None,
) -> None:
    """Refuse a recording with another clock or other channels than the run states."""
    mended, clock = with_clock(configuration, data, design)
    if clock:
        folded = fold_measurement(mended, data, design)
        check = check_recording(mended, robot, folded, design, has_units=data.has_units)
    section = configuration.run.data.with_files(partial(name_in_run_file, configuration.file))
    replace(check, clock=clock).refuse(section, data.source)


def _refuse_selection(
    section: EstimateSection,
    data: Sequence[Measurement],
    recordings: Sequence[PreparedRecording],
) -> None:
    """Refuse a selection of terms with a recording that has no period."""
    for measurement, recording in zip(data, recordings, strict=True):
        if (
            section.select is not None
            and recording.experiment.recording.source is PeriodSource.NONE
        ):
            raise UnsuitableDataError(
                "the selection of terms needs a motion that repeats",
                file=measurement.file,
                key="estimate.select",
                allowed="recordings with a period, or `terms` of the robot without a selection",
            )


def _match_designs(
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


def _inconsistency(configuration: RunConfiguration) -> str:
    """Return a warning that no physically consistent parameters were found, with the reason."""
    section = configuration.run.estimate
    causes = {
        "the fixed values (`estimate.fixed`)": bool(section.fixed),
        "the bounds (`estimate.bounds`)": bool(section.bounds),
        "the values held by the earlier identification (`estimate.prior`)": isinstance(
            section.prior, RobotDescription
        ),
    }
    given = [cause for cause, there in causes.items() if there]
    if given:
        return f"no physically consistent parameters exist with {' and '.join(given)}"
    return (
        "the search for the nearest physically consistent parameters did not converge: whether the "
        "estimate is physically consistent is not known"
    )


def _low_pass_warnings(
    stated: Robot, recordings: Sequence[PreparedRecording], best: ParameterEstimate
) -> Iterator[str]:
    """Yield the warnings of estimated low passes slower than their model, unlike their tolerances.

    Tolerances are warned of with the motion (`prepare_recording`).
    """
    found = {} if best.systematic is None else best.systematic.estimates
    tolerances = {one.name: one.tolerance for one in low_passes(stated)}
    constants = {name: found.get(name, 0.0) for name in tolerances}
    for recording in recordings:
        fit = recording.experiment.fit
        if fit is not None and isinstance(fit.motion, HarmonicMotion):
            warning = slow_low_pass_warning(stated, fit.motion, constants)
            if warning and not slow_low_pass_warning(stated, fit.motion, tolerances):
                yield warning


_FAR = 3.0
"""Most standard deviations of LS and GM between their parameters and those of ML: they add the
effects of tolerances that ML estimates, and the noise is the same."""


def _warnings(
    recordings: Sequence[PreparedRecording],
    channels: Sequence[ChannelCheck],
    priors: ParameterPriors,
    estimates: Mapping[str, ParameterEstimate],
) -> list[str]:
    found = []
    for recording, check in zip(recordings, channels, strict=True):
        where = f"{recording.source}: " if recording.source and len(recordings) > 1 else ""
        noise, single = recording.experiment.noise, None
        fit = recording.experiment.fit
        if fit is not None and isinstance(fit.motion, SplineMotion):
            single = fit.motion
            found.append(
                f"{where}without a period the motion is a spline, with knots every "
                f"{single.spacing:.3g} s, and the noise is that of the residuals. The diagnosis "
                "searches for causes along that motion; tests of the scatter between periods, of "
                "geometry, gravity and delays are left out"
            )
            if not recording.experiment.settled:
                found.append(
                    f"{where}motion and noise still changed when their iteration ended: values and "
                    "intervals are wrong"
                )
        found += [
            f"{where}too few periods to estimate the noise, and none is given: {source}. Record "
            "three periods or more"
            for own, source in (
                (noise.forces, "Σ comes from the residuals and includes the model's error"),
                (noise.lengths, "Δ comes from the residuals of the motion fitted to the lengths"),
            )
            if own.includes_model_error and single is None
        ]
        left_out = recording.experiment.recording.rows_left_out
        unchecked = check.unchecked and f"the channels are not checked: {check.unchecked}"
        notes = (left_out, *recording.warnings, check.silent, check.lag, unchecked)
        found += [where + warning for warning in notes if warning]
        if recording.experiment.harmonics_left_out:
            found.append(
                f"{where}the forces show {recording.experiment.harmonics} harmonics of the motion, "
                f"the lengths alone {recording.harmonics}: LS and GM use only these, and their "
                "intervals are too narrow. Use ML, which estimates all of them"
            )
        if recording.experiment.fit is None:
            found.append(
                f"{where}pointwise differentiation: the errors of rates and accelerations are in "
                "the regressor, estimates are biased and the intervals do not cover"
            )
    best = best_of(estimates)
    for name, result in estimates.items():
        if not result.converged:
            found.append(f"{name}: {result.status}")
        apart = np.abs(difference_test(best.values, result.values, result.covariance).z)
        theta = best.systematic if best.estimator == "ml" else None
        if theta is not None and theta.with_priors and np.any(apart > _FAR):
            found.append(
                f"{name}: parameters differ from those of ML by up to {np.nanmax(apart):.2g} "
                "standard deviations. If the diagnosis names no other effect, tolerances act "
                "beyond their linear range, as near a singular pose, and its intervals are too "
                "narrow: use ML"
            )
        found += [
            f"{name}: {priors.names[k]} is at its bound (`estimate.bounds`), which its "
            "standard deviation does not include"
            for k in np.flatnonzero(priors.at_bound(result.values))
        ]
    return found
