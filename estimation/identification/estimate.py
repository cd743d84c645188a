"""From recordings to identified parameters with their uncertainty and a diagnosis.

`identified_robot` describes the robot of `identified-robot.yaml`; `identified_model` takes
parameters and covariance from a stored result, for predictions of other motions.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from constraints.arrays import Array
from estimation.channels.check import channel_findings
from estimation.data.measurement import Measurement
from estimation.data.sensors import SensorResponse
from estimation.diagnostics.diagnosis import diagnose
from estimation.diagnostics.diagnosis_result import Diagnosis, ResidualDiagnosis
from estimation.diagnostics.noise_result import covariance_fields
from estimation.diagnostics.reliability import undetected_std
from estimation.estimators import (
    ParameterEstimate,
    ParameterPriors,
    PerturbedMachine,
    SystematicUncertainty,
    covariance_ml_less_gm,
)
from estimation.estimators.covariance import EstimatedDeviation
from estimation.estimators.result import uncertainty_fields
from estimation.identification.estimation import Estimation, estimate_parameters
from estimation.identification.estimator_result import (
    ConstantResult,
    EstimatorResult,
    estimated_quantities,
)
from estimation.identification.recording import PreparedRecording
from estimation.identification.result import (
    EstimatedMotion,
    EstimatedRecording,
    EstimateFile,
    EstimationResult,
    WeightingNoise,
)
from estimation.measurement_model import HarmonicMotion, SplineMotion
from estimation.uncertainty.consistency import ConsistentEstimate
from estimation.uncertainty.forces import (
    ActuatorForce,
    by_actuator,
    force_warning,
    forces_along,
)
from estimation.uncertainty.intervals import ParameterRow
from expdesign.configuration import ConfigurationLike, InputError
from expdesign.configuration.document import Located, document_from_mapping
from expdesign.configuration.estimate import EstimateSection
from expdesign.configuration.robot import RobotDescription, resolve_robot
from expdesign.configuration.run import robot_yaml
from expdesign.configuration.tolerances import (
    Identification,
    IdentifiedDeviation,
    RobotTolerances,
    identified_name,
    machine_name,
)
from expdesign.mechanism.hexapod import ACTUATORS
from expdesign.mechanism.terms.actuator_forces import BACK_EMF
from expdesign.robot import Robot, deviation, robot_from
from expdesign.trajectory import FourierKeys, FourierTrajectory, fourier_keys


def estimate(
    config: ConfigurationLike,
    data: Measurement | Sequence[Measurement],
    design: FourierTrajectory | Sequence[FourierTrajectory | None] | None = None,
    *,
    refuse_channels: bool = False,
) -> EstimationResult:
    """Estimate the parameters from one or several recordings and diagnose the best estimate.

    Parameters
    ----------
    config : path, mapping or RunConfiguration
        Its sections `estimate` and `noise` and its robot are used.
    data : Measurement or sequence of Measurement
        Recordings of different trajectories are combined in one estimate.
    design : FourierTrajectory or sequence, optional
        The trajectory of each recording (one for all of them, or one each); without it the period
        comes from the recording.
    refuse_channels : bool
        Refuse a recording whose channels certainly contradict the section `data`; otherwise that
        is the first finding.

    Raises
    ------
    InputError
        The configuration, or a recording's period, does not fit.
    WrongChannelsError
        Channels are refused.
    MotionFitError
        No motion has the measured lengths.
    UnidentifiableError
        The data do not determine some parameters at all; it names them.
    """
    estimation = estimate_parameters(config, data, design, refuse_channels=refuse_channels)
    return estimation_result(estimation, diagnose_estimation(estimation))


def diagnose_estimation(estimation: Estimation) -> ResidualDiagnosis | None:
    """Return the diagnosis of the best estimate; None after pointwise differentiation."""
    if estimation.pointwise:
        return None
    chosen = estimation.selection
    return diagnose(
        estimation.robot,
        estimation.experiments,
        estimation.priors,
        estimation.best,
        findings=() if chosen is None else chosen.findings,
        channels=channel_findings(estimation.channels),
        wanted=estimation.configuration.run.wanted,
    )


def estimation_result(
    estimation: Estimation, diagnosis: ResidualDiagnosis | None = None
) -> EstimationResult:
    """Return the result of an estimation with the diagnosis of its best estimate."""
    priors = estimation.priors
    identified = identified_robot(estimation, diagnosis)
    motions = {
        number: _motion(estimation, number)
        for number, recording in enumerate(estimation.recordings, start=1)
        if recording.experiment.fit is not None
    }
    forces = _forces(identified, motions.values())
    return EstimationResult(
        name=estimation.configuration.run.name,
        robot=estimation.robot.name,
        parameters=priors.names,
        fixed=tuple(np.array(priors.names)[~priors.free].tolist()),
        best=estimation.best.estimator,
        recordings=tuple(map(_recording, estimation.recordings, estimation.fingerprints)),
        prior_recordings=estimation.prior_recordings,
        estimators={
            name: _estimator(estimation, found) for name, found in estimation.estimates.items()
        },
        cramer_rao_covariance=estimation.bound,
        covariance_ml_less_gm=covariance_ml_less_gm(estimation.estimates),
        intervals_cover=estimation.best.converged and not estimation.pointwise,
        intervals_note=_intervals_note(estimation),
        diagnostics=diagnosis,
        selection=estimation.selection,
        seconds=estimation.seconds,
        warnings=(
            *estimation.warnings,
            *filter(None, [force_warning(forces)]),
            *_digital_filters(estimation, diagnosis),
        ),
        rows=_rows(estimation, diagnosis),
        motions=motions,
        tables=() if diagnosis is None else diagnosis.recordings,
        identified=robot_yaml(identified),
        forces=forces,
    )


_SIGMAS, _ALIKE = 3.0, 0.15
"""Difference between a delay and that of a digital filter: noise, and a share of it."""


def _digital_filters(estimation: Estimation, diagnosis: ResidualDiagnosis | None) -> Iterator[str]:
    """Yield warnings of delays that filters stated without `sampling` have if they are digital."""
    sensors = SensorResponse.of(estimation.configuration.run.data, "Q")
    if sensors is None or diagnosis is None:
        return
    for recording, found in zip(estimation.recordings, diagnosis.recordings, strict=True):
        step = recording.experiment.recording.step
        expected = sensors.delay_if_digital(step)
        for effect in found.tests.effects:
            near = _SIGMAS * effect.std + _ALIKE * abs(expected)
            alike = abs(effect.value - expected) < near and abs(expected) > effect.std
            if effect.kind == "delay" and alike:
                yield (
                    f"the delay of {1e3 * effect.value:.2g} ms is that of `data.filter` if it was "
                    f"computed at the rate of the log: state `sampling: {1 / step:g} Hz` there"
                )


def _forces(
    identified: RobotDescription, motions: Iterable[EstimatedMotion]
) -> tuple[ActuatorForce, ...]:
    """Return the forces of the identified machine on the motions of all recordings."""
    known, states = identified.identification, [one.state for one in motions]
    if known is None or not states:
        return ()
    machine = Robot(resolve_robot(Located(identified, document_from_mapping({}))))
    times = np.concatenate([one.time for one in motions])
    return by_actuator(forces_along(machine, known, times, np.concatenate(states)), machine)


def _rows(estimation: Estimation, diagnosis: ResidualDiagnosis | None) -> tuple[ParameterRow, ...]:
    """Return the rows of all estimators, that of the diagnosis with its undetected effects."""
    if diagnosis is None:
        return estimation.rows
    added = undetected_std(diagnosis.undetected)
    return tuple(
        replace(row, std_undetected=added.get(row.parameter, np.nan))
        if row.estimator == diagnosis.estimator
        else row
        for row in estimation.rows
    )


def _recording(prepared: PreparedRecording, fingerprint: str) -> EstimatedRecording:
    recording, noise = prepared.experiment.recording, prepared.experiment.noise
    fit = prepared.experiment.fit
    motion = None if fit is None or isinstance(fit.motion, SplineMotion) else fit.motion
    free = motion is not None and motion.free_frequency
    return EstimatedRecording(
        source=prepared.source,
        fingerprint=fingerprint,
        rows=recording.rows,
        dropped_rows=recording.dropped,
        lost_samples=recording.lost,
        samples=recording.samples,
        averaged=recording.averaged,
        periods=float(recording.periods),
        omega=float(recording.omega if motion is None else motion.omega),
        omega_std=float(np.sqrt(np.asarray(fit.covariance)[-1, -1])) if fit and free else None,
        period_source=recording.source.value,
        jitter=float(prepared.jitter),
        harmonics=prepared.harmonics,
        harmonics_of_forces=prepared.experiment.harmonics,
        fewest_harmonics=prepared.fewest_harmonics,
        knot_spacing=fit.motion.spacing if fit and isinstance(fit.motion, SplineMotion) else None,
        noise=WeightingNoise(
            **covariance_fields(noise),
            force_source=noise.forces.source,
            length_source=noise.lengths.source,
            includes_model_error=noise.forces.includes_model_error,
            force_spectrum=noise.forces.spectrum_words,
            length_spectrum=noise.lengths.spectrum_words,
        ),
    )


def _estimator(estimation: Estimation, found: ParameterEstimate) -> EstimatorResult:
    priors, name = estimation.priors, found.estimator
    motions = [
        motion.delay_by(recording.experiment.recording.origin).trajectory
        for motion, recording in zip(found.motions, estimation.recordings, strict=False)
        if isinstance(motion, HarmonicMotion)
    ]
    return EstimatorResult(
        **uncertainty_fields(found),
        values=dict(zip(priors.names, found.values.tolist(), strict=True)),
        covariance_systematic=found.covariance_systematic,
        constants=tuple(_constants(robot_from(estimation.configuration.robot), found.systematic)),
        derived=tuple(estimated_quantities(estimation.robot, found, priors.regrouping)),
        payload=estimation.payloads.get(name),
        consistent=estimation.consistent[name],
        base_parameters=priors.identified_combinations(
            estimation.robot, found.values, found.covariance
        ),
        inseparable=priors.inseparable_combinations(
            estimation.robot, found.values, found.covariance
        ),
        motions=tuple(FourierKeys(**fourier_keys(motion)) for motion in motions),
    )


def _constants(robot: Robot, systematic: SystematicUncertainty | None) -> Iterator[ConstantResult]:
    """Yield the estimated constants of terms, of the robot as its file states it."""
    names = (f"{term.name}_{one.name}" for term in robot.terms for one in term.constants)
    stated = dict(zip(names, robot.description.constants, strict=True))
    entries = () if systematic is None else systematic.deviations
    estimated = {one.name: one for one in reversed(entries)}
    for own in deviation.estimated_constants(robot):
        if own.name in estimated:
            found = estimated[own.name]
            yield ConstantResult(
                constant=own.group.partition(".")[2],
                unit=own.unit,
                value=stated[own.name] + found.value,
                std=found.std,
                stated=stated[own.name],
                tolerance=own.tolerance if np.isfinite(own.tolerance) else np.nan,
            )


def _motion(estimation: Estimation, number: int) -> EstimatedMotion:
    """Evaluate the best estimate at the samples of a recording, counted from 1."""
    experiment, motion = estimation.experiments[number - 1], estimation.best.motions[number - 1]
    recording, robot = experiment.recording, estimation.robot
    along = experiment.for_estimator(estimation.best.estimator).along_motion(motion)
    forces, lengths = recording.forces, recording.lengths
    modelled = along.regressors(robot, forces.times) @ estimation.best.values
    followed = robot.inverse_kinematics(motion.poses(lengths.times))
    return EstimatedMotion(
        forces.times + recording.origin,
        motion.at(forces.times).state(),
        *map(lengths.as_recorded, (lengths.values, followed)),
        *map(forces.as_recorded, (forces.values, modelled)),
    )


def _intervals_note(estimation: Estimation) -> str:
    if not estimation.best.converged:
        return "the estimator did not converge: its values and standard deviations are not valid"
    if estimation.pointwise:
        return (
            "pointwise differentiation: the lengths' noise is in the regressor, which biases "
            "the estimates and is not in the intervals; they do not cover"
        )
    systematic = estimation.best.systematic
    counted = all(e.noise.forces.lines is not None for e in estimation.experiments)
    noise = f"the noise of forces and lengths, {'as it is' if counted else 'taken for white'}"
    if systematic is None or not systematic.groups:
        why = "the robot file gives no tolerances"
        if deviation.toleranced_deviations(estimation.robot):
            why = "its tolerances are left out (estimate.systematic: none)"
        return f"95 %, with {noise}; they hold for exact geometry and force constants: {why}"
    verb = "and what is left of" if systematic.with_priors else "and"
    return f"95 %, with {noise}, {verb} the robot's tolerances"


def identified_robot(estimation: Estimation, diagnosis: Diagnosis | None) -> RobotDescription:
    """Return the robot with the parameters of the best estimate.

    With `estimate.consistent` these are the nearest physically consistent parameters.

    The parameters replace the bodies. Estimated joints, gravity and constants replace those of the
    robot, with their standard deviations as tolerances. Tolerances of the measurement stay. A
    constant with `estimate: true` keeps it, with this tolerance as its prior. Terms that the robot
    lacks are not added, even with estimated parameters: their tolerances stay as well. The damping
    of motors belongs to the recordings.
    """
    robot, best = robot_from(estimation.configuration.robot), estimation.best
    found = best.systematic
    description = robot.description.description
    if found is not None and found.estimated:
        tolerances = _tolerances(description, robot, best)
        moved = deviation.as_in_a_file(
            deviation.apply_deviations(robot, found.deviations, found.values).description
        )
        description = moved.model_copy(update={"tolerances": tolerances})
    parameters = dict(zip(estimation.priors.names, best.values.tolist(), strict=True))
    if (near := _replacement(estimation)) is not None:
        parameters = near.values
    damping = {one.name for one in BACK_EMF.parameters}
    parameters = {name: value for name, value in parameters.items() if name not in damping}
    return description.model_copy(
        update={
            "name": identified_name(description.name),
            "parameters": parameters,
            "terms": tuple(one for one in description.terms if one.name != BACK_EMF.name),
            "bodies": None,
            "identification": _identification(estimation, diagnosis).for_parameters(parameters),
        }
    )


def _replacement(estimation: Estimation) -> ConsistentEstimate | None:
    """Return the consistent parameters where the run asks for them; None: the estimate itself."""
    wanted = estimation.configuration.run.estimate.consistent
    return estimation.consistent[estimation.best.estimator] if wanted else None


def _identification(estimation: Estimation, diagnosis: Diagnosis | None) -> Identification:
    best, robot = estimation.best, robot_from(estimation.configuration.robot)
    found = best.systematic
    verdict = None if diagnosis is None else diagnosis.verdict
    # Deviations without a tolerance are random: their errors are in that covariance.
    inexact = np.zeros(0, dtype=bool)
    response = shared = np.zeros((len(best.values), 0))
    constants = [one.name for one in deviation.estimated_constants(robot)]
    joint = slice(len(best.values) + len(constants))
    entries: list[EstimatedDeviation] = []
    deviating = np.zeros((0, 0))
    if found is not None:
        inexact = np.isfinite([one.tolerance for one in found.deviations])
        entries = [one for one in found.deviations if np.isfinite(one.tolerance)]
        response = np.concatenate([found.response, np.asarray(found.left)])[joint, inexact]
        shared = found.joint_scaled_response[joint]
        if found.with_priors:
            own = len(best.values) + np.flatnonzero(inexact)
            deviating = best.joint[np.ix_([*range(len(best.values)), *own], own)]
    return Identification(
        run=estimation.configuration.run.name,
        estimator=best.estimator,
        verdict="not judged" if verdict is None else verdict.status.value,
        summary="" if verdict is None else verdict.summary,
        recordings=(*estimation.fingerprints, *estimation.prior_recordings),
        parameters=estimation.priors.names,
        constants=tuple(constants),
        unconstrained=() if _replacement(estimation) is None else tuple(best.values.tolist()),
        covariance_random=_nested_tuples(best.joint_random[joint, joint]),
        covariance_systematic=_nested_tuples(shared @ shared.T),
        deviations=tuple(
            IdentifiedDeviation(
                name=one.name, tolerance=one.tolerance, value=one.value, std=one.std
            )
            for one in entries
        ),
        response=_nested_tuples(response) if entries else (),
        covariance_deviations=_nested_tuples(deviating),
    )


def _tolerances(description: RobotDescription, robot: Robot, best: ParameterEstimate) -> Any:
    """Return the tolerances of the robot, reduced to the standard deviations of the estimate."""
    given, found = description.tolerances, best.systematic
    constants = [one.group.split(".")[1:] for one in deviation.estimated_constants(robot)]
    if found is None or (given is None and not constants):
        return given
    given = given or RobotTolerances()
    left: dict[str, float] = {}
    for one in found.deviations:
        if one.of_the_machine:
            left.setdefault(one.name, one.std)  # a later entry of the name is a prior's error
    changes: dict[str, Any] = {}
    for group in ("base_joints", "platform_joints"):
        if getattr(given, group) is not None:
            changes[group] = tuple(
                tuple(left.get(f"{group[:-1]}_{j}_{axis}", 0.0) for axis in ("x", "y", "z"))
                for j in range(1, ACTUATORS + 1)
            )
    tilts = [std for name, std in left.items() if name.startswith("gravity_")]
    if tilts:
        changes["gravity"] = float(np.sqrt(np.mean(np.square(tilts))))
    terms = {term: dict(own) for term, own in (given.terms or {}).items()}
    for term, name in constants:
        terms.setdefault(term, {})[name] = 0.0
    if terms:
        lacking = terms.keys() - {term.name for term in robot.terms}
        changes["terms"] = {
            term: own
            if term in lacking
            else {name: left.get(f"{term}_{name}", std) for name, std in own.items()}
            for term, own in terms.items()
        }
    return given.model_copy(update=changes)


def _nested_tuples(matrix: Array) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(row) for row in matrix.tolist())


@dataclass(frozen=True, eq=False)
class IdentifiedModel:
    """Parameters with their covariance, to predict with, without the damping of the motors."""

    path: Path
    """The `estimate.json` they come from, for messages."""
    estimate: ParameterEstimate
    """Without motions."""
    priors: ParameterPriors
    doubt: str = ""
    """Serious findings of its diagnosis, in words; empty: none."""

    def with_motors(self, data: Measurement, machine: PerturbedMachine) -> IdentifiedModel:
        """Return the model of a recording's forces: those of voltages have the damping.

        Raises
        ------
        InputError
            The recording contains voltages, and the estimate comes from forces.
        """
        if data.back_emf is None:
            return self
        names = self.priors.names
        if BACK_EMF.parameters[0].name not in names:
            message = "the recording contains voltages, and the estimate comes from forces"
            raise InputError(message, data.file, allowed="recordings of one kind")
        values = self.estimate.values.copy()
        values[[names.index(one.name) for one in BACK_EMF.parameters]] = data.back_emf
        values = machine.parameters(values)
        start = np.where(self.priors.free, self.priors.start, values)
        return replace(
            self,
            estimate=replace(self.estimate, values=values),
            priors=replace(self.priors, start=start),
        )


def identified_model(
    result: EstimateFile, path: Path, robot: Robot, estimator: str | None = None
) -> IdentifiedModel:
    """Return the model that an estimator identified, by default the best one.

    `path` is that of the file, for messages, `robot` the one whose motions are predicted.

    Raises
    ------
    InputError
        The estimate belongs to another robot or to other tolerances, or the estimator is unknown.
    """
    names, key = result.parameters, result.best if estimator is None else estimator
    wrong, allowed = "", robot.name
    if names != robot.parameter_names:
        wrong = f"its parameters are not those of the robot {robot.name}"
        allowed = ", ".join(robot.parameter_names)
    elif machine_name(result.robot) != machine_name(robot.name):
        wrong = f"it is an estimate of the robot {result.robot!r}, not of {robot.name!r}"
    elif key not in result.estimators:
        wrong, allowed = f"it has no estimator '{key}'", ", ".join(result.estimators)
    if wrong:
        raise InputError(wrong, file=path, key="--estimate", allowed=allowed)
    entry = result.estimators[key]
    # The damping of the motors belongs to the recordings.
    known_damping = {each.name: 0.0 for each in BACK_EMF.parameters if each.name in names}
    entry = replace(entry, values=entry.values | known_damping)
    fixed: dict[str, float | None] = {name: entry.values[name] for name in result.fixed}
    estimate = ParameterEstimate(
        **uncertainty_fields(entry),
        estimator=key,
        values=np.array([entry.values[name] for name in names]),
        influences=(),
        motions=(),
    )
    systematic, known = entry.systematic, {one.name for one in deviation.deviations(robot)}
    if systematic is not None:
        lacking = [one for one in systematic.deviations if one.name not in known]
        if absent := [one.name for one in lacking if one.value != 0]:
            raise InputError(
                f"it estimated deviations for which the robot {robot.name} has no tolerance: "
                f"{', '.join(absent)}. Their forces are a part of its predictions",
                file=path,
                key="--estimate",
                allowed="a robot with the `tolerances` of the estimate, such as its "
                "identified-robot.yaml",
            )
        own = None if lacking else _relative_to(robot, result, systematic)
        estimate = replace(estimate, systematic=own)
    priors = ParameterPriors.of(robot, EstimateSection(fixed=fixed))
    failed = () if result.diagnostics is None else result.diagnostics.verdict.failed
    doubt = "; ".join(finding.contradiction for finding in failed if finding.serious)
    return IdentifiedModel(path, estimate, priors, doubt)


_SAME = 1e-9
"""Relative difference of equal parameters in two files."""


def _relative_to(
    robot: Robot, result: EstimateFile, systematic: SystematicUncertainty
) -> SystematicUncertainty:
    """Return deviations less those in the robot, if it is the one that was identified here.

    Its joints, gravity and constants are those of the estimator that it states.
    """
    described = robot.description.description
    about = described.identification
    best = None if about is None else result.estimators.get(about.estimator)
    if about is None or best is None or best.systematic is None:
        return systematic
    # Without a payload that the run adds, and before the nearest consistent parameters.
    values = dict(described.parameters or {})
    values |= dict(zip(about.parameters, about.unconstrained, strict=False))
    damping = {one.name for one in BACK_EMF.parameters}
    names = [name for name in best.values if name not in damping]
    found, stated = (
        np.array([each.get(name, np.nan) for name in names]) for each in (best.values, values)
    )
    if not np.allclose(found, stated, rtol=_SAME, atol=0.0):
        return systematic
    there, terms = best.systematic.estimates, {f"terms.{one.name}" for one in robot.extended.terms}
    entries = (
        replace(one, value=one.value - there.get(one.name, 0.0))
        if one.of_the_machine and one.group not in terms  # no parameters of terms that it lacks
        else one
        for one in systematic.deviations
    )
    return replace(systematic, deviations=tuple(entries))
